"""The algebra of steady motion and of its noise against plain linear algebra: exponentials and dense matrices."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from scipy.linalg import expm

from evaluator.turning.motion.fit import Curvature, _channel_factor, fit_turn, fit_turns, part, scaled_poses
from evaluator.turning.motion.least_squares import (
    CORRELATIONS,
    Averaged,
    Block,
    NoiseModel,
    averaged_least_squares,
    averaged_over_blocks,
    noise_models,
    responses,
)
from evaluator.turning.motion.steady_motion import bend_design, fit_steady_motion, linearised, moved
from evaluator.turning.motion.subgroup import composed
from evaluator.turning.motion.whitening import whitened_moments

from .synthetic import winding_poses

LENGTH_MM = 1.7
Array = np.ndarray


def matrix(x: float, y: float, angle: float) -> Array:
    """Rigid motion as a matrix, (3, 3)."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[cos, -sin, x], [sin, cos, y], [0, 0, 1.0]])


def after(start: Array, twist: Array) -> Array:
    """Pose start · exp(twist) by the matrix exponential, third coordinate length · heading."""
    algebra = np.array([[0, -twist[2] / LENGTH_MM, twist[0]], [twist[2] / LENGTH_MM, 0, twist[1]], [0, 0, 0]])
    result = matrix(start[0], start[1], start[2] / LENGTH_MM) @ expm(algebra)
    return np.array([result[0, 2], result[1, 2], start[2] + twist[2]])


@pytest.mark.parametrize("angle", [0.0, 1e-4, 0.049, 0.051, -0.049, -2.0, 7.0])
def test_motion_along_a_twist_is_its_matrix_exponential(angle: float) -> None:
    start, twist = np.array([0.3, -1.2, 0.8]), np.array([1.5, -0.4, angle * LENGTH_MM])
    found = composed(start, *twist, LENGTH_MM)
    np.testing.assert_allclose(found, after(start, twist), rtol=1e-11, atol=1e-11)


def on_a_motion(twist: Array, along: Array, off: Array | None = None) -> Array:
    """Scaled poses (n, 3) along a motion from (0.5, -0.2, 0.4), moved across it by `off` in the body frame."""
    poses = np.array([after(np.array([0.5, -0.2, 0.4]), t * twist) for t in along])
    if off is None:
        return poses
    cos, sin = np.cos(poses[:, 2] / LENGTH_MM), np.sin(poses[:, 2] / LENGTH_MM)
    shift = np.column_stack([cos * off[:, 0] - sin * off[:, 1], sin * off[:, 0] + cos * off[:, 1], off[:, 2]])
    return np.asarray(poses + shift)


TWISTS = [(0.9, 0.1, 0.3), (0.2, -0.1, -0.9), (1.0, 0.0, 0.0), (0.999, 0.02, 0.01)]


@pytest.mark.parametrize("twist", TWISTS)
def test_derivatives_of_the_closest_points_are_those_of_finite_differences(twist: tuple[float, ...]) -> None:
    way = np.array(twist) / np.linalg.norm(twist)
    along = np.linspace(-3, 4, 9)
    rng = np.random.default_rng(0)
    scaled = on_a_motion(way, along, 1e-9 * rng.normal(size=(9, 3)))
    start = np.array([0.5, -0.2, 0.4])
    motion = linearised(scaled, start, way, along + 0.01, LENGTH_MM)
    np.testing.assert_allclose(motion.along_mm, along, atol=1e-6)
    np.testing.assert_allclose(motion.across.T @ np.column_stack([motion.across, way]), np.eye(2, 3), atol=1e-12)
    delta = 1e-6
    for column in range(4):
        sides = []
        for sign in (1, -1):
            step = np.zeros(4)
            step[column] = sign * delta
            moved_start, moved_twist = moved(motion, step)
            assert np.linalg.norm(moved_twist) == pytest.approx(1.0)
            np.testing.assert_allclose(moved_start, after(start, motion.across @ step[:2]), atol=1e-9)
            predicted = np.array([after(moved_start, t * moved_twist) for t in motion.along_mm])
            cos, sin = np.cos(scaled[:, 2] / LENGTH_MM), np.sin(scaled[:, 2] / LENGTH_MM)
            apart = predicted - scaled
            body = np.column_stack(
                [cos * apart[:, 0] + sin * apart[:, 1], cos * apart[:, 1] - sin * apart[:, 0], apart[:, 2]]
            )
            sides.append(body @ motion.across)
        np.testing.assert_allclose(motion.design[:, :, column], (sides[0] - sides[1]) / (2 * delta), atol=1e-6)


def test_deviation_across_the_motion_is_measured_less_predicted() -> None:
    way = np.array([0.9, 0.1, 0.3]) / np.linalg.norm([0.9, 0.1, 0.3])
    off = np.tile([0.0, 1e-4, 0.0], (5, 1))
    motion = linearised(
        on_a_motion(way, np.arange(5.0), off), np.array([0.5, -0.2, 0.4]), way, np.arange(5.0), LENGTH_MM
    )
    np.testing.assert_allclose(motion.residual_mm, off @ motion.across, atol=1e-7)
    assert motion.turn_rad == pytest.approx(4 * way[2] / LENGTH_MM, rel=1e-4)


@pytest.mark.parametrize("twist", [*TWISTS, (-0.9, 0.1, 0.3), (0.0, 0.0, 1.0)])
@pytest.mark.parametrize("reach", [0.2, 6.0])
def test_exact_motion_is_found_from_any_start_forward_backward_and_on_the_spot(
    twist: tuple[float, ...], reach: float
) -> None:
    way = np.array(twist) / np.linalg.norm(twist)
    scaled = on_a_motion(way, np.linspace(0, reach, 40))
    pose = scaled / np.array([1, 1, LENGTH_MM])
    motion = fit_steady_motion(pose, LENGTH_MM, np.broadcast_to(np.eye(2), (40, 2, 2)).copy())
    np.testing.assert_allclose(motion.residual_mm, 0, atol=1e-9)
    np.testing.assert_allclose(motion.twist * np.sign(motion.along_mm[-1] - motion.along_mm[0]), way, atol=1e-6)


def test_frames_of_no_weight_do_not_move_the_fit_and_heavier_ones_move_it_more() -> None:
    way = np.array([0.9, 0.1, 0.3]) / np.linalg.norm([0.9, 0.1, 0.3])
    off = np.zeros((40, 3))
    off[10] = [0.0, 0.5, 0.0]
    pose = on_a_motion(way, np.linspace(0, 6, 40), off) / np.array([1, 1, LENGTH_MM])
    left = []
    for share in (0.0, 1.0, 50.0):
        weight = np.broadcast_to(np.eye(2), (40, 2, 2)).copy()
        weight[10] *= share
        motion = fit_steady_motion(pose, LENGTH_MM, weight)
        left.append(np.abs(np.delete(motion.residual_mm, 10, axis=0)).max())
    assert left[0] < 1e-9 < left[1] < left[2]


@pytest.mark.parametrize("offset", [(0.0, 0.0), (-1.55, 0.4)])
@pytest.mark.parametrize("mean", [0.2, -0.05, 0.0])
def test_bend_is_the_change_of_pose_by_a_change_of_curvature_along_the_path(
    offset: tuple[float, float], mean: float
) -> None:
    """Paths of curvature mean ± a·P(s), integrated in fine steps, against the first derivative."""
    step, size = 0.002, 1e-5
    length = step * np.arange(4001)
    share = 2 * length / length[-1] - 1
    place = np.array(offset)

    def poses(curvature: Array) -> Array:
        pose = winding_poses(curvature, step, slip_rad=0.0)
        cos, sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        moved_to = pose[:, :2] + np.column_stack([cos * place[0] - sin * place[1], sin * place[0] + cos * place[1]])
        return np.column_stack([moved_to, LENGTH_MM * pose[:, 2]])[::100]

    steady = poses(np.full(4001, mean))
    twist = np.array([1.0 - mean * place[1], mean * place[0], LENGTH_MM * mean])  # per length of path of the centre
    norm = np.linalg.norm(twist)
    motion = linearised(steady, steady[0], twist / norm, norm * length[::100], LENGTH_MM)
    design = bend_design(motion, place)
    for column, bend in enumerate((share, (3 * share**2 - 1) / 2)):
        # Per mm of the parameter, which is `norm` times the path of the centre.
        changed = (poses(mean + size * norm * bend) - poses(mean - size * norm * bend)) / (2 * size)
        cos, sin = np.cos(steady[:, 2] / LENGTH_MM), np.sin(steady[:, 2] / LENGTH_MM)
        body = np.column_stack(
            [cos * changed[:, 0] + sin * changed[:, 1], cos * changed[:, 1] - sin * changed[:, 0], changed[:, 2]]
        )
        np.testing.assert_allclose(design[:, :, column], body @ motion.across, atol=0.02 * np.abs(body).max())


MODELS = [(0.0, 0.0), (0.7, 0.0), (-0.3, 0.0), (0.9, 0.5), (0.95, 0.85)]


def dense(time: Array, heading: Array, correlation: float, white: float) -> Array:
    """Covariance of the noise: of a process that turns with the picture, the component along a body's axis is seen."""
    apart, turned = np.abs(time[:, None] - time), heading[:, None] - heading
    fade = np.where(apart == 0, 1.0, np.sign(correlation) ** apart * abs(correlation) ** apart)
    return np.asarray((1 - white) * fade * np.cos(turned) + white * np.eye(len(time)))


@pytest.mark.parametrize(("correlation", "white", "turning"), [*((*m, False) for m in MODELS), (0.9, 0.5, True)])
def test_whitened_moments_are_those_of_the_dense_covariance(correlation: float, white: float, turning: bool) -> None:
    """Noise fixed to the picture: channels are the components of one process in space along the turning axes."""
    rng = np.random.default_rng(1)
    time = np.cumsum([0, 1, 1, 3, 1, 2, 1, 1, 4, 1.0])
    heading = np.cumsum(rng.uniform(-0.5, 0.8, 10)) if turning else np.zeros(10)
    data = rng.normal(size=(10, 2, 3))
    covariance = dense(time, heading, correlation, white)
    inverse = np.linalg.inv(covariance)
    moments, log = whitened_moments(np.diff(time), np.diff(heading), data, correlation, white)
    np.testing.assert_allclose(moments, sum(data[:, c].T @ inverse @ data[:, c] for c in range(2)), rtol=1e-9)
    assert log == pytest.approx(np.linalg.slogdet(covariance)[1])  # half of it, of two channels


def test_average_over_models_is_that_of_dense_restricted_likelihoods() -> None:
    """Harville (1977) with the scale at its estimate, under every model, with flat priors within each kind."""
    rng = np.random.default_rng(2)
    time, heading = np.arange(60.0), np.linspace(0, 3, 60)
    design, value = rng.normal(size=(60, 1, 2)), np.cumsum(rng.normal(size=(60, 1)), axis=0)
    found = averaged_least_squares(Block(time, heading, value, design))
    kinds = [(model.white_share, model.in_picture) for model in found.models]
    logs, estimates, scales = [], [], []
    for model, kind in zip(found.models, kinds, strict=True):
        covariance = dense(time, heading if model.in_picture else 0 * heading, model.correlation, model.white_share)
        inverse = np.linalg.inv(covariance)
        normal = design[:, 0].T @ inverse @ design[:, 0]
        estimate = np.linalg.solve(normal, design[:, 0].T @ inverse @ value[:, 0])
        rest = value[:, 0] - design[:, 0] @ estimate
        squares = rest @ inverse @ rest
        prior = {0.0: 0.8, 0.5: 0.1, 0.85: 0.1}[kind[0]] / kinds.count(kind)
        halves = np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(normal)[1] + 58 * np.log(squares)
        logs.append(np.log(prior) - halves / 2)
        estimates.append(estimate)
        scales.append(squares / 58 * np.linalg.inv(normal))
    weight = np.exp(np.array(logs) - max(logs))
    np.testing.assert_allclose(found.weight, weight / weight.sum(), rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(found.estimate, estimates, rtol=1e-6)
    np.testing.assert_allclose(found.covariance, scales, rtol=1e-6)
    assert found.freedom == 58


def test_quantiles_of_a_single_model_are_those_of_student() -> None:
    scale = np.array([[2.0, 0.3], [0.3, 1.0]])
    one = Averaged(
        (NoiseModel(0, 0, in_picture=False),), np.ones(1), np.array([[1.0, 2.0]]), scale[None], np.ones(1), 4
    )
    way = np.array([1.0, -2.0])
    reach = stats.t.ppf(0.975, 4) * np.sqrt(way @ scale @ way)
    assert one.quantiles(way, (0.025, 0.975)) == pytest.approx((-3 - reach, -3 + reach))
    np.testing.assert_allclose(one.spread(), 2 * scale)  # of 4 degrees of freedom: 4 / (4 - 2)


def test_blocks_share_their_noise_and_keep_their_own_parameters() -> None:
    rng = np.random.default_rng(3)
    blocks = tuple(
        Block(np.arange(40.0), np.zeros(40), shift + size * rng.normal(size=(40, 1)), np.ones((40, 1, 1)))
        for shift, size in ((1.0, 0.1), (5.0, 0.3))
    )
    one, other = averaged_over_blocks(blocks)
    assert one.freedom == 78
    np.testing.assert_allclose(one.scale, other.scale)
    assert one.mean()[0] == pytest.approx(1.0, abs=0.15)
    assert other.mean()[0] == pytest.approx(5.0, abs=0.15)
    np.testing.assert_allclose(one.covariance, other.covariance)
    assert one.scale[0] == pytest.approx(np.sqrt((0.01 + 0.09) / 2), rel=0.2)


@pytest.mark.parametrize("correlation", [0.0, 0.6, 0.95])
def test_correlation_of_the_noise_is_found_and_widens_the_error_of_a_mean(correlation: float) -> None:
    rng = np.random.default_rng(4)
    noise = rng.normal(size=(1500, 1))
    for row in range(1, 1500):
        noise[row] = correlation * noise[row - 1] + np.sqrt(1 - correlation**2) * noise[row]
    found = averaged_least_squares(Block(np.arange(1500.0), np.zeros(1500), noise, np.ones((1500, 1, 1))))
    assert found.correlation() == pytest.approx(correlation, abs=0.05)
    widened = np.sqrt((1 + correlation) / (1 - correlation))
    assert np.sqrt(found.spread()[0, 0]) == pytest.approx(widened / np.sqrt(1500), rel=0.3)


def test_more_parameters_than_data_are_refused() -> None:
    block = Block(np.arange(2.0), np.zeros(2), np.zeros((2, 1)), np.ones((2, 1, 2)))
    with pytest.raises(ValueError, match="more parameters"):
        averaged_least_squares(block)


def test_models_of_noise_are_those_that_the_run_is_long_enough_and_turns_enough_to_show() -> None:
    assert noise_models(0.0, 1.0) == (NoiseModel(0.0, 0.0, in_picture=False), *noise_models(0.0, 1.0)[1:])
    short, long = (max(m.correlation for m in noise_models(0.0, frames)) for frames in (40, 4000))
    assert short == max(CORRELATIONS[np.exp(-4 / 40) >= CORRELATIONS])  # four correlation times fit into the run
    assert long == CORRELATIONS[-1]
    noisy = [m.correlation for m in noise_models(0.0, 100.0) if m.white_share == 0.5]
    assert max(noisy) == max(CORRELATIONS[np.exp(-10 / 100) >= CORRELATIONS])  # ten, under white noise
    assert min(abs(np.array(noisy))) > 0.2
    assert not any(m.in_picture for m in noise_models(1.9, 100.0))
    assert any(m.in_picture for m in noise_models(2.1, 100.0))


def test_mixture_of_models_has_the_mean_spread_and_quantiles_of_a_mixture() -> None:
    models = (NoiseModel(0.0, 0.0, in_picture=False), NoiseModel(0.8, 0.5, in_picture=False))
    mixed = Averaged(
        models, np.array([0.25, 0.75]), np.array([[0.0], [4.0]]), np.array([[[1.0]], [[4.0]]]), np.ones(2), 10.0
    )
    assert mixed.best == 1
    assert mixed.correlation() == pytest.approx(0.75 * 0.8 * 0.5)
    assert mixed.mean()[0] == pytest.approx(3.0)
    assert mixed.spread()[0, 0] == pytest.approx(10 / 8 * (0.25 * 1 + 0.75 * 4) + 0.25 * 9 + 0.75 * 1)
    for level in (0.025, 0.5, 0.975):
        (at,) = mixed.quantiles(np.ones(1), (level,))
        below = 0.25 * stats.t.cdf(at, 10) + 0.75 * stats.t.cdf((at - 4) / 2, 10)
        assert below == pytest.approx(level, abs=1e-6)


def test_response_to_a_shift_along_a_parameter_is_that_parameter() -> None:
    rng = np.random.default_rng(5)
    design = rng.normal(size=(60, 2, 3))
    block = Block(np.arange(60.0), np.zeros(60), rng.normal(size=(60, 2)), design)
    averaged = averaged_least_squares(block)
    shifts = np.array([[1.0, 0.0], [-2.0, 0.5], [0.0, 3.0]])
    np.testing.assert_allclose(responses(averaged, block, design @ shifts), shifts, atol=1e-9)


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


def test_frames_that_jump_are_set_aside_and_a_slow_bend_is_not() -> None:
    rng = np.random.default_rng(6)
    heading = np.linspace(0, 2.0, 200)
    pose = np.column_stack([3 * np.sin(heading), -3 * np.cos(heading), heading]) + 1e-3 * rng.normal(size=(200, 3))
    pose[90:93, 0] += 0.5
    fit = fit_turn(np.arange(200) / 50, scaled_poses(pose, np.tile(1e-6 * np.eye(3), (200, 1, 1))))
    assert np.flatnonzero(~fit.used).tolist() == [90, 91, 92]
    assert fit.curvature().low < 1 / 3 < fit.curvature().high


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
