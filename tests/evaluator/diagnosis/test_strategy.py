"""Which sets a search fits: what the view from the null overlooks, and what the user asks for."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis import search_runs
from evaluator.diagnosis.candidates.coordinates import named_terms
from evaluator.diagnosis.candidates.free_form import wheel_friction
from evaluator.diagnosis.inference import strategy
from evaluator.diagnosis.inference.fit import fit_model
from evaluator.diagnosis.inference.screening import screen
from evaluator.diagnosis.inference.search import Search, fit_set
from evaluator.diagnosis.inference.strategy import extend, run_search
from evaluator.diagnosis.likelihood.features import channel_residual, channels_of
from evaluator.diagnosis.likelihood.noise.common_drift import usual_drift
from evaluator.diagnosis.likelihood.noise.friction_wander import MODES, USUAL_WANDER
from evaluator.diagnosis.likelihood.point import Point
from evaluator.diagnosis.likelihood.preparation import build_problem, friction_shifts
from evaluator.diagnosis.likelihood.problem import FRICTION, Problem
from evaluator.diagnosis.likelihood.simulation import Simulated
from evaluator.diagnosis.search_input import Prepared
from evaluator.progress import no_progress
from simulator.effects.catalogue import EFFECTS
from simulator.effects.coordinates import Scene
from simulator.effects.parameter import Size
from tests.evaluator.diagnosis.hidden import hidden_session

TRIED = ("drive-speed-scale", "plate-tilt", "mark-offset", "rolling-drag", "tether-pull")
SCALE, NOTHING = frozenset({"drive-speed-scale"}), frozenset[str]()


@pytest.fixture(scope="module")
def faster(tmp_path_factory: pytest.TempPathFactory) -> tuple[Search, Point]:
    """A search of runs with faster wheels, nothing fitted, and the nominal point."""
    session = hidden_session(tmp_path_factory.mktemp("faster"), {"drive-speed-scale": {"factor": 1.01}}, exact=True)
    every = named_terms(20.0, (30.0, 60.0))
    terms = {effect: every[effect] for effect in TRIED}
    problem, start = build_problem(session.data, Simulated(session.robots, session.data, terms))
    return Search(problem, terms, session.tolerance, tuple(range(len(session.data)))), start


def test_what_the_view_from_the_null_overlooks_is_fitted_from_the_model_as_its_file_says(
    faster: tuple[Search, Point], monkeypatch: pytest.MonkeyPatch
) -> None:
    empty, nominal = faster
    search = empty.anew()
    monkeypatch.setattr(strategy, "_from_the_null", lambda _: None)
    run_search(search, nominal, nominal, no_progress)
    assert search.ranked()[0] == SCALE


def test_nothing_is_added_where_runs_without_their_own_friction_cannot_be_simulated(
    faster: tuple[Search, Point], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A diagnosis ended there, with a sentence that blamed the robot file."""
    empty, nominal = faster
    search = empty.anew()
    null = fit_model(search.problem, nominal, [], search.tolerance, search.runs)
    search.fits[NOTHING] = replace(null, point=replace(null.point, per_run=null.point.per_run + 1e-3))

    def seen(_: Search, point: Point, *__: object) -> None:
        raise FloatingPointError(f"cannot be simulated at {point.per_run[0, 3:].tolist()}")

    monkeypatch.setattr(strategy, "screen", seen)
    strategy._extend_without_scatter(search, search.null, (), tuple(search.terms.values()))
    assert list(search.fits) == [NOTHING]


@pytest.mark.parametrize(("of_fit", "fitted"), [(0.0, ["c", "b"]), (6.9, ["c"]), (9.0, []), (-50.0, ["c", "b"])])
def test_an_addition_without_friction_of_runs_must_promise_more_than_the_fit_itself_has(
    of_fit: float, fitted: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without the friction of its runs the set alone is worth 0, with b 4 and with c 9."""
    promised = {(): 0.0, ("a",): 1.9, ("b",): 4.0, ("c",): 9.0}
    offers = [(name, (number,)) for number, name in enumerate("abc")]
    view = SimpleNamespace(offers=offers, evidence=lambda *asked: promised[tuple(name for name, _ in asked)])
    monkeypatch.setattr(strategy, "screen", lambda *_: view)
    tried: list[str] = []
    monkeypatch.setattr(strategy, "_refit", lambda _s, _v, sets, *_: tried.extend(name for ((name, _),) in sets))
    fit: Any = Fitted(Point(np.ones((1, 7))), SimpleNamespace(log_evidence=of_fit))
    search: Any = SimpleNamespace(asked=NOTHING, fits={})
    strategy._extend_without_scatter(search, fit, (), ())
    assert tried == fitted


@dataclass(frozen=True)
class Fitted:
    """A fit of no effects."""

    point: Point
    posterior: Any
    terms: frozenset[str] = NOTHING


def test_a_fit_of_what_the_user_asks_for_begins_where_its_file_says(
    faster: tuple[Search, Point], monkeypatch: pytest.MonkeyPatch
) -> None:
    empty, nominal = faster
    begun = []
    monkeypatch.setattr(strategy, "fit_set", lambda _search, ids, starts, *_: begun.append((ids, starts)))
    monkeypatch.setattr(strategy, "_refit", lambda *_, **__: None)
    for begin in ((), (0.2, -0.1, 3.0)):
        told = replace(empty.terms["mark-offset"], begin=begin)
        search = replace(empty, terms={**empty.terms, "mark-offset": told}).anew(asked=frozenset({"mark-offset"}))
        search.fits[NOTHING] = fit_model(search.problem, nominal, [], search.tolerance)
        extend(search, NOTHING)
    assert begun == [(frozenset({"mark-offset"}), {"mark-offset": (0.2, -0.1, 3.0)})]


def test_what_the_user_asks_for_is_fitted_whatever_is_promised_of_it(
    faster: tuple[Search, Point], monkeypatch: pytest.MonkeyPatch
) -> None:
    empty, nominal = faster
    monkeypatch.setattr(strategy, "PROMISING", 1e9)
    for asked in (NOTHING, frozenset({"mark-offset"})):
        search = empty.anew(asked=asked)
        search.fits[NOTHING] = fit_model(search.problem, nominal, [], search.tolerance)
        extend(search, NOTHING)
        assert set(search.fits) == {NOTHING, *({asked} if asked else ())}
    search = empty.anew()
    search.fits[NOTHING] = fit_model(search.problem, nominal, [], search.tolerance)
    extend(search, NOTHING, {"mark-offset", "rolling-drag"}, 1, regardless=True)
    assert len(search.fits) == 2


def test_a_time_constant_of_milliseconds_is_seen_on_a_plate_where_a_later_start_explains_the_delay(
    tmp_path: Path,
) -> None:
    """At no delay the share of the time constant has no slope, and the delay has that of the start of all runs."""
    session = hidden_session(tmp_path, {"command-lag": {"dead_time_s": 0.0, "time_constant_s": 0.02}}, exact=True)
    terms = {"command-lag": named_terms(20.0, (30.0, 60.0))["command-lag"]}
    problem, nominal = build_problem(session.data, Simulated(session.robots, session.data, terms))
    search = Search(problem, terms, session.tolerance, tuple(range(len(session.data))))
    search.fits[NOTHING] = fit_model(problem, nominal, [], search.tolerance)
    view = screen(search, search.null.point, (), terms.values())
    (offer,) = view.offers
    assert len(offer[1]) == 2
    assert view.columns[offer[1][0]].start == (0.02, 0.5)
    fitted = fit_set(search, frozenset(terms), {"command-lag": view.start_of(offer)}, search.null)
    assert fitted is not None
    found = terms["command-lag"].physical(fitted.point.terms["command-lag"])
    assert found["time_constant_s"] == pytest.approx(0.02, rel=0.2)


def test_a_candidate_that_begins_where_it_acts_is_promised_what_its_fit_brings(tmp_path: Path) -> None:
    """Late motors are looked for from delays of 0.05 and 0.3 s; slopes there say nothing of what that delay gains."""
    session = hidden_session(tmp_path, {"command-lag": {"dead_time_s": 0.2, "time_constant_s": 0.2}}, exact=True)
    term = EFFECTS["command-lag"].candidate(Scene(20.0, (), Size(length=100.0)))
    problem, nominal = build_problem(session.data, Simulated(session.robots, session.data, {term.id: term}))
    search = Search(problem, {term.id: term}, session.tolerance, tuple(range(len(session.data))))
    search.fits[NOTHING] = fit_model(problem, nominal, [], search.tolerance)
    view = screen(search, search.null.point, (), [term])
    offer = max(view.offers, key=view.evidence)
    assert view.columns[offer[1][0]].start == (0.3, 0.5)
    assert view.start_of(offer)[0] == pytest.approx(0.4, abs=0.03)
    found = fit_set(search, frozenset({term.id}), {term.id: view.start_of(offer)}, search.null)
    assert found is not None
    gain = found.posterior.log_evidence - search.null.posterior.log_evidence
    assert view.evidence(offer) - view.evidence() == pytest.approx(gain, rel=0.2)


def test_friction_under_single_wheels_adds_up_to_that_of_the_run(faster: tuple[Search, Point]) -> None:
    search, nominal = faster
    problem = search.problem
    (known, wander), *_ = friction_shifts(problem, nominal, [0])
    assert wander.shape == (MODES, *known.shape[1:])
    assert np.abs(wander[-1]).max() > 10 * np.abs(wander[0]).max()  # the largest mode stands last
    step = float(problem.per_run_steps[FRICTION])
    changes = [{wheel.id: (step,)} for wheel in wheel_friction(4)]
    marks = problem.forward.marks([nominal.task(0), *(replace(nominal, terms=terms).task(0) for terms in changes)])
    base, *changed = (channels_of(part)[problem.compressions[0].used] for part in marks)
    by_wheel = [channel_residual(part, base, problem.half_distance_mm) / step for part in changed]
    assert np.abs(np.sum(by_wheel, axis=0) - known[3]).max() < 0.05 * np.abs(by_wheel).max()


def test_a_search_from_a_large_misfit_owes_the_plate_what_is_usual(
    faster: tuple[Search, Point], monkeypatch: pytest.MonkeyPatch
) -> None:
    search, nominal = faster
    begun: list[Problem] = []
    monkeypatch.setattr(search_runs, "is_large", lambda *_: True)
    monkeypatch.setattr(search_runs, "recalibrated", lambda *_: nominal)
    monkeypatch.setattr(search_runs, "short_horizon_fits", lambda *_: ())
    monkeypatch.setattr(search_runs, "run_search", lambda part, *_: begun.append(part.problem))
    ready = Prepared(search.problem, nominal, search.tolerance, search.terms)
    search_runs.search_named(ready, no_progress)
    assert (begun[0].common_drift, begun[0].friction_wander) == (usual_drift(1.0), USUAL_WANDER)
    assert all(part.ground is not None for part in begun[0].compressions)
