"""Runs on the verge of another path, which obstruct a fit until the others have led it close enough."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.inference import fit as fits
from evaluator.diagnosis.inference.descent import steps
from evaluator.diagnosis.inference.descent.steps import full_step, obstructing_runs, settled_at
from evaluator.diagnosis.inference.fit import _fitted, _led_by_others, way_of_the_others
from evaluator.diagnosis.inference.fitted_model import Fit
from evaluator.diagnosis.likelihood.point import Column, Point
from simulator.effects.coordinates import Candidate, Coordinate

LINE = Candidate("line", (Coordinate("size", 0.0, 1.0),), lambda values: {"size": values[0]})
COLUMN = Column("line", 0, LINE)
SCATTER = np.array([0.05, 0.02, 0.02, 1.0])
RUNS = tuple(range(3, 24))  # as if three others were held out


def fit_at(size: float, runs: tuple[int, ...] = RUNS) -> Fit:
    posterior: Any = SimpleNamespace(log_evidence=0.0, scatter=SCATTER)
    nothing: Any = None
    return Fit(
        frozenset({"line"}), Point(np.zeros((24, 7)), terms={"line": (size,)}), (COLUMN,), posterior, nothing, (),
        converged=False, runs=runs,
    )  # fmt: skip


def step_with(monkeypatch: pytest.MonkeyPatch, changes: dict[int, float], promised: float = 10.0) -> Any:
    """A full step after which -2 log density of each run has changed: by these for some, by -9 for the others."""
    count = len(RUNS)
    now = np.array([*np.full(count, 100.0), 0.0])
    values = [100.0 + changes.get(run, -9.0) for run in RUNS]
    monkeypatch.setattr(steps, "settled_by_run", lambda _, point, *__: (point, np.array(values)))
    return SimpleNamespace(
        theta=np.zeros(1), goal=np.ones(1), scatter=SCATTER, prior=np.zeros(1), now=now,
        promised=np.array([*np.full(count, promised), 0.0]),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "promised", "held"),
    [
        ({}, 10.0, ()),  # a full step improves
        ({4: 150.0}, 10.0, ()),  # also with this run
        ({4: 500.0}, 10.0, (4,)),
        ({4: 500.0, 9: 9000.0}, 10.0, (9, 4)),  # a tenth of 21 runs are two
        ({4: 500.0, 9: 900.0, 11: 5000.0}, 10.0, ()),  # not without two of three either
        ({4: 500.0}, 17.0, (4,)),  # the others reach 9 of 17 promised
        ({4: 500.0}, 19.0, ()),  # less than half: theirs is no linear view either
    ],
)
def test_runs_are_held_back_without_which_a_full_step_keeps_half_of_what_it_promises(
    changes: dict[int, float], promised: float, held: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    optimum = step_with(monkeypatch, changes, promised)
    full = full_step(SimpleNamespace(), fit_at(0.0), optimum)  # type: ignore[arg-type]
    assert obstructing_runs(fit_at(0.0), optimum, full) == held


def test_no_run_is_held_back_if_one_cannot_be_simulated_after_a_full_step(monkeypatch: pytest.MonkeyPatch) -> None:
    optimum = step_with(monkeypatch, {4: 500.0})

    def fails(*_: Any) -> Any:
        raise FloatingPointError

    monkeypatch.setattr(steps, "settled_by_run", fails)
    nothing: Any = SimpleNamespace()
    assert obstructing_runs(fit_at(0.0), optimum, full_step(nothing, fit_at(0.0), optimum)) == ()
    assert settled_at(nothing, fit_at(0.0), optimum, fit_at(1.0).point) is None


@pytest.mark.parametrize(("change", "better"), [(-1.0, True), (1.0, False)])
def test_point_that_the_others_reach_counts_only_if_it_is_better_for_all(
    change: float, better: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    optimum = step_with(monkeypatch, dict.fromkeys(RUNS, change))
    ahead = fit_at(1.0).point
    found = settled_at(SimpleNamespace(), fit_at(0.0), optimum, ahead)  # type: ignore[arg-type]
    assert found == (ahead if better else None)


@pytest.mark.parametrize(("size", "better"), [(2.0, True), (-2.0, True), (2.2, False)])
def test_what_known_values_move_counts_against_a_point_by_its_square(
    size: float, better: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    optimum = step_with(monkeypatch, dict.fromkeys(RUNS, -0.21))  # 4.4 less in all
    optimum.prior = np.ones(1)
    ahead = fit_at(size).point
    found = settled_at(SimpleNamespace(), fit_at(0.0), optimum, ahead)  # type: ignore[arg-type]
    assert found == (ahead if better else None)


def test_others_are_fitted_alone_and_their_steps_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def fitted(*given: Any, may_hold_back: bool) -> Fit:
        asked.append((given[4], may_hold_back))
        return replace(fit_at(1.0), steps=3)

    monkeypatch.setattr(fits, "_fitted", fitted)
    monkeypatch.setattr(fits, "settled_at", lambda *given: given[3])
    nothing: Any = SimpleNamespace()
    arguments: Any = (nothing, fit_at(0.0), nothing, {}, np.array(np.inf), -np.inf)
    assert _led_by_others(*arguments, ()) == (None, 0)
    point, count = _led_by_others(*arguments, (4, 9))
    assert (point and point.terms, count) == (fit_at(1.0).point.terms, 3)
    assert asked == [(tuple(run for run in RUNS if run not in (4, 9)), False)]


def test_a_fit_that_promises_much_is_led_by_the_runs_that_do_not_obstruct_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """On open ground such a fit ends; its steps, and values of terms without a derivative, stay those of the fit."""
    obstructing, failing, asked = [(4, 9)], [False], []

    def fitted(_: Any, start: Point, terms: Any, tolerance: Any, runs: Any, fixed: Any) -> Fit:
        asked.append((start, terms, tolerance, tuple(runs), fixed))
        if failing[0]:
            raise FloatingPointError
        return fit_at(1.0)

    monkeypatch.setattr(fits, "_optimum", lambda fit, tolerance, most: (fit, tolerance, most))
    monkeypatch.setattr(fits, "full_step", lambda *_: "full")
    monkeypatch.setattr(fits, "obstructing_runs", lambda _, __, full: obstructing[0] if full == "full" else ())
    monkeypatch.setattr(fits, "fit_model", fitted)
    fit, line = replace(fit_at(0.0), shortfall=fits.STALLED), SimpleNamespace(id="line")
    problem: Any = SimpleNamespace()
    runs, point = way_of_the_others(problem, fit, [line], {"k": 1.0}) or ((), None)  # type: ignore[list-item]
    assert (runs, point and point.terms) == ((4, 9), fit_at(1.0).point.terms)
    others = tuple(run for run in RUNS if run not in (4, 9))
    assert asked == [(fit.point, [line], {"k": 1.0}, others, {})]
    assert way_of_the_others(problem, fit, [], {}) is not None
    assert asked[-1][-1] == {"line": fit.point.terms["line"]}
    failing[0] = True
    assert way_of_the_others(problem, fit, [], {}) is None
    obstructing[0], failing[0] = (), False
    assert way_of_the_others(problem, fit, [], {}) is None
    obstructing[0] = (4,)
    assert way_of_the_others(problem, replace(fit, shortfall=fits.STALLED - 0.1), [], {}) is None


def test_fit_goes_on_from_the_point_of_the_others_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Far from the optimum 1.0 a step promises 50, at it nothing; the others lead there in four steps."""
    led = []

    def led_by_others(*_: Any) -> tuple[Point | None, int]:
        led.append(1)
        return fit_at(1.0).point, 4

    monkeypatch.setattr(fits, "_viewed", lambda _, point, *__: fit_at(point.terms["line"][0]))
    promised = {0.0: 50.0, 1.0: 0.1}
    monkeypatch.setattr(
        fits, "_optimum",
        lambda fit, *_: SimpleNamespace(predicted=promised[fit.point.terms["line"][0]], per_run=np.zeros((1, 4))),
    )  # fmt: skip
    monkeypatch.setattr(fits, "full_step", lambda *_: None)
    monkeypatch.setattr(fits, "obstructing_runs", lambda *_: (4,))
    monkeypatch.setattr(fits, "_led_by_others", led_by_others)
    monkeypatch.setattr(fits, "line_search", lambda *_: (fit_at(0.0).point, False))
    problem: Any = SimpleNamespace(watch=SimpleNamespace(look=lambda: None), open_ground=False)
    arguments: Any = (problem, fit_at(0.0).point, (COLUMN,), {}, RUNS, np.array(np.inf), -np.inf)
    monkeypatch.setattr(Fit, "excess", 3.0)
    found = _fitted(*arguments)
    assert (found.converged, found.steps, len(led)) == (True, 6, 1)
    assert not _fitted(*arguments, may_hold_back=False).converged
    promised[0.0] = 4.9  # so little is roughness, not a wrong direction
    assert (_fitted(*arguments).converged, len(led)) == (True, 1)
