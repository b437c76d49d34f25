"""How far a run is from its marks, and whether what others say of the robot follows it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis import diagnosis
from evaluator.diagnosis.assessment import sole_run as module
from evaluator.diagnosis.assessment.gap import counting_data, run_gaps
from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized
from evaluator.diagnosis.likelihood.linear.random_effects import place_starts
from evaluator.diagnosis.likelihood.noise.friction_wander import whitening
from evaluator.diagnosis.likelihood.point import Column, Point
from evaluator.diagnosis.likelihood.preparation import build_problem
from tests.evaluator.diagnosis.test_problem import TIME, Circle, measured

MASS = Column("body.mass_g")


def test_a_run_that_friction_bent_on_its_way_is_placed_where_it_is_nearest_to_its_marks() -> None:
    bend = np.zeros((len(TIME), 4))
    bend[:, 0] = TIME**2  # of the midpoint, along x; the plate may do a millimetre of it in 1 s
    data = tuple(
        replace(run, marks_mm=run.marks_mm + 0.02 * bend[:, [0, 1, 0, 1]]) for run in measured(1, sigma_mm=0.001)
    )
    problem, start = build_problem(data, Circle(data))  # type: ignore[arg-type]
    ground = whitening(problem.compressions[0].of_tracking(bend)[:, None])
    problem = replace(problem, friction_wander=1.0, compressions=(replace(problem.compressions[0], ground=ground),))
    by_marks, likeliest = (place_starts(each, start, [0]) for each in (problem.of_tracking, problem))

    def gap_mm(point: Point) -> float:
        return float(run_gaps(problem, point, [0])[0])

    assert gap_mm(likeliest) > 1.5 * gap_mm(by_marks)
    for step in np.vstack([np.eye(3), -np.eye(3)]) * 0.01:
        moved = by_marks.per_run + np.pad(step, (0, 4))
        assert gap_mm(replace(by_marks, per_run=moved)) > 0.999 * gap_mm(by_marks)


@pytest.mark.parametrize(("sigma", "followed"), [(0.05, False), (1.0, True)])
def test_a_run_is_followed_where_others_leave_open_what_it_wants(
    monkeypatch: pytest.MonkeyPatch, *, sigma: float, followed: bool
) -> None:
    """Others say 0 ± sigma of a common parameter; the run wants 0.3 ± 0.01, and is followed within 0.1 of that."""
    view = Linearized(np.full(9, 30.0), np.full((9, 1), 100.0), np.eye(9)[:, :3], np.zeros((9, 4)))
    problem: Any = SimpleNamespace(linearized=lambda *_: [view])
    problem.of_tracking = problem
    posterior = SimpleNamespace(covariance=np.array([[sigma**2]]), scatter=np.ones(4))
    fit: Any = SimpleNamespace(point=Point(np.zeros((1, 7)), {MASS.key: 0.0}), columns=(MASS,), posterior=posterior)
    monkeypatch.setattr(module, "place_runs", lambda _, point, *__: point)
    monkeypatch.setattr(module, "run_gaps", lambda _, point, __: np.array([abs(point.nominal[MASS.key] - 0.3)]))
    monkeypatch.setattr(module, "farthest_followed", lambda *_: np.array([0.1]))
    assert module.is_followed(problem, fit, np.zeros((1, 7)), 0, {MASS.key: 1.0}) == followed


def test_a_run_is_compared_within_the_tolerances_of_the_fit_to_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """A column that only the others show has no tolerance in the search over all runs."""
    asked: list[Any] = []
    monkeypatch.setattr(diagnosis, "is_followed", lambda *given: not asked.append(given))
    point = Point(np.zeros((2, 7)))
    found: Any = SimpleNamespace(search=SimpleNamespace(problem="all", tolerance={}), fit=SimpleNamespace(point=point))
    again: Any = SimpleNamespace(search=SimpleNamespace(tolerance={MASS.key: 0.02}), fit="others")
    assert diagnosis._is_followed(found, again, 1)
    assert asked == [("all", "others", point.per_run, 1, {MASS.key: 0.02})]


def test_a_run_that_cannot_be_simulated_is_not_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise FloatingPointError

    monkeypatch.setattr(module, "place_runs", fails)
    problem: Any = SimpleNamespace(of_tracking=None)
    fit: Any = SimpleNamespace(point=Point(np.zeros((1, 7))), posterior=SimpleNamespace(scatter=np.ones(4)))
    assert not module.is_followed(problem, fit, np.zeros((1, 7)), 0, {})


def test_frames_in_which_a_robot_is_taken_away_count_in_no_gap() -> None:
    problem, _ = build_problem(data := measured(8), Circle(data))  # type: ignore[arg-type]
    channels = problem.channels[0].copy()
    channels[-4:, 2] = np.nan
    kept = counting_data(replace(problem, channels=(channels, *problem.channels[1:])))
    assert np.isnan(kept[0].marks_mm).all(axis=1).tolist() == [False] * (len(TIME) - 4) + [True] * 4
    np.testing.assert_array_equal(kept[1].marks_mm, data[1].marks_mm)
