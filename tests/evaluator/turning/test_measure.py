from __future__ import annotations

import numpy as np
import pytest

from calibration.camera import PARAMETERS, Camera, camera_above
from evaluator.mark_geometry import MarkGeometry
from evaluator.pose import Poses, poses_from_marks
from evaluator.turning import measure_turning

from .synthetic import FRAME_S, GEOMETRY, arc_poses, marks_of, resting, straight_poses


def posed(poses: np.ndarray, sigma_mm: float, seed: int, correlation: float = 0.0) -> Poses:
    return poses_from_marks(marks_of(poses, sigma_mm, np.random.default_rng(seed), correlation), GEOMETRY)


@pytest.mark.parametrize("radius_mm", [2.5, -5.0, 20.0, 100.0])
def test_noise_free_circle_is_measured_exactly(radius_mm: float) -> None:
    turning = measure_turning(posed(arc_poses(radius_mm, 120, 200), 0.0, 0))
    assert turning.radius_status == "ok"
    assert turning.radius_mm == pytest.approx(abs(radius_mm), rel=1e-6)
    assert turning.curvature_per_mm == pytest.approx(1 / radius_mm, rel=1e-6)
    assert (turning.center_x_mm, turning.center_y_mm) == pytest.approx((0.0, radius_mm), abs=1e-4)
    assert turning.body_slip_angle_deg == pytest.approx(np.degrees(0.1), abs=1e-3)


def test_speeds_of_centre_and_marks_follow_from_one_motion() -> None:
    turning = measure_turning(posed(arc_poses(5.0, 360, 361), 0.0, 0))
    rate = np.radians(1.0) / FRAME_S
    assert turning.yaw_rate_deg_s == pytest.approx(60.0, rel=1e-5)
    assert turning.speed_mm_s == pytest.approx(5.0 * rate, rel=1e-5)
    for place, speed in (
        (GEOMETRY.green_mm, turning.green_speed_mm_s),
        (GEOMETRY.yellow_mm, turning.yellow_speed_mm_s),
    ):
        arm = np.array(place) - np.array([-5.0 * np.sin(0.1), 5.0 * np.cos(0.1)])
        assert speed == pytest.approx(np.linalg.norm(arm) * rate, rel=1e-4)


def test_backward_motion_has_negative_speed_and_the_same_radius() -> None:
    turning = measure_turning(posed(arc_poses(5.0, 360, 361)[::-1], 0.0, 0))
    assert turning.speed_mm_s < 0
    assert turning.yaw_rate_deg_s < 0
    assert turning.radius_mm == pytest.approx(5.0, rel=1e-6)


def test_straight_run_has_a_curvature_interval_and_no_radius() -> None:
    turning = measure_turning(posed(straight_poses(50.0, 300), 0.01, 1))
    assert turning.radius_status.startswith("straight: curvature")
    assert np.isnan(turning.radius_mm)
    assert turning.curvature_low_per_mm < 0 < turning.curvature_high_per_mm
    assert turning.curvature_high_per_mm - turning.curvature_low_per_mm < 1e-4


def test_robot_that_rests_is_said_to_rest() -> None:
    turning = measure_turning(posed(np.tile([1.0, 2.0, 0.3], (200, 1)), 0.01, 2))
    assert turning.radius_status.startswith("at rest")


def test_rest_before_and_after_is_left_out() -> None:
    turning = measure_turning(posed(resting(arc_poses(5.0, 360, 300), 60, 60), 0.01, 3), start_s=0.5)
    assert turning.start_s == pytest.approx(1.0, abs=2 * FRAME_S)
    assert turning.start_delay_s == pytest.approx(0.5, abs=2 * FRAME_S)
    assert turning.stop_s == pytest.approx(6.0, abs=2 * FRAME_S)
    assert turning.radius_low_mm < 5.0 < turning.radius_high_mm


def test_wild_frames_are_rejected_and_counted() -> None:
    poses = posed(arc_poses(5.0, 360, 300), 0.01, 4)
    x = np.array(poses.x_mm)
    x[140:150] += 0.4
    wild = Poses(poses.time_s, x, poses.y_mm, poses.heading_rad, poses.covariance, poses.status, geometry=GEOMETRY)
    turning = measure_turning(wild)
    assert turning.radius_mm == pytest.approx(5.0, rel=1e-3)
    assert turning.share_used < 0.985


@pytest.mark.parametrize(
    ("radius_mm", "turned_deg", "frames", "sigma_mm", "correlation"),
    [
        pytest.param(5.0, 80, 120, 0.01, 0.0, marks=pytest.mark.exam),
        (5.0, 180, 120, 0.01, 0.8),
        pytest.param(100.0, 15, 120, 0.01, 0.0, marks=pytest.mark.exam),
    ],
)
def test_interval_holds_the_radius_as_often_as_it_says(
    radius_mm: float, turned_deg: float, frames: int, sigma_mm: float, correlation: float
) -> None:
    runs = [
        measure_turning(posed(arc_poses(radius_mm, turned_deg, frames), sigma_mm, seed, correlation))
        for seed in range(30)
    ]
    held = sum(run.radius_low_mm <= radius_mm <= run.radius_high_mm for run in runs)
    assert held >= 24  # binomial (30, 0.95): below once in 1,700
    assert abs(np.mean([run.radius_mm for run in runs]) / radius_mm - 1) < 0.003


def test_row_has_the_columns_of_turning_csv() -> None:
    row = measure_turning(posed(arc_poses(5.0, 360, 100), 0.01, 5)).to_row()
    wanted = {
        *("radius_mm", "radius_low_mm", "radius_high_mm", "radius_status", "steady_radius_mm"),
        *("speed_mm_s", "green_speed_mm_s", "yellow_speed_mm_s", "yaw_rate_deg_s"),
        *("center_x_mm", "center_y_mm", "share_used"),
    }
    assert wanted <= set(row)


def test_camera_error_moves_the_radius_as_far_as_the_systematic_part_says() -> None:
    """Each parameter is moved by its standard deviation, and the whole measurement repeated."""
    exact = camera_above(size_px=(640, 480), focal_px=2400, distance_mm=150, tilt_deg=4, k1=-0.1)
    sigma = {"focal_px": 3.0, "translation_z_mm": 0.1, "rotation_x": 2e-4, "k1": 0.01, "principal_x_px": 2.0}
    covariance = np.zeros((len(PARAMETERS), len(PARAMETERS)))
    for name, value in sigma.items():
        covariance[PARAMETERS.index(name), PARAMETERS.index(name)] = value**2
    camera = Camera(exact.size_px, exact.parameters, covariance=covariance)
    marks = marks_of(arc_poses(5.0, 300, 300), 0.005, np.random.default_rng(6))
    turning = measure_turning(poses_from_marks(marks, GEOMETRY, camera))
    shifts = []
    for name, value in sigma.items():
        changed = np.array(camera.parameters)
        changed[PARAMETERS.index(name)] += value
        moved = marks.copy()
        for mark in ("green", "yellow"):
            columns = [f"{mark}_x_mm", f"{mark}_y_mm"]
            places = np.column_stack([marks[columns], np.full(len(marks), 6.5)])
            moved[columns] = Camera(exact.size_px, changed).plate_from_image(camera.image_from_plate(places), 6.5)
        shifts.append(measure_turning(poses_from_marks(moved, GEOMETRY)).radius_mm - turning.radius_mm)
    assert turning.radius_systematic_mm == pytest.approx(np.linalg.norm(shifts), rel=0.03)
    assert turning.radius_high_mm - turning.radius_low_mm == pytest.approx(
        2 * 1.96 * np.hypot(turning.radius_random_mm, turning.radius_systematic_mm), rel=0.05
    )


def test_more_frames_reduce_the_random_part_only() -> None:
    camera = camera_above(size_px=(640, 480), focal_px=2400, distance_mm=150)
    covariance = np.zeros((len(PARAMETERS), len(PARAMETERS)))
    covariance[PARAMETERS.index("focal_px"), PARAMETERS.index("focal_px")] = 3.0**2
    camera = Camera(camera.size_px, camera.parameters, covariance=covariance)
    few, many = (
        measure_turning(
            poses_from_marks(marks_of(arc_poses(5.0, 300, frames), 0.005, np.random.default_rng(7)), GEOMETRY, camera)
        )
        for frames in (150, 1200)
    )
    assert many.radius_random_mm == pytest.approx(few.radius_random_mm / np.sqrt(8), rel=0.15)
    assert many.radius_systematic_mm == pytest.approx(few.radius_systematic_mm, rel=0.02)
    # The circle of the marks scales with the camera; the 1.55 mm from there to the centre do not.
    assert many.radius_systematic_mm == pytest.approx(5.0 * 3.0 / 2400, rel=0.05)


@pytest.mark.parametrize("radius_mm", [5.0, 0.05])
def test_marks_known_to_a_tolerance_give_uncertainties_that_are_the_scatter_over_robots(radius_mm: float) -> None:
    """Marks of each robot are elsewhere than its file says; noise is small. The last turns nearly on the spot."""
    rng, sigma = np.random.default_rng(8), 0.05
    poses = arc_poses(radius_mm, 170, 120)
    turns = []
    for seed in range(30):
        said = {
            name: tuple(np.array(getattr(GEOMETRY, f"{name}_mm")) + sigma * rng.normal(size=2))
            for name in ("green", "yellow")
        }
        marks = marks_of(poses, 0.001, np.random.default_rng(seed))
        turns.append(measure_turning(poses_from_marks(marks, MarkGeometry(said, place_sigma_mm=sigma))))
    held = [turn.radius_low_mm <= abs(radius_mm) <= turn.radius_high_mm for turn in turns]
    assert sum(held) >= 26  # 28.5 expected; fewer by chance once in 60
    if radius_mm > 1:
        for name in ("speed_mm_s", "yaw_rate_deg_s", "body_slip_angle_deg"):
            scatter = np.std([getattr(turn, name) for turn in turns])
            unit = name[name.rindex("_deg") if "_deg" in name else name.index("_mm") :]
            stated = np.mean([getattr(turn, f"{name.removesuffix(unit)}_sigma{unit}") for turn in turns])
            assert stated == pytest.approx(scatter, rel=0.4), name  # three standard errors
    small = measure_turning(posed(poses, 0.001, 0))  # marks that are where they are said to be
    assert turns[0].radius_random_mm == pytest.approx(small.radius_random_mm, rel=0.5)
    if abs(radius_mm) > 1:
        assert small.radius_systematic_mm == 0.0 < turns[0].radius_systematic_mm
