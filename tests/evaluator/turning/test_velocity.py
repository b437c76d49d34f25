"""Of the velocity of a body at one time of its path."""

from __future__ import annotations

import numpy as np
import pytest

from evaluator.turning.motion.velocity import FEWEST, NEAR_S, velocity_at


def bent_path(time_s: np.ndarray) -> np.ndarray:
    """Positions along parabolas, and a heading along another: (n, 3)."""
    return np.column_stack(
        [1 + 2 * time_s + 3 * time_s**2, 4 - time_s + 0.5 * time_s**2, 0.3 + 0.7 * time_s - time_s**2]
    )


@pytest.mark.parametrize("at_s", [0.0, 0.4, 1.0])
def test_it_is_exact_on_parabolas_at_either_end_and_between(at_s: float) -> None:
    time = np.linspace(0.0, 1.0, 31)
    heading = 0.3 + 0.7 * at_s - at_s**2
    expected = (2 + 6 * at_s + 1j * (-1 + at_s)) * np.exp(-1j * heading)
    found = velocity_at(time, bent_path(time), at_s)
    assert found == pytest.approx((expected.real, expected.imag, 0.7 - 2 * at_s))


def test_only_what_is_near_counts_and_of_a_slow_sensor_the_nearest_frames() -> None:
    time = np.linspace(0.0, 2.0, 61)
    path = bent_path(time)
    path[np.abs(time - 1.0) > NEAR_S] += 5.0
    exact = velocity_at(time, bent_path(time), 1.0)
    assert velocity_at(time, path, 1.0) == pytest.approx(exact)
    slow = np.arange(0.0, 3.0, 0.2)
    assert velocity_at(slow, bent_path(slow), 1.0) == pytest.approx(exact)


def test_it_is_not_told_by_few_frames_or_in_a_gap() -> None:
    time = np.linspace(0.0, 1.0, FEWEST)
    assert velocity_at(time, bent_path(time), 0.5) is not None
    assert velocity_at(time[1:], bent_path(time[1:]), 0.5) is None
    assert velocity_at(np.empty(0), np.empty((0, 3)), 0.5) is None
    around = np.r_[time, 1.0 + 2.02 * NEAR_S + time]
    assert velocity_at(around, bent_path(around), 1.0 + 1.01 * NEAR_S) is None
    assert velocity_at(around, bent_path(around), 1.0 + 0.99 * NEAR_S) is not None
