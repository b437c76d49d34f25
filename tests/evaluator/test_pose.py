from __future__ import annotations

import numpy as np
import pytest

from calibration.camera import PARAMETERS, Camera, camera_above
from evaluator.errors import InputError
from evaluator.pose import MarkGeometry, poses_from_marks, unwrapped_across_gaps

from .turning.synthetic import GEOMETRY, arc_poses, marks_of


def test_exact_marks_give_the_exact_pose() -> None:
    truth = arc_poses(5.0, 700, 200)
    poses = poses_from_marks(marks_of(truth, 0.0, np.random.default_rng(0)), GEOMETRY)
    np.testing.assert_allclose(np.column_stack([poses.x_mm, poses.y_mm, poses.heading_rad]), truth, atol=1e-12)


def test_stated_covariance_is_the_scatter_of_the_poses() -> None:
    truth = np.tile([3.0, -2.0, 0.7], (4000, 1))
    poses = poses_from_marks(marks_of(truth, 0.01, np.random.default_rng(1)), GEOMETRY)
    scatter = np.cov(np.column_stack([poses.x_mm, poses.y_mm, poses.heading_rad]).T)
    np.testing.assert_allclose(poses.covariance.mean(axis=0), scatter, rtol=0.08, atol=0.02 * scatter.max())


def test_missing_mark_leaves_no_pose_but_a_reason() -> None:
    marks = marks_of(arc_poses(5.0, 90, 50), 0.01, np.random.default_rng(2))
    marks.loc[7, ["yellow_x_mm", "yellow_y_mm"]] = np.nan
    poses = poses_from_marks(marks, GEOMETRY)
    assert np.isnan(poses.x_mm[7])
    assert poses.status[7] == "yellow: absent"
    assert poses.measured.sum() == 49


def test_frame_with_a_wrong_mark_distance_is_refused() -> None:
    marks = marks_of(arc_poses(5.0, 90, 50), 0.01, np.random.default_rng(3))
    marks.loc[20, "green_y_mm"] += 0.5
    poses = poses_from_marks(marks, GEOMETRY)
    assert "mm apart" in poses.status[20]
    assert np.isnan(poses.heading_rad[20])


def test_scale_error_shows_in_the_spacing_ratio() -> None:
    marks = marks_of(arc_poses(5.0, 360, 400), 0.01, np.random.default_rng(4))
    marks.iloc[:, 1:] *= 1.04
    ratio, sigma = poses_from_marks(marks, GEOMETRY).spacing_ratio()
    assert abs(ratio - 1.04) < 4 * sigma < 0.002


def test_turns_made_during_a_gap_are_counted() -> None:
    time = np.arange(100) / 60
    heading = 0.3 * np.arange(100.0)
    broken = np.angle(np.exp(1j * heading))
    broken[40:70] = np.nan
    found = unwrapped_across_gaps(time, broken)
    np.testing.assert_allclose(found[70:], heading[70:], atol=1e-9)


@pytest.mark.parametrize("frames", [5, 400])
def test_systematic_part_is_the_change_of_pose_with_the_camera(frames: int) -> None:
    index, step = PARAMETERS.index("focal_px"), 0.1
    covariance = np.zeros((len(PARAMETERS), len(PARAMETERS)))
    covariance[index, index] = step**2
    exact = camera_above(size_px=(640, 480), focal_px=2000, distance_mm=150, k1=-0.1)
    camera = Camera(exact.size_px, exact.parameters, covariance=covariance)
    marks = marks_of(arc_poses(5.0, 180, frames), 0.0, np.random.default_rng(5))
    poses = poses_from_marks(marks, GEOMETRY, camera)
    assert poses.systematic is not None
    shift = np.zeros(len(PARAMETERS))
    shift[index] = step
    moved = Camera(camera.size_px, camera.parameters + shift)
    for name in ("green", "yellow"):
        points = np.column_stack([marks[[f"{name}_x_mm", f"{name}_y_mm"]], np.full(len(marks), 6.5)])
        columns = [f"{name}_x_mm", f"{name}_y_mm"]
        marks[columns] = moved.plate_from_image(camera.image_from_plate(points), 6.5)
    other = poses_from_marks(marks, GEOMETRY)
    shift, found = other.x_mm - poses.x_mm, poses.systematic[:, 0, 0]
    np.testing.assert_allclose(shift * np.sign(found[-1]) * np.sign(shift[-1]), found, atol=2e-3 * np.abs(shift).max())


def test_marks_seen_in_images_share_an_error_fixed_to_the_body() -> None:
    camera = camera_above(size_px=(640, 480), focal_px=2000, distance_mm=150)
    marks = marks_of(np.tile([1.0, 2.0, np.pi / 2], (50, 1)), 0.01, np.random.default_rng(6))
    for name in ("green", "yellow"):
        places = np.column_stack([marks[[f"{name}_x_mm", f"{name}_y_mm"]], np.full(len(marks), 6.5)])
        marks[f"{name}_x_px"], marks[f"{name}_y_px"] = camera.image_from_plate(places).T
    poses = poses_from_marks(marks, GEOMETRY, camera)
    assert poses.systematic is not None
    forward, left = poses.systematic[:, 1, 0], poses.systematic[:, 0, 1]  # of the green mark; the robot faces plate +y
    np.testing.assert_allclose(forward[0] / 0.01, 0.5 * 0.12, rtol=0.3)  # half of it, as the pose takes the mean
    assert left[0] < 0


def test_marks_at_one_place_are_refused() -> None:
    with pytest.raises(InputError, match="two different positions"):
        MarkGeometry((1.0, 1.0), (1.0, 1.0))
