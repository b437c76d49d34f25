"""Scatter that is chance is taken for chance, also where runs tell little of it; what depends on something is not."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from evaluator.diagnosis.assessment.adequacy import Adequacy, _order, _widest, unlike_runs
from evaluator.diagnosis.likelihood.run_data import RunData

COMMANDS = [(30, 30), (60, 60), (-30, -30), (-60, -60), (33.3, 14.4), (14.4, 33.3), (-33.3, -14.4), (-14.4, -33.3)]


def _experiment(rng: np.random.Generator, drift: float = 0.0) -> tuple[float, str]:
    """Scatter of 20 runs, seen through shares that differ: straight runs tell nothing of friction."""
    data, told = [], []
    for order in range(20):
        left, right = COMMANDS[order % len(COMMANDS)]
        data.append(RunData(str(order), left, right, 0.0, None, np.arange(4) / 2, rng.normal(size=(4, 4)) * 10, order))
        friction = 1e-4 if abs(left) == abs(right) else rng.uniform(0.2, 0.9)
        told.append([friction, *rng.uniform(0.7, 1.0, 3)])
    shares: NDArray[np.float64] = np.array(told)
    true = rng.normal(size=(20, 4)) + drift * np.arange(20)[:, None]
    return _order(shares * true + np.sqrt(shares * (1 - shares)) * rng.normal(size=(20, 4)), shares, data)


def test_chance_is_called_something_else_as_seldom_as_said() -> None:
    rng = np.random.default_rng(5)
    probabilities = np.array([_experiment(rng)[0] for _ in range(150)])
    assert np.mean(probabilities < 0.05) <= 0.1
    assert probabilities.min() > 1e-4


def test_scatter_at_the_most_that_is_thought_possible_is_not_chance() -> None:
    """Friction is asked up to 30 %, wheel speed up to 10 %; the values before these are 19 and 6.3 %."""
    assert _widest(np.array([0.23, 0.078, 0.078, 1.0])) == ""
    assert _widest(np.array([0.24, 0.001, 0.001, 1.0])).startswith("friction differs from run to run by 24 %,")
    assert _widest(np.array([0.01, 0.081, 0.081, 1.0])).startswith("wheel speed differs from run to run by 8 %,")


def test_what_grows_from_run_to_run_is_not_chance() -> None:
    probability, reason = _experiment(np.random.default_rng(6), drift=0.5)
    assert probability < 1e-6
    assert reason.endswith("order")


def _left(rng: np.random.Generator, gains: NDArray[np.float64]) -> Adequacy:
    """Runs that tell half or more of friction and gains that scatter by 5 and 0.1 %, left gains changed."""
    told = rng.uniform(0.5, 1.0, (len(gains), 4))
    true = rng.normal(size=(len(gains), 4)) * [0.05, 0.001, 0.001, 1.0]
    true[:, 1] += gains
    return Adequacy(1.0, 0.0, np.ones(len(gains)), np.sqrt(told) * true, told, 1.0, "")


def test_a_wheel_that_is_dirty_for_three_runs_is_told_of_these() -> None:
    gains = np.zeros(20)
    gains[[7, 8, 9]] = 0.015
    (found,) = unlike_runs(_left(np.random.default_rng(3), gains), range(100, 120))
    assert (found.runs, found.what, found.change) == ((107, 108, 109), "left_gain", pytest.approx(0.015, rel=0.15))


def test_runs_that_scatter_by_chance_are_hardly_ever_unlike() -> None:
    rng = np.random.default_rng(4)
    said = [bool(unlike_runs(_left(rng, np.zeros(runs)), range(runs))) for runs in (8, 20) for _ in range(300)]
    assert np.mean(said) < 0.01
