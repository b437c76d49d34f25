from __future__ import annotations

import numpy as np
import pytest

from .synthetic import arc_poses, measured, winding_poses

STEP_MM = 0.1
FINE_MM = 0.08


def arcs(*pieces: tuple[float, float]) -> np.ndarray:
    """Arcs of (radius mm, degrees), one after the other."""
    return np.concatenate(
        [np.full(round(np.radians(angle) * radius / STEP_MM), 1 / radius) for radius, angle in pieces]
    )


@pytest.mark.parametrize("sigma_mm", [pytest.param(0.003, marks=pytest.mark.exam), 0.03])
def test_noise_does_not_make_a_circle_tighter(sigma_mm: float) -> None:
    """A minimum over sliding windows of 20 to 180 degrees reads 23 % to 0.07 % low on such runs."""
    runs = [measured(arc_poses(5.0, 540, 200), sigma_mm, seed) for seed in range(6)]
    assert not any(run.radius_varies for run in runs)
    assert np.mean([run.radius_mm for run in runs]) == pytest.approx(5.0, rel=5e-4)
    assert all(run.radius_mm == run.steady_radius_mm for run in runs)


@pytest.mark.parametrize("place", ["first", "middle", "last"])
def test_tight_stretch_of_more_than_a_quarter_turn_is_found(place: str) -> None:
    before, after = {"first": (0, 540), "middle": (270, 270), "last": (540, 0)}[place]
    path = winding_poses(arcs((5.0, before), (4.0, 150), (5.0, after)), STEP_MM)
    run = measured(path, 0.01, 1)
    assert run.radius_varies
    assert run.radius_mm == pytest.approx(4.0, rel=0.005)
    assert run.radius_low_mm < 4.0 < run.radius_high_mm


def test_tight_stretch_shorter_than_a_quarter_turn_is_not_called_sustained() -> None:
    run = measured(winding_poses(arcs((5.0, 360), (4.0, 30), (5.0, 360)), STEP_MM), 0.01, 2)
    assert run.radius_mm > 4.5


def test_once_per_turn_variation_is_reported_with_its_size() -> None:
    turned = np.linspace(0, 4 * np.pi, 630)
    run = measured(winding_poses(0.2 * (1 + 0.03 * np.sin(turned)), STEP_MM), 0.01, 3)
    assert run.radius_varies
    assert run.radius_mm == pytest.approx(5.0 / 1.03, rel=0.005)
    assert run.steady_radius_low_mm < 5.0 < run.steady_radius_high_mm
    assert run.radius_variation == pytest.approx(0.03 / np.sqrt(2), rel=0.5)


def test_backward_run_with_more_noise_has_the_same_radius() -> None:
    forward = [measured(arc_poses(7.8, 300, 150), 0.005, seed) for seed in range(5)]
    backward = [measured(arc_poses(7.8, 300, 150)[::-1], 0.02, seed, 0.5) for seed in range(5)]
    difference = np.mean([run.radius_mm for run in backward]) - np.mean([run.radius_mm for run in forward])
    assert abs(difference) < 0.003 * 7.8


def smallest_quarter_turn(curvature: np.ndarray, step_mm: float) -> float:
    """Least length of path per angle over any quarter turn: the truth in closed form."""
    turned = np.concatenate([[0.0], np.cumsum(curvature * step_mm)])
    length = np.arange(len(turned)) * step_mm
    start = np.linspace(0, turned[-1] - np.pi / 2, 2000)
    lengths = np.interp(start + np.pi / 2, turned, length) - np.interp(start, turned, length)
    return float(lengths.min() / (np.pi / 2))


def clothoid(first_mm: float, last_mm: float, turned_deg: float, step_mm: float) -> np.ndarray:
    length = np.radians(turned_deg) * 2 / (1 / first_mm + 1 / last_mm)
    return np.linspace(1 / first_mm, 1 / last_mm, int(length / step_mm))


def spiral(first_mm: float, last_mm: float, turned_deg: float, step_mm: float) -> np.ndarray:
    """Logarithmic spiral: the radius grows evenly in proportion to the angle."""
    turned = np.linspace(0, np.radians(turned_deg), 100_001)
    radius = first_mm * (last_mm / first_mm) ** (turned / turned[-1])
    length = np.concatenate([[0.0], np.cumsum((radius[1:] + radius[:-1]) / 2 * np.diff(turned))])
    return np.interp(np.arange(0, length[-1], step_mm), length, 1 / radius)


def ellipse(long_mm: float, short_mm: float, from_deg: float, to_deg: float, step_mm: float) -> np.ndarray:
    angle = np.linspace(np.radians(from_deg), np.radians(to_deg), 100_001)
    speed = np.hypot(long_mm * np.sin(angle), short_mm * np.cos(angle))
    length = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(angle))])
    return np.interp(np.arange(0, length[-1], step_mm), length, long_mm * short_mm / speed**3)


@pytest.mark.parametrize("sigma_mm", [pytest.param(0.002, marks=pytest.mark.exam), 0.02])
@pytest.mark.parametrize(
    "curvature",
    [
        clothoid(4.4, 5.8, 170, FINE_MM),
        clothoid(5.0, 4.0, 300, FINE_MM),
        clothoid(3.0, 8.0, 700, FINE_MM),
        spiral(3.0, 6.0, 720, FINE_MM),
        ellipse(6.0, 5.0, 0, 720, FINE_MM),
        ellipse(6.0, 4.0, -90, 90, FINE_MM),
    ],
    ids=["arc", "clothoid", "long clothoid", "spiral", "ellipse", "half ellipse"],
)
def test_smallest_quarter_turn_of_a_changing_curvature_lies_within_its_bounds(
    curvature: np.ndarray, sigma_mm: float
) -> None:
    truth = smallest_quarter_turn(curvature, FINE_MM)
    runs = [measured(winding_poses(curvature, FINE_MM), sigma_mm, seed) for seed in range(2)]
    for run in runs:
        assert run.radius_varies
        assert run.radius_status.startswith("varies: the curvature scatters by")
        assert run.radius_mm == pytest.approx(truth, rel=0.06)
    assert any(run.radius_low_mm < truth < run.radius_high_mm for run in runs)


def test_bounds_of_an_arc_of_less_than_a_quarter_turn_hold_what_its_curvature_does() -> None:
    curvature = spiral(4.0, 5.0, 80, 0.03)
    run = measured(winding_poses(curvature, 0.03), 0.002, 0)
    assert run.radius_varies
    # One standard deviation of an even change of curvature from end to end is 1/sqrt(12) of it.
    assert run.radius_low_mm < 4.2
    assert run.radius_high_mm > 4.8
