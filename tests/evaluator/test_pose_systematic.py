"""Errors that all frames of a recording share, carried into its poses: in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from calibration.camera import PARAMETERS, Camera, camera_above
from evaluator.pose import poses_from_marks
from evaluator.pose_systematic import (
    COMMON_PX,
    COMMON_SHARE,
    IMAGE_SHARE,
    _independent_errors,
    _smoothly,
    camera_shifts,
    common_error_mm,
)

from .turning.synthetic import GEOMETRY, arc_poses, marks_of

CAMERA = camera_above(size_px=(800, 600), focal_px=2000.0, distance_mm=106.5)  # 20 px/mm at the marks


def uncertain(**sigmas: float) -> Camera:
    return replace(CAMERA, covariance=np.diag([sigmas.get(name, 0.0) ** 2 for name in PARAMETERS]))


def tracked(sigma_mm: float = 0.02, frames: int = 60) -> pd.DataFrame:
    """Marks of a robot on a circle of 5 mm, each known to sigma_mm, with their places in the image."""
    table = marks_of(arc_poses(5.0, 300.0, frames), 0.0, np.random.default_rng(0))
    for name in ("green", "yellow"):
        points = table[[f"{name}_x_mm", f"{name}_y_mm"]].to_numpy()
        seen = CAMERA.image_from_plate(np.column_stack([points, np.full(frames, 6.5)]))
        table[f"{name}_x_px"], table[f"{name}_y_px"] = seen.T
        table[f"{name}_x_sigma_mm"] = table[f"{name}_y_sigma_mm"] = sigma_mm
    return table


def places(table: pd.DataFrame) -> dict[str, np.ndarray]:
    return {name: table[[f"{name}_x_mm", f"{name}_y_mm"]].to_numpy() for name in ("green", "yellow")}


def test_common_error_is_a_share_of_that_of_a_frame_and_a_part_of_a_pixel() -> None:
    table = tracked()
    covariances = np.tile(0.02**2 * np.eye(2), (len(table), 2, 1, 1))
    expected = np.hypot(COMMON_SHARE * 0.02, COMMON_PX / 20)
    assert common_error_mm(table, places(table), covariances) == pytest.approx(expected, rel=1e-6)
    assert (COMMON_SHARE, COMMON_PX, IMAGE_SHARE) == (0.12, 0.0015, 0.17)  # measured: see there
    unseen = {name: np.full_like(points, np.nan) for name, points in places(table).items()}
    assert common_error_mm(table, unseen, covariances) == 0.0


def test_scale_of_the_common_error_is_that_of_the_first_two_of_several_marks() -> None:
    table = tracked().assign(blue_x_mm=0.0, blue_y_mm=0.0, blue_x_px=0.0, blue_y_px=0.0)
    three = places(table) | {"blue": np.zeros((len(table), 2))}
    covariances = np.tile(0.02**2 * np.eye(2), (len(table), 3, 1, 1))
    assert common_error_mm(table, three, covariances) == common_error_mm(table, places(table), covariances[:, :2])


def test_error_of_the_scale_moves_every_mark_away_from_the_middle_of_the_view_by_its_share() -> None:
    table = tracked()
    shifts = camera_shifts(table, places(table), 6.5, uncertain(focal_px=2.0))
    assert shifts.shape == (60, 2, 2, 1)
    for k, points in enumerate(places(table).values()):
        np.testing.assert_allclose(np.abs(shifts[:, k, :, 0]), np.abs(points) * 1e-3, atol=1e-9)


def test_poses_carry_a_shift_for_each_error_of_camera_body_and_image() -> None:
    """Both marks weigh alike: an error of one along an axis moves the centre of rotation by half of it."""
    poses = poses_from_marks(tracked(), GEOMETRY, uncertain(focal_px=2.0))
    assert poses.systematic is not None
    assert poses.systematic.shape == (60, 3, 1 + 4 + 4)
    body, image = poses.systematic[:, :, 1:5], poses.systematic[:, :, 5:]
    common = np.hypot(COMMON_SHARE * 0.02, COMMON_PX / 20)
    # Heading from the marks' distance of 3.66 mm, by what lies across their line: along the robot.
    across = np.abs(body[:, 2]).max(axis=0)
    assert sorted(across) == pytest.approx([0.0, 0.0, common / 3.66, common / 3.66], abs=1e-9)
    turned = np.hypot(*np.moveaxis(image[:, 2].reshape(60, 2, 2), 2, 0))
    np.testing.assert_allclose(turned, IMAGE_SHARE * 0.02 / 3.66)
    bare = tracked().drop(columns=["green_x_px", "yellow_y_px"])
    alone = poses_from_marks(bare, GEOMETRY, uncertain(focal_px=2.0)).systematic
    assert alone is not None
    assert alone.shape == (60, 3, 1)


def test_independent_errors_add_up_to_the_covariance_and_are_as_many_as_it_has_directions() -> None:
    rng = np.random.default_rng(1)
    root = np.zeros((len(PARAMETERS), 3))
    root[[5, 6, 8, 10]] = rng.normal(size=(4, 3)) * [[1e-2], [3.0], [0.5], [1e-4]]
    errors = _independent_errors(replace(CAMERA, covariance=root @ root.T))
    assert errors.shape[1] == 3
    np.testing.assert_allclose(errors @ errors.T, root @ root.T, rtol=1e-9, atol=1e-14)
    assert _independent_errors(CAMERA).shape[1] == 0


def test_an_error_counts_however_small_the_unit_of_its_parameter() -> None:
    errors = _independent_errors(uncertain(focal_px=20.0, k2=1e-8))
    assert sorted(np.abs(errors).max(axis=0)) == pytest.approx([1e-8, 20.0])


@pytest.mark.parametrize(("count", "calls"), [(120, 120), (400, 120)])
def test_a_smooth_function_of_many_places_is_a_cubic_through_some_of_them(count: int, calls: int) -> None:
    rng = np.random.default_rng(2)
    at = rng.uniform(0, 800, (count + 1, 2))
    at[7] = np.nan
    asked = []

    def cubic(where: np.ndarray) -> np.ndarray:
        asked.append(len(where))
        x, y = where.T / 100
        return np.stack([1 + x**3 - 2 * x * y**2, y**3 + x * y - x**2 * y], axis=1)

    found = _smoothly(cubic, at)
    assert asked == [calls]
    assert np.isnan(found[7]).all()
    known = np.arange(count + 1) != 7
    np.testing.assert_allclose(found[known], cubic(at[known]), atol=1e-8)


def test_what_is_no_cubic_is_exact_at_as_many_places_as_are_looked_at() -> None:
    at = np.random.default_rng(3).uniform(0, 800, (120, 2))
    np.testing.assert_allclose(_smoothly(np.sin, at), np.sin(at))
