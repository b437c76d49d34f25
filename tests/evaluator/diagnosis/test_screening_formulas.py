"""What is linearized in a screening, from where sets are fitted, and how far a fit goes without new slopes."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.inference import fit as fits
from evaluator.diagnosis.inference import screening, strategy
from evaluator.diagnosis.inference.descent.steps import line_search
from evaluator.diagnosis.inference.fit import _carried_on
from evaluator.diagnosis.inference.fitted_model import Fit
from evaluator.diagnosis.inference.screening import Screen, screen
from evaluator.diagnosis.inference.search import Search
from evaluator.diagnosis.likelihood.point import Column, Point
from evaluator.progress import no_progress
from simulator.effects.coordinates import Candidate, Coordinate

NONE = frozenset[str]()


def candidate(name: str, count: int, **more: Any) -> Candidate:
    return Candidate(name, tuple(Coordinate("xyz"[k], 0.0, 1.0) for k in range(count)), dict, **more)


PLAIN = candidate("plain", 2)
SPOT = candidate("spot", 3, starts=((0.0, 3.0, 4.0), (2.0, 5.0, 6.0)))  # at the first it does not act
STEPS = candidate("steps", 1, starts=((5.0,), (7.0,)), stepwise=True)


class Model:
    """A mixed model whose means of whole changes are those that are asked for."""

    wanted: dict[int, float]

    def __init__(self, runs: Any, prior: Any) -> None:
        self.runs, self.prior = runs, prior

    def given(self, base: tuple[int, ...]) -> Any:
        self.base = base
        return self

    def posterior(self, extra: tuple[int, ...]) -> Any:
        return SimpleNamespace(mean=np.array([self.wanted[extra[-1]]]))


def test_a_screening_has_a_column_of_each_value_coordinate_and_place_at_which_an_effect_begins(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[Any] = []
    problem: Any = SimpleNamespace(linearized=lambda *given: asked.append(given) or "views", given=())
    tolerance = {"wheels.track_mm": 0.05, "body.mass_g": 0.0}
    search = Search(problem, {"inside": PLAIN}, tolerance, (0, 2))
    search.terms = {"plain": PLAIN, "spot": SPOT, "steps": STEPS}
    monkeypatch.setattr(screening, "reduce_runs", lambda views: views)
    monkeypatch.setattr(screening, "MixedModel", Model)
    monkeypatch.setattr(Model, "wanted", {8: 1.0, 9: 0.4}, raising=False)
    point: Any = "point"
    view = screen(search, point, ("plain",), (PLAIN, SPOT, STEPS))
    columns = (
        Column("wheels.track_mm"),
        *(Column("plain", 0, PLAIN), Column("plain", 1, PLAIN)),
        Column("spot", 0, SPOT, (0.0, 3.0, 4.0)),  # of where it would act nothing else shows
        *(Column("spot", k, SPOT, (2.0, 5.0, 6.0)) for k in range(3)),
        Column("spot", 0, SPOT, to=(2.0, 5.0, 6.0)),
        *(Column("steps", 0, STEPS, to=(5.0,)), Column("steps", 0, STEPS, to=(7.0,))),
    )
    assert view.columns == columns
    assert asked == [("point", list(columns), (0, 2))]
    assert view.base == (0, 1, 2)
    assert view.model.prior.tolist() == pytest.approx([400.0, *[0.0] * 9])
    assert view.offers == (("spot", (3,)), ("spot", (4, 5, 6)), ("steps", (8,)))  # of the last less than half is wanted
    assert view.whole == {4: 7}


def test_an_effect_pays_for_all_of_its_parameters_also_for_those_that_are_not_varied_yet() -> None:
    """Half the logarithm of the runs each: else a place where nothing else shows would make an effect simpler."""
    asked: list[Any] = []
    model: Any = SimpleNamespace(runs=20, log_evidence=lambda columns: asked.append(columns) or 10.0)
    model.taken = lambda _: model
    columns = (Column("plain", 0, PLAIN), Column("plain", 1, PLAIN), Column("spot", 0, SPOT, (0.0, 3.0, 4.0)))
    whole, part = ("plain", (0, 1)), ("spot", (2,))
    view = Screen(columns, model, model, (), (whole, part), {})
    assert view.evidence(whole) == 10.0
    assert view.evidence(part) == view.evidence(whole, part) == pytest.approx(10.0 - np.log(20))
    assert asked == [[0, 1], [2], [0, 1, 2]]


class Promises:
    """A screening that promises evidence by the places of its offers."""

    offers = (("a", (0,)), ("b", (1,)), ("a", (2,)), ("c", (3,)), ("d", (4,)))
    promised = (9.0, 7.0, 8.0, 5.0, 6.0)

    def evidence(self, *offers: tuple[str, tuple[int, ...]]) -> float:
        return sum(self.promised[place] for _, (place,) in offers)

    def start_of(self, offer: tuple[str, tuple[int, ...]]) -> tuple[float, ...]:
        return (self.promised[offer[1][0]],)


def promising(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Let every screening of a search promise the same; returns what is screened. A fit from a point is a pair."""
    screened: list[Any] = []
    monkeypatch.setattr(strategy, "screen", lambda *given: screened.append(given) or Promises())
    monkeypatch.setattr(strategy, "replace", lambda fit, point: (fit, point))
    return screened


def searching(**more: Any) -> Search:
    null = SimpleNamespace(point=Point(np.zeros((2, 7))), terms=NONE, steps=1, converged=True, excess=9.0)
    null.posterior = SimpleNamespace(log_evidence=0.0)
    terms: Any = {name: SimpleNamespace(stepwise=name in "cd") for name in "abcd"}
    problem: Any = SimpleNamespace(open_ground=False, horizon_s=np.inf)
    return Search(problem, terms, {}, (0, 1), fits={NONE: null, **more})  # type: ignore[dict-item]


def test_what_the_file_of_the_robot_promises_is_fitted_from_there_unless_it_is_fitted_already(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The three best effects, and of these the places of all that were not fitted, smooth ones alone."""
    screened, asked = promising(monkeypatch), list[Any]()
    monkeypatch.setattr(strategy, "_refit", lambda *given: asked.append(given[2:]))
    search, nominal = searching(), Point(np.ones((2, 7)))
    search.fits[frozenset("b")] = search.null
    strategy._from_the_nominal(search, nominal)
    assert screened == [(search, nominal, (), [search.terms["a"], search.terms["b"]])]
    assert asked == [([(("a", (0,)),), (("a", (2,)),), (("d", (4,)),)], 3, (search.null, nominal))]


def test_whole_changes_are_fitted_from_the_file_of_the_robot_the_two_best(monkeypatch: pytest.MonkeyPatch) -> None:
    screened, asked = promising(monkeypatch), list[Any]()
    monkeypatch.setattr(strategy, "fit_set", lambda *given: asked.append(given[1:]))
    search, nominal = searching(), Point(np.ones((2, 7)))
    strategy._fit_whole_changes(search, nominal)
    assert screened == [(search, nominal, (), [search.terms["c"], search.terms["d"]])]
    assert asked == [
        (frozenset("a"), {"a": (9.0,)}, (search.null, nominal)),
        (frozenset("a"), {"a": (8.0,)}, (search.null, nominal)),
    ]


@pytest.mark.parametrize(
    ("promised", "better", "seen", "reached"),
    [
        ([1.1], "", 2, 0.0),  # more than a tenth of what was promised before: slopes are wrong
        ([0.9, 0.1], "y", 2, 1.0),
        ([0.9, 0.08], "n", 2, 0.0),  # no better there
        ([0.9, 0.21, 0.1], "yy", 2, 1.0),  # more than a tenth of 0.9
        ([4.0, 0.39, 0.3], "yy", 2, 2.0),
        ([0.19], "", 2, 0.0),  # settled
        ([0.9], "", 1, 0.0),  # a run cannot be simulated
    ],
)
def test_a_fit_goes_on_with_its_slopes_while_a_tenth_is_promised_of_what_was_promised_before(
    promised: list[float], better: str, seen: int, reached: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = 10.0 if promised[0] < 4.0 else 50.0
    coming, answers, shares = iter(promised), iter(better), []

    def further(_: Any, before: Any, __: Any, dampings: Any) -> tuple[Point, bool]:
        shares.append(dampings)
        place = before.point
        return Point(place.per_run + 1.0), next(answers) == "y"

    start = Point(np.zeros((2, 7)))
    fit = Fit(NONE, start, (), SimpleNamespace(), SimpleNamespace(), ("one", "two"), False, (0, 1))  # type: ignore[arg-type]
    views = ["one", "two"] if seen == 2 else ["one", None]
    problem: Any = SimpleNamespace(per_run_steps=np.ones(7), seen_again=lambda *_: views)
    monkeypatch.setattr(fits, "secant", lambda *given: given[1])
    monkeypatch.setattr(fits, "reduce_runs", lambda given: given)
    monkeypatch.setattr(fits, "_optimum", lambda *_: SimpleNamespace(predicted=next(coming)))
    monkeypatch.setattr(fits, "line_search", further)
    optimum: Any = SimpleNamespace(predicted=first)
    found = _carried_on(problem, fit, optimum, start, {}, np.array(np.inf))
    assert found.per_run[0, 0] == reached
    assert set(shares) <= {(1.0,)}


def test_a_search_can_be_stopped_between_two_trials_of_a_step() -> None:
    def look() -> None:
        raise KeyboardInterrupt

    problem: Any = SimpleNamespace(watch=SimpleNamespace(look=look))
    with pytest.raises(KeyboardInterrupt):
        line_search(problem, SimpleNamespace(), SimpleNamespace())  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("begun", "converged", "horizon_s", "steps"),
    [
        (None, False, np.inf, ["whole", "null", "nominal"]),
        (9.0, True, np.inf, ["whole", "null", "nominal"]),
        (9.0, False, np.inf, ["whole", "nominal"]),  # a null that did not converge misleads
        (-9.0, False, np.inf, ["whole", "null", "nominal"]),  # unless all others explain even less
        (None, True, 2.5, ["whole", "null"]),
    ],
)
def test_a_search_screens_at_the_null_unless_it_misleads_and_at_the_file_over_whole_runs(
    begun: float | None, converged: bool, horizon_s: float, steps: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []

    def whole(search: Search, _: Any) -> None:
        done.append("whole")
        if begun is not None:
            fit: Any = SimpleNamespace(**vars(search.null) | {"posterior": SimpleNamespace(log_evidence=begun)})
            search.fits[frozenset("a")] = fit

    search = searching()
    null: Any = search.null
    null.converged, search.problem.horizon_s = converged, horizon_s  # type: ignore[misc]
    monkeypatch.setattr(strategy, "fit_model", lambda *_: null)
    monkeypatch.setattr(strategy, "_fit_whole_changes", whole)
    monkeypatch.setattr(strategy, "_from_the_null", lambda _: done.append("null"))
    monkeypatch.setattr(strategy, "_from_the_nominal", lambda *_: done.append("nominal"))
    monkeypatch.setattr(strategy, "extend", lambda *_: None)
    strategy.run_search(search, null.point, null.point, no_progress)
    assert done == steps


@pytest.mark.parametrize(("evidence", "screens"), [(1.0, False), (-1.0, True)])
def test_a_search_that_begins_with_what_explains_less_than_nothing_added_screens_all_again(
    evidence: float, *, screens: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A robot that stands still in the model: the fit converges, far below the null, and no effect was tried then."""
    search, done = searching(), list[str]()
    null: Any = search.null
    null.converged = False
    seed: Any = SimpleNamespace(**vars(null) | {"terms": frozenset("a"), "point": Point(null.point.per_run)})
    seed.posterior = SimpleNamespace(log_evidence=evidence)
    monkeypatch.setattr(strategy, "fit_model", lambda *_: null)
    monkeypatch.setattr(strategy, "fit_set", lambda search, ids, *_: search.fits.update({ids: seed}))
    for name in ("_fit_whole_changes", "_from_the_null", "_from_the_nominal"):
        monkeypatch.setattr(strategy, name, lambda *_, name=name: done.append(name))
    monkeypatch.setattr(strategy, "extend", lambda *_: None)
    strategy.run_search(search, null.point, null.point, no_progress, [seed])
    assert done == (["_fit_whole_changes", "_from_the_null", "_from_the_nominal"] if screens else [])
