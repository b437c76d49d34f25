"""Values of a term whose response changes in steps: which are tried, which are as likely, and where a fit moves."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.inference import screening, search
from evaluator.diagnosis.inference import steps_of_a_term as module
from evaluator.diagnosis.inference.search import Search
from evaluator.diagnosis.likelihood.point import Point
from evaluator.diagnosis.search_input import _passed_rpm
from evaluator.interchange.commands import RunCommand
from simulator.command import Command
from simulator.effects.catalogue import EFFECTS
from simulator.effects.coordinates import Candidate, Coordinate, Scene
from tests.evaluator.diagnosis.synthetic import fit_of, linear_runs, run_data

COUNT = 50
BAND = Candidate(
    *("band", (Coordinate("rpm", 0.0, 1.0),), dict),
    starts=tuple((k + 0.5,) for k in range(COUNT)),
    stepwise=True,
    between=tuple((float(k), k + 1.0) for k in range(COUNT)),
)
RUNS = linear_runs(3)


def fit_at(value: float) -> Any:
    fit = fit_of(RUNS, (), np.zeros(0), np.ones(4))
    return SimpleNamespace(
        **{**vars(fit), "point": Point(np.zeros((3, 7)), terms={"band": (value,)}), "runs": (0, 1, 2)}
    )


def evidence_of(monkeypatch: pytest.MonkeyPatch, evidence: dict[int, float]) -> Any:
    """A problem whose runs have this evidence at some steps, and cannot be simulated at others."""

    def seen_again(point: Point, *_: Any) -> list[Any]:
        step = int(point.terms["band"][0])
        return [step if step in evidence else None] * 3

    monkeypatch.setattr(module, "reduce_runs", lambda views: views[0])
    monkeypatch.setattr(module, "MixedModel", lambda step, _: SimpleNamespace(log_evidence=lambda _: evidence[step]))
    return SimpleNamespace(seen_again=seen_again)


def test_the_interval_has_all_neighbours_that_the_runs_hardly_contradict(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = evidence_of(monkeypatch, {19: -1.0, 20: -1.9, 21: 0.0, 22: -1.0, 23: -2.0, 24: 0.0, 17: 0.0})
    assert module.likely_interval(problem, fit_at(21.3), BAND, {}) == (19.0, 23.0)
    assert module.likely_interval(evidence_of(monkeypatch, {0: 0.0, 1: -0.5}), fit_at(0.2), BAND, {}) == (0.0, 2.0)


@pytest.mark.parametrize(
    ("evidence", "better"), [({18: 3.0, 21: 0.0, 25: 5.0, 26: 9.0}, 25), ({21: 0.0, 22: 0.1}, None), ({21: 0.0}, None)]
)
def test_a_better_step_is_near_and_better_by_more_than_a_fit_leaves_open(
    evidence: dict[int, float], better: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert module.better_step(evidence_of(monkeypatch, evidence), fit_at(21.5), BAND, {}) == better


def test_a_fit_moves_to_better_steps_as_long_as_it_gains(monkeypatch: pytest.MonkeyPatch) -> None:
    def fitted(_: Any, begin: Point, smooth: Any, fixed: Any, *, rival: float) -> Any:
        assert (smooth, fixed, rival) == ([], {"band": begin.terms["band"]}, -3.0)
        value = begin.terms["band"][0]
        return SimpleNamespace(
            point=begin, converged=True, terms={"band"}, posterior=SimpleNamespace(log_evidence=-abs(value - 31.5))
        )

    monkeypatch.setattr(search, "_fit_from", fitted)
    monkeypatch.setattr(search, "better_step", lambda _, fit, *__: int(fit.point.terms["band"][0]) + 4)
    whole = Search(SimpleNamespace(), {"band": BAND}, {}, (0,))  # type: ignore[arg-type]
    begin = fitted(None, Point(np.zeros((1, 7)), terms={"band": (20.5,)}), [], {"band": (20.5,)}, rival=-3.0)
    found = search._at_better_steps(whole, begin, [], -3.0)
    assert found.point.terms == {"band": (32.5,)}  # the next, 36.5, is farther from the best


def test_of_many_values_a_few_are_tried_and_then_those_between_the_neighbours_of_the_best(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tried: list[list[float]] = []

    def screened(_: Any, __: Any, ___: Any, candidates: Any) -> Any:
        (term,) = candidates
        tried.append([start[0] for start in term.starts])
        offers = tuple(("many", (k,)) for k in range(len(term.starts)))
        return SimpleNamespace(
            offers=offers,
            start_of=lambda offer: term.starts[offer[1][0]],
            evidence=lambda offer: -abs(term.starts[offer[1][0]][0] - 137.2),
        )

    monkeypatch.setattr(screening, "_screened", screened)
    many = replace(BAND, id="many", starts=tuple((float(k),) for k in range(1000)))
    asked: Any = ("search", "point")
    screening.screen(*asked, (), [many])
    assert [len(part) for part in tried] == [32, 32, 5]
    assert tried[-1] == [136.0, 137.0, 138.0, 139.0, 140.0]
    tried.clear()
    screening.screen(*asked, ("many",), [many])  # it is in the model already
    screening.screen(*asked, (), [replace(many, starts=many.starts[:32])])
    assert [len(part) for part in tried] == [1000, 32]


def test_a_band_lies_between_levels_that_logs_pass() -> None:
    """A ramp from 10 to 12 rpm within 0.2 s has levels between its ends; a constant run has its own."""
    ramp = RunCommand(Command([0.0, 0.2], [-10.0, -12.0], [0.0, 0.0]), logged=True)
    runs = [run_data(30.0, 20.0), replace(run_data(30.0, 20.0), log=ramp, time_s=np.array([0.0, 0.25]))]
    session: Any = SimpleNamespace(data=runs)
    passed = _passed_rpm(session)
    assert passed == pytest.approx((0.0, 10.0, 10.5, 11.0, 11.5, 12.0, 20.0, 30.0))
    band = EFFECTS["dead-band"].candidate(Scene(10.0, (20.0, 30.0), passed_rpm=passed))
    assert band.between[:3] == ((10.0, 10.5), (10.5, 11.0), (11.0, 11.5))
    assert EFFECTS["dead-band"].candidate(Scene(10.0, (20.0, 30.0))).between == ((20.0, 30.0), (30.0, 60.0))
