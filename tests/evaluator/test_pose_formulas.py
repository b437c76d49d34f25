"""Every formula of the pose on numbers worked out by hand, and every reason for a frame without a pose."""

from __future__ import annotations

from math import sqrt

import numpy as np
import pandas as pd
import pytest

from calibration.camera import camera_above
from evaluator.errors import InputError
from evaluator.pose import NO_HEADING, ONE_PLACE_MM, ROUNDING_SIGMA_MM, MarkGeometry, Poses, poses_from_marks

from .turning.synthetic import GEOMETRY

LOPSIDED = MarkGeometry(green_mm=(2.0, 1.0), yellow_mm=(-1.0, -0.5))


def table(rows: int = 40, **columns: object) -> pd.DataFrame:
    """Marks of LOPSIDED at rest at (10, 20), heading 90 degrees."""
    values: dict[str, object] = {
        "time_s": np.arange(rows) / 50,
        "green_x_mm": 9.0,
        "green_y_mm": 22.0,
        "yellow_x_mm": 10.5,
        "yellow_y_mm": 19.0,
    }
    return pd.DataFrame(values | columns)


def at_rest(spacing_mm: np.ndarray) -> pd.DataFrame:
    """Marks along x, as far apart as said."""
    return pd.DataFrame(
        {"time_s": np.arange(len(spacing_mm)) / 50, "green_x_mm": spacing_mm}
        | {"green_y_mm": 0.0, "yellow_x_mm": 0.0, "yellow_y_mm": 0.0}
    )


def test_spacing_is_the_distance_of_the_marks() -> None:
    assert MarkGeometry((2.0, 5.0), (-1.0, 1.0)).spacing_mm == pytest.approx(5.0)


@pytest.mark.parametrize(("apart", "refused"), [(0.9, True), (1.1, False)])
def test_marks_nearer_than_their_rounding_are_one_place(apart: float, refused: bool) -> None:
    place = (apart * ONE_PLACE_MM, 0.0)
    if refused:
        with pytest.raises(InputError, match="two different positions"):
            MarkGeometry((0.0, 0.0), place)
    else:
        assert MarkGeometry((0.0, 0.0), place).spacing_mm > 0


def test_rounding_is_that_of_six_decimals_and_one_place_ten_times_it() -> None:
    assert pytest.approx(1e-6 / np.sqrt(12)) == ROUNDING_SIGMA_MM
    assert pytest.approx(1e-5 / np.sqrt(12)) == ONE_PLACE_MM


def test_pose_of_marks_off_the_centre_of_a_robot_that_faces_up() -> None:
    poses = poses_from_marks(table(), LOPSIDED)
    np.testing.assert_allclose([poses.x_mm[0], poses.y_mm[0], poses.heading_rad[0]], [10.0, 20.0, np.pi / 2])


def test_the_mark_known_better_counts_more_in_the_position_by_the_inverse_of_the_variance() -> None:
    sigmas = {f"green_{axis}_sigma_mm": 0.01 for axis in "xy"} | {f"yellow_{axis}_sigma_mm": 0.02 for axis in "xy"}
    wide = table(**sigmas, green_y_mm=22.3, yellow_y_mm=18.9)  # a spacing that is wrong: 0.3 and 0.1 mm too far out
    poses = poses_from_marks(wide, LOPSIDED)
    heading = np.arctan2(3.4, -1.5) - np.arctan2(1.5, 3.0)
    mean = 0.8 * np.array([9.0, 22.3]) + 0.2 * np.array([10.5, 18.9])
    body = 0.8 * np.array([2.0, 1.0]) + 0.2 * np.array([-1.0, -0.5])
    turned = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]]) @ body
    np.testing.assert_allclose([poses.x_mm[0], poses.y_mm[0], poses.heading_rad[0]], [*(mean - turned), heading])


def test_covariance_of_a_pose_is_that_of_the_marks_through_its_numerical_derivative() -> None:
    sigma = {"green_x": 0.01, "green_y": 0.02, "yellow_x": 0.03, "yellow_y": 0.015}
    columns = {f"{name}_sigma_mm": value for name, value in sigma.items()}
    marks = table(**columns, green_xy_cov_mm2=1e-4, yellow_xy_cov_mm2=-2e-4)
    poses = poses_from_marks(marks, LOPSIDED)
    gradient = []
    for name in sigma:
        sides = []
        for step in (1e-4, -1e-4):
            moved = marks.assign(**{f"{name}_mm": marks[f"{name}_mm"] + step})
            found = poses_from_marks(moved, LOPSIDED)
            sides.append(np.array([found.x_mm[0], found.y_mm[0], found.heading_rad[0]]))
        gradient.append((sides[0] - sides[1]) / 2e-4)
    covariance = np.diag([value**2 for value in sigma.values()])
    covariance[0, 1] = covariance[1, 0] = 1e-4
    covariance[2, 3] = covariance[3, 2] = -2e-4
    jacobian = np.array(gradient).T
    np.testing.assert_allclose(poses.covariance[0], jacobian @ covariance @ jacobian.T, rtol=1e-5, atol=1e-12)


@pytest.mark.parametrize(("given", "taken"), [(5e-4, 0.99e-4), (-5e-4, -0.99e-4), (0.5e-4, 0.5e-4), (np.nan, 0.0)])
def test_covariance_of_the_axes_stays_that_of_a_mark(given: float, taken: float) -> None:
    sigmas = {f"{mark}_{axis}_sigma_mm": 0.01 for mark in ("green", "yellow") for axis in "xy"}
    poses = poses_from_marks(table(**sigmas, green_xy_cov_mm2=given, yellow_xy_cov_mm2=given), LOPSIDED)
    other = poses_from_marks(table(**sigmas, green_xy_cov_mm2=taken, yellow_xy_cov_mm2=taken), LOPSIDED)
    np.testing.assert_allclose(poses.covariance, other.covariance)
    assert np.linalg.eigvalsh(poses.covariance[0]).min() > 0


def test_uncertainty_that_is_missing_or_zero_in_a_frame_is_the_usual_one_and_never_below_the_rounding() -> None:
    sigma = np.full(40, 0.01)
    sigma[:3] = [np.nan, 0.0, -1.0]
    names = [f"{mark}_{axis}_sigma_mm" for mark in ("green", "yellow") for axis in "xy"]
    poses = poses_from_marks(table(**dict.fromkeys(names, sigma)), LOPSIDED)
    np.testing.assert_allclose(poses.covariance[:3], poses.covariance[3:6])
    tiny = poses_from_marks(table(**dict.fromkeys(names, 1e-12)), LOPSIDED)
    assert tiny.covariance[0, 2, 2] == pytest.approx(2 * ROUNDING_SIGMA_MM**2 / LOPSIDED.spacing_mm**2)


def test_a_single_mark_has_a_path_with_its_own_covariance_and_no_heading() -> None:
    marks = table(green_x_sigma_mm=0.03, green_y_sigma_mm=0.04, green_status="outside")
    marks.loc[1, "green_x_mm"] = np.nan
    poses = poses_from_marks(marks, LOPSIDED.only(["green"]))
    expected = np.full((40, 3, 3), np.nan)
    expected[:, :2, :2] = np.diag([0.03**2, 0.04**2])
    np.testing.assert_allclose(poses.covariance, expected)
    assert (poses.x_mm[0], poses.y_mm[0]) == (9.0, 22.0)
    assert np.isnan(poses.heading_rad).all()
    assert poses.status[:2].tolist() == [NO_HEADING, "green: outside"]


def test_without_uncertainties_the_scatter_of_the_distance_gives_that_of_a_coordinate() -> None:
    spacing = 4.0 + 0.02 * np.resize([-1.0, 1.0, -2.0, 2.0], 40)  # median deviation 0.03 mm
    poses = poses_from_marks(at_rest(spacing), MarkGeometry((2.0, 0.0), (-2.0, 0.0)))
    coordinate = 1.4826 * 0.03 / np.sqrt(2)
    assert poses.covariance[0, 0, 0] == pytest.approx(coordinate**2 / 2)
    assert poses.covariance[0, 2, 2] == pytest.approx(2 * coordinate**2 / spacing[0] ** 2)


@pytest.mark.parametrize("rows", [1, 2])
def test_two_distances_have_no_scatter_and_refuse_nothing(rows: int) -> None:
    poses = poses_from_marks(at_rest(np.array([4.0, 4.5])[:rows]), MarkGeometry((2.0, 0.0), (-2.0, 0.0)))
    assert poses.measured.all()
    assert poses.covariance[0, 0, 0] == pytest.approx(ROUNDING_SIGMA_MM**2 / 2)


def test_three_distances_refuse_the_odd_one() -> None:
    poses = poses_from_marks(at_rest(np.array([4.0, 4.0, 4.5])), MarkGeometry((2.0, 0.0), (-2.0, 0.0)))
    assert poses.measured.tolist() == [True, True, False]
    assert poses.status[2] == "marks 4.500 mm apart, 4.000 in the other frames"


@pytest.mark.parametrize(("away", "refused"), [(5.5, False), (6.5, True), (-5.5, False), (-6.5, True)])
def test_distances_beyond_six_robust_deviations_are_refused(away: float, refused: bool) -> None:
    spacing = 4.0 + 0.01 * np.resize([-1.0, 1.0], 41)
    spacing[40] = 4.0
    odd = 7 if away > 0 else 8  # so that the median stays in the middle
    spacing[odd] = 4.0 + away * 1.4826 * 0.01
    poses = poses_from_marks(at_rest(spacing), MarkGeometry((2.0, 0.0), (-2.0, 0.0)))
    assert poses.measured[odd] != refused
    assert poses.measured.sum() == 41 - refused


@pytest.mark.parametrize(("away", "refused"), [(5.5, False), (6.5, True)])
def test_exact_distances_may_differ_by_their_rounding(away: float, refused: bool) -> None:
    spacing = np.full(41, 4.0)
    spacing[7] += away * np.sqrt(2) * ROUNDING_SIGMA_MM
    poses = poses_from_marks(at_rest(spacing), MarkGeometry((2.0, 0.0), (-2.0, 0.0)))
    assert poses.measured[7] != refused


def test_reason_of_the_green_mark_is_said_before_that_of_the_yellow_one_and_ok_is_none() -> None:
    marks = table(green_status="ok", yellow_status="ok")
    marks.loc[3, ["green_x_mm", "yellow_y_mm"]] = np.nan
    marks.loc[3, ["green_status", "yellow_status"]] = ["behind a wire", "outside"]
    marks.loc[4, "yellow_x_mm"] = np.nan
    marks.loc[5, "yellow_x_mm"] = np.nan
    marks.loc[5, "yellow_status"] = ""
    poses = poses_from_marks(marks, LOPSIDED)
    assert poses.status[3:6].tolist() == ["green: behind a wire", "yellow: absent", "yellow: absent"]
    assert np.isnan(np.column_stack([poses.x_mm, poses.y_mm, poses.heading_rad])[3:6]).all()
    assert poses.status[6] == "ok"


def test_marks_in_one_place_have_no_heading_and_are_no_measure_of_the_usual_distance() -> None:
    marks = table()
    marks.loc[:9, "yellow_x_mm"], marks.loc[:9, "yellow_y_mm"] = 9.0, 22.0
    poses = poses_from_marks(marks, LOPSIDED)
    assert set(poses.status[:10]) == {"both marks are at one position: no heading"}
    assert poses.measured[10:].all()
    assert poses.spacing_ratio()[0] == pytest.approx(1.0)


def test_three_marks_in_one_place_have_no_heading_either() -> None:
    places = {"front": (2.0, 0.0), "left": (0.0, 1.0), "right": (0.0, -1.0)}
    marks = resting(places, 5)
    marks.loc[2, [f"{name}_{axis}_mm" for name in places for axis in "xy"]] = 1.0
    assert poses_from_marks(marks, MarkGeometry(places)).status[2] == "the marks are at one position: no heading"


def test_table_without_places_on_the_plate_is_refused() -> None:
    with pytest.raises(InputError, match="yellow_y_mm"):
        poses_from_marks(table().drop(columns="yellow_y_mm"), LOPSIDED)


def test_camera_needs_the_height_of_the_marks() -> None:
    camera = camera_above(size_px=(640, 480), focal_px=2000, distance_mm=150)
    with pytest.raises(InputError, match="height_mm"):
        poses_from_marks(table(), LOPSIDED, camera)


@pytest.mark.parametrize("missing", ["x_mm", "y_mm", "heading_rad"])
def test_frame_is_measured_where_place_and_heading_are_known(missing: str) -> None:
    values = {name: np.array([1.0, 2.0]) for name in ("x_mm", "y_mm", "heading_rad")}
    values[missing] = np.array([1.0, np.nan])
    poses = Poses(time_s=np.arange(2.0), covariance=np.zeros((2, 3, 3)), status=np.array(["ok", "ok"]), **values)
    assert poses.measured.tolist() == [True, False]
    assert not poses.x_mm.flags.writeable


def test_ratio_of_the_distances_is_that_of_the_medians_with_the_error_of_a_median() -> None:
    spacing = 4.4 + 0.02 * np.resize([-1.0, 1.0, -2.0, 2.0], 40)
    poses = poses_from_marks(at_rest(spacing), MarkGeometry((2.0, 0.0), (-2.0, 0.0)))
    ratio, error = poses.spacing_ratio()
    assert ratio == pytest.approx(1.1)
    assert error == pytest.approx(1.2533 * 1.4826 * 0.03 / np.sqrt(40) / 4.0)


def test_ratio_needs_geometry_distances_and_two_frames() -> None:
    marks = table()
    two, one = poses_from_marks(marks.iloc[:2], LOPSIDED), poses_from_marks(marks.iloc[:1], LOPSIDED)
    assert two.spacing_ratio() == pytest.approx((1.0, 0.0))
    assert np.isnan(one.spacing_ratio()).all()
    fields = {name: getattr(two, name) for name in ("time_s", "x_mm", "y_mm", "heading_rad", "covariance", "status")}
    assert np.isnan(Poses(**fields, spacing_mm=two.spacing_mm).spacing_ratio()).all()
    assert np.isnan(Poses(**fields, geometry=LOPSIDED).spacing_ratio()).all()


def test_scatter_of_the_distance_is_told_over_the_distance_and_over_what_the_marks_state() -> None:
    """Each mark is known to 0.01 mm along the line between them; across, nothing counts."""
    spacing = 4.0 + 0.1 * np.resize([-1.0, 1.0], 40)
    stated = {f"{name}_x_sigma_mm": 0.01 for name in ("green", "yellow")}
    stated |= {f"{name}_y_sigma_mm": 0.5 for name in ("green", "yellow")}
    marks, geometry = at_rest(spacing).assign(**stated), MarkGeometry((2.0, 0.0), (-2.0, 0.0))
    scatter = 1.4826 * 0.1
    assert poses_from_marks(marks, geometry).spacing_scatter() == pytest.approx((scatter / 4, scatter / sqrt(2e-4)))
    assert np.isnan(poses_from_marks(marks.iloc[:1], geometry).spacing_scatter()).all()
    alone = poses_from_marks(table()[["time_s", "green_x_mm", "green_y_mm"]], MarkGeometry(green=(2.0, 0.0)))
    assert np.isnan(alone.spacing_scatter()).all()


def resting(places: dict[str, tuple[float, float]], frames: int) -> pd.DataFrame:
    """Marks of a robot at rest at the origin, faced along x, without uncertainties."""
    table = pd.DataFrame({"time_s": np.arange(frames) / 60})
    for name, (x, y) in places.items():
        table[f"{name}_x_mm"], table[f"{name}_y_mm"] = x, y
    return table


def test_the_centre_of_a_tag_tells_nothing_beside_its_corners() -> None:
    corners = {
        f"tag_corner{k}": place for k, place in enumerate([(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)], 1)
    }
    table = resting({"tag": (0.003, -0.002), **corners}, 5)  # of the same file, but off
    poses = poses_from_marks(table, MarkGeometry({"tag": (0.0, 0.0), **corners}))
    np.testing.assert_allclose(np.column_stack([poses.x_mm, poses.y_mm, poses.heading_rad]), 0.0, atol=1e-12)


@pytest.mark.parametrize("frames", [3, 2])
def test_three_distances_tell_the_noise_of_a_coordinate_and_two_none(frames: int) -> None:
    table = resting({"green": (-1.55, 1.83), "yellow": (-1.55, -1.83)}, frames)
    table["green_y_mm"] += [0.0, -0.01, 0.02][:frames]  # distances off from their median by 0, 10 and 20 µm
    covariance = poses_from_marks(table, GEOMETRY).covariance
    sigma = 1.4826 * 0.01 / np.sqrt(2) if frames == 3 else ROUNDING_SIGMA_MM
    np.testing.assert_allclose(covariance[:, 2, 2], (sigma / 3.66) ** 2 * 2, rtol=0.02)  # of the heading


def test_how_well_a_mark_is_known_where_frames_are_refused_does_not_count_in_its_weight() -> None:
    sigmas = {f"{name}_{axis}_sigma_mm": 0.01 for name in ("green", "yellow") for axis in "xy"}
    marks = table(40, **sigmas, green_x_mm=9.3)  # a spacing that is wrong: either mark takes its share
    odd = np.arange(40) < 30
    marks.loc[odd, "yellow_x_mm"], marks.loc[odd, "yellow_y_mm"] = 9.3, 22.0  # both at one position
    marks.loc[odd, ["yellow_x_sigma_mm", "yellow_y_sigma_mm"]] = 1.0
    alone = poses_from_marks(marks[~odd], LOPSIDED)
    np.testing.assert_allclose(poses_from_marks(marks, LOPSIDED).x_mm[~odd], alone.x_mm)


def test_poses_in_a_line_say_how_many_when_and_from_where_to_where() -> None:
    x, nothing = np.array([np.nan, 1.0, 2.0, 3.0, np.nan]), np.full((5, 3, 3), np.nan)
    poses = Poses(np.arange(5) / 2, x, 2 * x, 0 * x, nothing, np.full(5, "ok"))
    assert repr(poses) == "Poses(frames 5, with a pose 3, time 0 to 2 s, from (1.00, 2.00) mm, to (3.00, 6.00) mm)"
    assert "<tr><th>to</th><td>(3.00, 6.00) mm</td></tr>" in poses._repr_html_()
    none = Poses(np.arange(5) / 2, np.nan * x, x, x, nothing, np.full(5, "absent"))
    assert repr(none) == "Poses(frames 5, with a pose 0)"


def test_places_of_marks_are_attributes_by_their_keys_of_the_robot_file() -> None:
    assert LOPSIDED.green_mm == (2.0, 1.0)
    for name in ("green", "blue_mm", "height"):
        with pytest.raises(AttributeError, match=name):
            getattr(LOPSIDED, name)
