"""The fit of a turn in closed form: curvature, centre, outliers, and the whitening of its channels."""

from __future__ import annotations

import numpy as np
import pytest

from evaluator.turning.measure import _path_rate
from evaluator.turning.motion.curvature import Curvature
from evaluator.turning.motion.fit import _channel_factor, _not_jumping, fit_turn, fit_turns, part, scaled_poses
from evaluator.turning.motion.steady_motion import linearised, moved

from .synthetic import matrix, winding_poses

LENGTH_MM = 1.7
Array = np.ndarray


def test_systematic_error_widens_the_bounds_of_a_curvature_in_quadrature() -> None:
    wide = Curvature(0.2, 0.1, 0.4, 0.05, 0.03).with_systematic(0.04)
    assert (wide.low, wide.high) == pytest.approx((0.2 - np.hypot(0.1, 1.96 * 0.04), 0.2 + np.hypot(0.2, 1.96 * 0.04)))
    assert (wide.sigma, wide.systematic) == pytest.approx((0.05, 0.05))


@pytest.mark.parametrize("sense", [1, -1])
def test_radius_is_the_inverse_of_the_curvature_and_its_bounds_change_places(sense: int) -> None:
    low, high = sorted((sense * 0.1, sense * 0.4))
    assert Curvature(sense * 0.2, low, high, 0.05).radius_mm() == pytest.approx((5.0, 2.5, 10.0))


@pytest.mark.parametrize(("low", "high", "straight"), [(-0.1, 0.1, True), (0.0, 0.1, True), (0.01, 0.1, False)])
def test_curvature_whose_bounds_hold_zero_has_no_radius(low: float, high: float, straight: bool) -> None:
    curvature = Curvature(0.05, low, high, 0.02)
    assert curvature.straight == straight
    assert np.isnan(curvature.radius_mm()).all() == straight


def correlated_poses(frames: int = 12) -> tuple[Array, Array]:
    """Poses and plate-frame covariances of marks whose quiet point lies at (-1.5, 0.4) of the body."""
    heading = np.linspace(0.3, 2.0, frames)
    arm = np.array([-1.5, 0.4])
    at_point = np.diag([4e-4, 4e-4, 1e-4])
    shift = np.eye(3)
    shift[0, 2], shift[1, 2] = arm[1], -arm[0]  # from the quiet point to the centre
    covariance = []
    for angle in heading:
        rotation = matrix(0, 0, angle)
        covariance.append(rotation @ shift @ at_point @ shift.T @ rotation.T)
    return np.column_stack([3 * np.sin(heading), -3 * np.cos(heading), heading]), np.array(covariance)


def test_quiet_point_is_the_one_whose_place_and_heading_err_apart() -> None:
    pose, covariance = correlated_poses()
    systematic = np.tile(np.array([[0.1], [0.0], [0.02]]), (12, 1, 1))
    scaled = scaled_poses(pose, covariance, systematic)
    np.testing.assert_allclose(scaled.offset_mm, [-1.5, 0.4], atol=1e-9)
    assert scaled.length_mm == pytest.approx(2.0)  # 0.02 mm over 0.01 rad
    assert scaled.sigma_mm == pytest.approx(0.02)
    np.testing.assert_allclose(scaled.covariance, np.tile(4e-4 * np.eye(3), (12, 1, 1)), atol=1e-12)
    arm = np.array([matrix(0, 0, angle)[:2, :2] @ [-1.5, 0.4] for angle in pose[:, 2]])
    np.testing.assert_allclose(scaled.pose, np.column_stack([pose[:, :2] + arm, pose[:, 2]]))
    assert scaled.systematic is not None
    angle = pose[0, 2]
    moved_by = np.array([0.1, 0.0]) + 0.02 * np.array([-arm[0, 1], arm[0, 0]])
    body = matrix(0, 0, angle)[:2, :2].T @ moved_by
    np.testing.assert_allclose(scaled.systematic[0, :, 0], [*body, 2.0 * 0.02], atol=1e-12)
    np.testing.assert_array_equal(part(scaled, pose[:, 2] > 1).pose, scaled.pose[pose[:, 2] > 1])


@pytest.mark.parametrize("way", [1, -1])
def test_fit_to_exact_poses_gives_the_twist_of_any_point_and_the_centre_of_rotation(way: int) -> None:
    heading = np.linspace(0.3, 2.0, 60)[::way]
    pose = np.column_stack([1 + 3 * np.sin(heading - 0.1), 2 - 3 * np.cos(heading - 0.1), heading])
    _, covariance = correlated_poses(60)
    fit = fit_turn(np.arange(60) / 50, scaled_poses(pose, covariance[::way]))
    centre = fit.body_twist(np.zeros(2))
    assert centre[:2] / centre[2] == pytest.approx(3 * np.array([np.cos(0.1), -np.sin(0.1)]), rel=1e-6)
    assert np.sign(centre[2]) == way
    mark = fit.body_twist(np.array([-1.5, 1.8]))
    assert mark[:2] - centre[:2] == pytest.approx(centre[2] * np.array([-1.8, -1.5]), rel=1e-6)
    place, spread = fit.center_mm()
    assert place == pytest.approx([1.0, 2.0], abs=1e-6)
    assert np.linalg.eigvalsh(spread).min() > -1e-15
    assert fit.curvature().value == pytest.approx(way / 3, rel=1e-6)  # backward the way turns clockwise
    assert fit.ahead == np.sign(fit.motion.along_mm[-1] - fit.motion.along_mm[0])


@pytest.mark.parametrize("way", [1, -1])
def test_path_parameter_grows_with_the_speed_of_the_scaled_pose_and_follows_the_fitted_motion(way: int) -> None:
    """1.7 rad in 59 frames of 50 a second, of a quiet point 3.4 mm from the centre of rotation."""
    heading, time = np.linspace(0.3, 2.0, 60)[::way], np.arange(60) / 50
    pose = np.column_stack([3 * np.sin(heading), -3 * np.cos(heading), heading])
    _, covariance = correlated_poses(60)
    scaled = scaled_poses(pose, covariance[::way])
    fit, stretched = fit_turn(time, scaled), scaled.pose * [1.0, 1.0, scaled.length_mm]
    rate = _path_rate(fit, time, scaled)
    yaw_rate = 1.7 / (59 / 50)
    from_centre = np.hypot(1.5, 3 - 0.4)
    assert rate.value == pytest.approx(yaw_rate * np.hypot(from_centre, scaled.length_mm), rel=1e-6)
    assert rate.sigma < 1e-6
    for step, slope in zip(1e-4 * np.eye(4), rate.gradient, strict=True):
        ahead, behind = (
            np.polyfit(
                time, linearised(stretched, *moved(fit.motion, s), fit.motion.along_mm, scaled.length_mm).along_mm, 1
            )
            for s in (step, -step)
        )
        assert slope == pytest.approx(fit.ahead * (ahead[0] - behind[0]) / 2e-4, rel=1e-3, abs=1e-6)
    assert np.abs(rate.gradient).max() > 0.1


def test_frames_that_jump_are_rejected_and_a_slow_bend_is_not() -> None:
    rng = np.random.default_rng(6)
    heading = np.linspace(0, 2.0, 200)
    pose = np.column_stack([3 * np.sin(heading), -3 * np.cos(heading), heading]) + 1e-3 * rng.normal(size=(200, 3))
    pose[90:93, 0] += 0.5
    fit = fit_turn(np.arange(200) / 50, scaled_poses(pose, np.tile(1e-6 * np.eye(3), (200, 1, 1))))
    assert np.flatnonzero(~fit.used).tolist() == [90, 91, 92]
    assert fit.curvature().low < 1 / 3 < fit.curvature().high


@pytest.mark.parametrize(
    ("frames", "lasting", "is_jump"), [(12, 3, True), (12, 4, False), (200, 15, True), (200, 16, False)]
)
def test_what_lasts_for_half_of_the_neighbours_is_motion_and_no_jump(frames: int, lasting: int, is_jump: bool) -> None:
    """Neighbours are 31 frames, of a short piece half of its frames and one."""
    standard = 1e-3 * np.random.default_rng(9).normal(size=(frames, 2))
    off = np.arange(frames // 2, frames // 2 + lasting)
    standard[off] += 1.0
    assert (~_not_jumping(standard)[off]).all() == is_jump


def test_pieces_of_a_clothoid_have_the_mean_curvature_of_their_path_and_say_how_far_it_changes() -> None:
    curvature = np.linspace(0.2, 0.3, 3000)
    pose = winding_poses(curvature, 0.002, slip_rad=0.0)[::10]
    pose = pose + 1e-6 * np.random.default_rng(7).normal(size=pose.shape)
    scaled = scaled_poses(pose, np.tile(1e-12 * np.eye(3), (300, 1, 1)))
    (fit,) = fit_turns(np.arange(300) / 50, scaled, [np.ones(300, dtype=bool)], bending=True)
    assert fit.curvature().value == pytest.approx(0.25, rel=1.5e-3)
    # The even change of 0.1/mm over a path of 6 mm: half of it to either side, times the length.
    assert abs(fit.change_rad[0]) == pytest.approx(0.05 * 6.0, rel=0.02)
    assert abs(fit.change_rad[1]) < 0.01


def test_channel_factor_makes_residuals_white_with_two_degrees_of_freedom_for_each_stretch() -> None:
    rng = np.random.default_rng(8)
    parts = [rng.normal(size=(30, 2)) @ [[2.0, 0.5], [0.0, 0.3]] for _ in range(3)]
    factor = _channel_factor(parts)
    values = np.concatenate(parts) @ factor.T
    np.testing.assert_allclose(values.T @ values / (90 - 6), np.eye(2), atol=2e-4)
    exact = [np.column_stack([part[:, 0], 0 * part[:, 0]]) for part in parts]
    weight = _channel_factor(exact)[1, 1]
    assert weight**-2 == pytest.approx(1e-6 * np.trace(np.concatenate(exact).T @ np.concatenate(exact)) / 84)
