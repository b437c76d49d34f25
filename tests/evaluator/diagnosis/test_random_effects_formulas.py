"""How the start of a run is searched where its features are far from linear: steps that overshoot or fail."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized
from evaluator.diagnosis.likelihood.linear.random_effects import secant, settled_by_run
from evaluator.diagnosis.likelihood.point import Point
from tests.evaluator.diagnosis.synthetic import linear_runs


def arctangent(fails_below: float = -np.inf) -> Any:
    """Runs whose only feature is 10·atan(x) of the start x, 0 where it was measured; too far back they fail."""

    def view(x: float, slope_at: float) -> Linearized | None:
        if x < fails_below:
            return None
        start = np.zeros((7, 3))
        start[1, 1] = start[2, 2] = 1.0
        start[0, 0] = 10 / (1 + slope_at**2)
        return Linearized(-10 * np.arctan([x, 0, 0, 0, 0, 0, 0]), np.zeros((7, 0)), start, np.zeros((7, 4)))

    slopes: dict[int, float] = {}

    def attempted(trial: Point, _: object, runs: list[int]) -> list[Linearized | None]:
        slopes.update({run: trial.per_run[run, 0] for run in runs})
        return seen_again(trial, [], runs)

    def seen_again(trial: Point, _: object, runs: list[int]) -> list[Linearized | None]:
        return [view(trial.per_run[run, 0], slopes[run]) for run in runs]

    return SimpleNamespace(
        attempted=attempted, seen_again=seen_again, per_run_steps=np.full(7, 1e-3), data=[SimpleNamespace(id="r0")]
    )


@pytest.mark.parametrize("begin", [2.0, -2.0])
def test_a_step_that_overshoots_is_made_shorter_until_it_improves(begin: float) -> None:
    """From 2 a step of Newton leads to -3.5, farther than before."""
    point = Point(begin * np.eye(7)[:1])
    found, (value,) = settled_by_run(arctangent(), point, [0], None)
    assert found.per_run[0, 0] == pytest.approx(0.0, abs=0.02)
    assert value < 0.1


def test_a_step_to_where_a_run_cannot_be_simulated_is_made_shorter() -> None:
    found, _ = settled_by_run(arctangent(fails_below=-0.5), Point(1.0 * np.eye(7)[:1]), [0], None)
    assert found.per_run[0, 0] == pytest.approx(0.0, abs=0.02)


def test_a_run_that_cannot_be_simulated_at_the_point_is_named() -> None:
    with pytest.raises(FloatingPointError, match="run r0 cannot be simulated at this point"):
        settled_by_run(arctangent(fails_below=3.0), Point(2.0 * np.eye(7)[:1]), [0], None)


def test_slopes_stay_as_they_are_where_no_step_was_made() -> None:
    (before, after), at = linear_runs(count=2), np.zeros(9)
    assert secant(before, after, at, at, np.ones(9)) is after
