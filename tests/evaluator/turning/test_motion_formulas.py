"""The algebra of steady motion against plain linear algebra: exponentials and finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from evaluator.turning.motion.steady_motion import (
    _first_along,
    _first_guess,
    bend_design,
    fit_steady_motion,
    linearised,
    moved,
)
from evaluator.turning.motion.subgroup import composed

from .synthetic import matrix, winding_poses

LENGTH_MM = 1.7
Array = np.ndarray


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


@pytest.mark.parametrize(
    ("twist", "turned", "known_to"),
    [
        ((0.9, 0.1, 0.3), 2.0, 1e-9),
        ((-0.2, 0.1, -0.9), -2.0, 1e-9),
        ((0.0, 0.0, 1.0), 2.0, 1e-9),
        ((0.8, -0.6, 0.0), 0.0, 1e-9),
        ((0.0, 0.0, -1.0), -0.2, 1e-9),
        ((0.6, 0.4, 0.5), 0.2, 0.02),  # as a line: to first order in the angle turned
        ((0.9, 0.1, 0.3), 0.5, 0.05),
    ],
)
def test_fit_begins_with_the_exact_motion_of_a_turn_a_line_or_a_small_turn_on_the_spot(
    twist: tuple[float, ...], turned: float, known_to: float
) -> None:
    """Frames without a weight take no part, however far off they lie."""
    way = np.array(twist) / np.linalg.norm(twist)
    along = np.linspace(0, turned * LENGTH_MM / way[2] if turned else 5.0, 41)
    scaled = on_a_motion(way, along)
    scaled[7] += [3.0, -2.0, 1.0]
    used = np.arange(41) != 7
    start, found = _first_guess(scaled, LENGTH_MM, used)
    np.testing.assert_allclose(found, way, atol=known_to)
    parameter = _first_along(scaled, start, found, LENGTH_MM)
    reach = float(np.ptp(along))
    np.testing.assert_allclose(np.diff(parameter[8:]), np.diff(along[8:]), atol=known_to * reach / 10)
    on_it = np.array([after(start, t * found) for t in parameter[8:]])
    np.testing.assert_allclose(on_it, scaled[8:], atol=known_to * reach)


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
