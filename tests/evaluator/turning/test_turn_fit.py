"""What a fitted turn says of curvature and centre, and where a fit begins."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from evaluator.turning.motion.fit import TurnFit, _not_jumping
from evaluator.turning.motion.least_squares import Averaged, NoiseModel
from evaluator.turning.motion.steady_motion import _first_along, _first_guess, linearised
from evaluator.turning.motion.subgroup import _ratios

LENGTH_MM = 1.7
START = np.array([0.5, -0.2, 0.4])


def exact(twist: tuple[float, float, float], reach: float, frames: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """Scaled poses along a motion, and its unit twist."""
    way = np.array(twist) / np.linalg.norm(twist)
    along = np.linspace(0, reach, frames)
    motion = linearised(np.tile(START, (frames, 1)), START, way, along, LENGTH_MM)
    from evaluator.turning.motion.subgroup import composed

    return np.array([composed(START, *(t * way), LENGTH_MM) for t in along]), motion.twist


@pytest.mark.parametrize("twist", [(0.9, 0.1, 0.3), (-0.9, 0.1, 0.3), (0.9, 0.2, -0.3), (0.1, 0.0, 1.0)])
def test_fit_of_a_long_turn_begins_with_its_exact_motion(twist: tuple[float, float, float]) -> None:
    scaled, way = exact(twist, 20.0)
    start, found = _first_guess(scaled, LENGTH_MM, np.ones(40, dtype=bool))
    np.testing.assert_allclose(found, way, atol=1e-9)
    np.testing.assert_allclose(start, scaled[20], atol=1e-9)
    np.testing.assert_allclose(
        _first_along(scaled, start, found, LENGTH_MM), np.linspace(0, 20, 40) - 400 / 39, atol=1e-9
    )


@pytest.mark.parametrize("twist", [(0.9, 0.1, 0.03), (-0.9, 0.1, 0.03), (0.9, -0.2, -0.03), (1.0, 0.0, 0.0)])
def test_fit_of_a_short_turn_begins_near_its_motion(twist: tuple[float, float, float]) -> None:
    scaled, way = exact(twist, 4.0)
    start, found = _first_guess(scaled, LENGTH_MM, np.ones(40, dtype=bool))
    np.testing.assert_allclose(found, way, atol=1e-3)
    np.testing.assert_allclose(start, scaled.mean(axis=0))
    np.testing.assert_allclose(_first_along(scaled, start, found, LENGTH_MM), np.linspace(-2, 2, 40), atol=0.01)


def test_fit_begins_with_the_frames_that_count_and_at_rest_somewhere() -> None:
    scaled, way = exact((0.9, 0.1, 0.3), 20.0)
    used = np.arange(40) >= 10
    wild = np.where(used[:, None], scaled, 1e3)
    start, found = _first_guess(wild, LENGTH_MM, used)
    np.testing.assert_allclose(found, way, atol=1e-9)
    np.testing.assert_allclose(start, scaled[25])
    assert _first_guess(np.tile(START, (9, 1)), LENGTH_MM, np.ones(9, dtype=bool))[1].tolist() == [1.0, 0.0, 0.0]


@pytest.mark.parametrize("angle", [1e-6, 0.03, 0.0499, -0.04])
def test_series_of_small_angles_are_those_of_the_functions(angle: float) -> None:
    from math import factorial

    def series(first: int) -> float:
        return sum((-1) ** n * angle ** (2 * n) / factorial(2 * n + first) for n in range(8))

    expected = (series(1), angle * series(2), series(2), angle * series(3))
    assert _ratios.py_func(angle) == pytest.approx(expected, rel=1e-12)  # type: ignore[attr-defined]


def fit_with(
    step: np.ndarray, covariance: np.ndarray, systematic: np.ndarray, offset_mm: tuple[float, float]
) -> TurnFit:
    scaled, way = exact((0.9, 0.1, 0.3), 20.0)
    motion = linearised(scaled, START, way, np.linspace(0, 20, 40), LENGTH_MM)
    model = NoiseModel(0.0, 0.0, in_image=False)
    averaged = Averaged((model,), np.ones(1), step[None], covariance[None], np.ones(1), 30.0)
    return TurnFit(
        motion, np.array(offset_mm), np.ones(40, dtype=bool), averaged, 1.0, systematic, np.zeros(2), np.zeros((0, 3))
    )


def curvature_at(fit: TurnFit, step: np.ndarray) -> float:
    (twist,) = fit.body_twists(step[None], np.zeros(2))
    return float(twist[2] / np.hypot(twist[0], twist[1]))


def test_curvature_is_that_of_the_estimated_step_with_the_bounds_of_student() -> None:
    step, rng = 1e-3 * np.array([1.0, -2.0, 3.0, -4.0]), np.random.default_rng(0)
    root = 1e-3 * rng.normal(size=(4, 4))
    fit = fit_with(step, root @ root.T, np.zeros((4, 0)), (-1.5, 0.4))
    found = fit.curvature()
    assert found.value == pytest.approx(curvature_at(fit, step), rel=1e-4)
    assert abs(found.value - curvature_at(fit, np.zeros(4))) > 1e-3 * found.value
    gradient = np.array([(curvature_at(fit, way) - curvature_at(fit, -way)) / 2e-5 for way in 1e-5 * np.eye(4)])
    scale = np.sqrt(gradient @ root @ root.T @ gradient)
    assert found.sigma == pytest.approx(scale * np.sqrt(30 / 28), rel=0.01)
    assert found.high - found.value == pytest.approx(stats.t.ppf(0.975, 30) * scale, rel=0.02)
    assert found.value - found.low == pytest.approx(stats.t.ppf(0.975, 30) * scale, rel=0.02)


def test_systematic_shifts_of_the_parameters_are_those_of_the_curvature_in_quadrature() -> None:
    shifts = 1e-3 * np.array([[0.0, 0.0, 3.0, 0.0], [0.0, 0.0, 0.0, 4.0]]).T
    fit = fit_with(np.zeros(4), 1e-16 * np.eye(4), shifts, (-1.5, 0.4))
    changes = [curvature_at(fit, shift) - curvature_at(fit, np.zeros(4)) for shift in shifts.T]
    assert fit.curvature().systematic == pytest.approx(np.hypot(*changes), rel=0.02)
    assert fit.curvature().high - fit.curvature().value == pytest.approx(1.96 * np.hypot(*changes), rel=0.02)


def test_covariance_of_the_centre_is_that_of_the_steps_through_its_derivative() -> None:
    rng = np.random.default_rng(1)
    root = 1e-4 * rng.normal(size=(4, 4))
    fit = fit_with(np.zeros(4), root @ root.T, np.zeros((4, 0)), (0.0, 0.0))
    center, covariance = fit.center_mm()
    way = fit.motion.twist
    heading = START[2] / LENGTH_MM
    arm = np.array([-way[1], way[0]]) * LENGTH_MM / way[2]
    turned = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]]) @ arm
    np.testing.assert_allclose(center, START[:2] + turned, rtol=1e-6)
    draws = fit.centers_mm(rng.normal(size=(4000, 4)) @ root.T * np.sqrt(30 / 28))
    np.testing.assert_allclose(covariance, np.cov(draws.T), rtol=0.15, atol=0.02 * covariance.max())


@pytest.mark.parametrize(("frames", "aside"), [(1, 1), (12, 12), (20, 0)])
def test_a_jump_is_rejected_where_it_is_shorter_than_half_the_neighbours(frames: int, aside: int) -> None:
    standard = 0.1 * np.random.default_rng(2).normal(size=(400, 2))
    standard[200 : 200 + frames] += 10.0
    left_out = np.flatnonzero(~_not_jumping(standard))
    assert len(left_out) == aside or frames == 20
    if frames == 20:  # longer than half of 31 frames: the median follows it, but for its ends
        assert len(left_out) < 15
    else:
        assert left_out.tolist() == list(range(200, 200 + frames))


@pytest.mark.parametrize(("times", "aside"), [(0.95, False), (1.05, True)])
def test_a_frame_is_rejected_where_a_gaussian_one_lies_once_in_a_million(times: float, aside: bool) -> None:
    """exp(-m²/2) is a millionth at m² = 27.6, in units in which the median is 1.386."""
    ways = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])  # whose median is zero
    standard = np.sqrt(1.386) * np.tile(ways, (100, 1))
    standard[200] = [times * np.sqrt(27.6), 0.0]
    assert bool(~_not_jumping(standard)[200]) == aside
