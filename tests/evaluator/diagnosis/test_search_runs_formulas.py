"""Which sets the stages of a search fit again, from where, and what they keep: stand-ins instead of fits."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis import search_runs
from evaluator.diagnosis.assessment.verdict import UNDECIDED
from evaluator.diagnosis.inference.search import MOST_STEPS, Search
from evaluator.diagnosis.likelihood.point import Point
from evaluator.progress import no_progress

NONE = frozenset[str]()


def sets(*names: str) -> list[frozenset[str]]:
    return [frozenset(name) for name in names]


def fit_of(evidence: float, name: str = "", **terms: Any) -> Any:
    point = Point(np.zeros((2, 7)), {}, terms)
    posterior = SimpleNamespace(log_evidence=evidence)
    return SimpleNamespace(posterior=posterior, point=point, name=name, converged=True, excess=9.0)


@dataclass(frozen=True)
class Fitted:
    """A converged fit that `replace` can change."""

    terms: frozenset[str]
    point: Point
    posterior: Any
    excess: float
    converged: bool = True


def searching(fits: dict[str, float], **more: Any) -> Search:
    """A search with fits of these log evidences, of effects with one letter each; d is stepwise."""
    terms: Any = {name: SimpleNamespace(id=name, stepwise=name == "d") for name in "abcdefghijkl"}
    made = {frozenset(name): fit_of(value, name, **dict.fromkeys(name, (value,))) for name, value in fits.items()}
    problem: Any = SimpleNamespace(open_ground=False, data=(None, None), field_of_view=7.0, **more.pop("world", {}))
    return Search(problem, terms, {"key": 1.0}, (0,), fits=made, **more)


@pytest.fixture
def fitted(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Sets that are fitted, with the name of the fit that each begins at; none succeeds."""
    asked: list[Any] = []

    def note(_: Search, ids: frozenset[str], starts: Any, origin: Any, *rest: Any) -> None:
        asked.append(("".join(sorted(ids)), origin.name, dict(starts), rest))

    monkeypatch.setattr(search_runs, "fit_set", note)
    return asked


def test_effects_near_one_of_the_best_set_are_fitted_in_its_place_the_nearest_four(
    fitted: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    near = {"": 1.0, "b": 9.9, "c": 10.1, "d": 2.0, "e": 3.0, "f": 4.0, "g": 5.0, "h": 6.0}
    apart = {"a": near, "i": {"e": 1.0, "k": 2.0}}
    asked: list[Any] = []
    monkeypatch.setattr(search_runs, "separations", lambda *given: asked.append(given[1:]) or apart)
    part = searching({"": 0.0, "ai": 9.0, "fi": 1.0}, failed={frozenset("gi"): None})
    search_runs._swap(part)
    assert asked == [(frozenset("ai"), 0)]
    # of a the stepwise d is left out, f and g are known already, b is the fifth; each begins at the best set
    assert [(ids, begin) for ids, begin, *_ in fitted] == [("ei", "ai"), ("hi", "ai"), ("ae", "ai"), ("ak", "ai")]
    fitted.clear()
    apart = {"a": {"b": 9.9, "c": 10.1}}
    search_runs._swap(searching({"": 0.0, "a": 9.0}))
    assert [(ids, begin) for ids, begin, *_ in fitted] == [("b", "")]  # a single one begins at the null
    search_runs._swap(searching({"": 0.0, "a": 9.0}, steps=MOST_STEPS))
    search_runs._swap(searching({"": 9.0, "a": 0.0}))
    assert len(fitted) == 1


def test_the_four_best_sets_and_what_is_left_of_them_without_an_effect_are_fitted_to_all_runs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[Any] = []

    def fit_set(whole: Search, ids: frozenset[str], starts: Any, origin: Any, rival: float = -np.inf) -> None:
        asked.append(("".join(sorted(ids)), origin.name, {name: value[0] for name, value in starts.items()}, rival))
        if ids == frozenset(lost):
            whole.failed[ids] = None
        else:
            whole.fits[ids] = fit_of(50.0, f"{''.join(sorted(ids))} again", **dict.fromkeys(ids, (7.0,)))

    lost = "x"
    monkeypatch.setattr(search_runs, "fit_set", fit_set)
    monkeypatch.setattr(search_runs, "fit_model", lambda *given: fit_of(0.0, f"null of {len(given[4])}"))
    monkeypatch.setattr(Search, "explained", property(lambda _: 5.0))
    part = searching({"": 10.0, "ab": 90.0, "b": 60.0, "c": 50.0, "e": 1.0})
    whole = search_runs.fit_on_all_runs(part, part.terms)
    assert (whole.runs, whole.null.name) == ((0, 1), "null of 2")
    assert asked == [
        ("ab", "ab", {"a": 90.0, "b": 90.0}, -np.inf), ("b", "b", {"b": 60.0}, -np.inf),
        ("c", "c", {"c": 50.0}, -np.inf), ("a", "ab again", {"a": 7.0}, 5.0),
    ]  # fmt: skip
    lost = "ab"  # the best set does not explain a run that was held out
    kept = search_runs.fit_on_all_runs(part, part.terms)
    assert (kept.runs, kept.fits) == ((0,), part.fits)
    lost = "c"
    assert frozenset("ab") in search_runs.fit_on_all_runs(part, part.terms).fits
    asked.clear()  # where nothing explains the runs, no effect is asked whether it is needed
    monkeypatch.setattr(Search, "explained", property(lambda _: -np.inf))
    search_runs.fit_on_all_runs(part, part.terms)
    assert [ids for ids, *_ in asked] == ["ab", "b", "c"]


def test_each_effect_of_the_best_set_is_tested_by_a_fit_without_it_until_the_best_stays(
    fitted: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = iter(sets("abc", "ab", "ab"))
    monkeypatch.setattr(search_runs, "standing", lambda *given: given)
    monkeypatch.setattr(search_runs, "best_named", lambda *_: next(answers))
    search = searching({"": 0.0, "ab": 2.0, "abc": 3.0})
    table, best = search_runs.rank_named(search, 26)
    assert (table, best) == ((search, 26), frozenset("ab"))
    assert [(ids, begin) for ids, begin, *_ in fitted] == [
        *(("bc", "abc"), ("ac", "abc"), ("ab", "abc"), ("b", "ab"), ("a", "ab")),
    ]
    swinging = iter(sets(*"abababab"))
    monkeypatch.setattr(search_runs, "best_named", lambda *_: next(swinging))
    search_runs.rank_named(searching({"": 0.0, "a": 1.0, "b": 1.0}), 26)
    assert len(list(swinging)) == 4  # asked once, and three times again at most


def test_noise_is_settled_twice_at_most_and_the_search_goes_on_from_its_four_best_fits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ran: list[Any] = []
    worlds: list[Any] = []
    monkeypatch.setattr(search_runs, "well_founded", lambda part: (part.ranked()[0], "noise"))
    monkeypatch.setattr(search_runs, "settled_noise", lambda *_: worlds.pop(0) if worlds else None)

    def run_search(part: Search, _: Point, nominal: Any, __: Any, seeds: Any) -> None:
        ran.append((part.problem, nominal, [seed.name for seed in seeds]))
        part.fits.update({NONE: fit_of(1.0), frozenset("a"): fit_of(40.0, "anew")})

    monkeypatch.setattr(search_runs, "run_search", run_search)
    # less noise shows values that more hid
    monkeypatch.setattr(search_runs, "visible_tolerances", lambda problem, _, stated: {**stated, "at": problem})
    ready: Any = SimpleNamespace(start="nominal", stated={"stated": 0.05})
    first = {"": 0.0, "a": 40.0, "b": 30.0, "c": 20.0, "e": 10.0}
    for given, rounds in (([], 0), (["one"], 1), (["one", "two", "three"], 2)):
        ran.clear()
        worlds[:] = given
        part = search_runs._with_settled_noise(searching(first), ready, no_progress)
        assert [problem for problem, *_ in ran] == given[:rounds]
        assert (part.problem in given) == bool(rounds)
        assert not rounds or part.tolerance == {"stated": 0.05, "at": given[rounds - 1]}
    assert ran[0] == ("one", "nominal", ["a", "b", "c", "e"])
    assert ran[1][2][0] == "anew"
    pairs = {"": 0.0, "a": 40.0, "b": 30.0, "ac": 50.0, "ae": 49.0, "be": 48.0, "ce": 47.0}
    ran.clear()
    worlds[:] = ["one"]
    search_runs._with_settled_noise(searching(pairs), ready, no_progress)
    assert ran[0][2] == ["a", "b", "ac", "ae", "be", "ce"]  # single effects, which the additions displaced


@pytest.mark.parametrize(
    ("gains", "found", "tried"),
    [
        ([9.0, 6.1, 5.9, 7.0], 100.0, "031"),
        ([20.0 - k for k in range(9)], 76.0, "01234567"),  # eight at most
        ([20.0 - k for k in range(9)], 74.0, "012"),  # three that are far below the best end it
        ([20.0 - k for k in range(9)], None, "012"),
    ],
)
def test_free_form_terms_that_promise_a_gain_are_fitted_until_three_are_hopeless(
    gains: list[float], found: float | None, tried: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[frozenset[str]] = []
    offers = [(f"{k}", ()) for k in range(len(gains))]

    def evidence(*offer: Any) -> float:
        return 40.0 + (gains[offers.index(offer[0])] if offer else 0.0)

    view = SimpleNamespace(evidence=evidence, offers=offers, start_of=lambda offer: offer[0])
    monkeypatch.setattr(search_runs, "screen", lambda *_: view)
    monkeypatch.setattr(search_runs, "rank_named", lambda *_: (None, NONE))
    monkeypatch.setattr(search_runs, "fit_null_from_rivals", lambda _: None)
    result = None if found is None else fit_of(found)
    monkeypatch.setattr(search_runs, "fit_set", lambda _, ids, *__: asked.append(ids) or result)
    search = searching({"": 100.0})
    search_runs.challenge_with_free_terms(search, {}, no_progress)
    assert "".join(next(iter(ids)) for ids in asked) == tried
    asked.clear()
    search.steps = MOST_STEPS
    search_runs.challenge_with_free_terms(search, {}, no_progress)
    assert asked == []


@pytest.mark.parametrize(("gain", "paid"), [(UNDECIDED + 0.1, True), (UNDECIDED - 0.1, False), (None, False)])
def test_an_effect_that_relieves_a_quantity_must_pay_for_itself(
    gain: float | None, paid: bool, fitted: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    scores = {NONE: 10.0, frozenset("a"): 10.0 + (gain or 0.0)}
    monkeypatch.setattr(search_runs, "score", lambda _, ids, families: scores[ids] + 0 * families)
    search = searching({"": 0.0} if gain is None else {"": 0.0, "a": 1.0})
    assert search_runs._pays_for_itself(search, frozenset("a"), NONE, 26) is paid
    assert len(fitted) == (gain is None)


def test_the_quantity_that_is_farthest_beyond_its_tolerance_is_named_first(
    fitted: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def item(found: float, sigma: float, alike: str | None, *, off: bool = True) -> Any:
        return SimpleNamespace(found=found, quantity=SimpleNamespace(sigma=sigma), alike=alike, is_finding=off)

    known = [item(4.0, 1.0, "a"), item(-3.0, 0.5, "b"), item(90.0, 1.0, "c", off=False), item(9.0, 1.0, None)]
    monkeypatch.setattr(search_runs, "knowledge", lambda *_: known)
    tried: list[str] = []

    def pays(_: Search, more: frozenset[str], ids: frozenset[str], __: int) -> bool:
        tried.append("".join(more - ids))
        return tried[-1] in paying

    monkeypatch.setattr(search_runs, "_pays_for_itself", pays)
    for accepted, names, asked in (("", "", "ba"), ("b", "b", "ba"), ("a", "a", "bab"), ("ab", "ab", "ba")):
        paying = accepted
        tried.clear()
        search = searching({"": 0.0, "a": 0.0, "b": 0.0, "ab": 0.0})
        assert search_runs.name_what_is_off(search, NONE, [], 26) == frozenset(names)
        assert "".join(tried) == asked
    search.problem.open_ground = True
    assert search_runs.name_what_is_off(search, NONE, [], 26) == NONE
    assert fitted == []


@pytest.mark.parametrize(
    ("misses", "steps"),
    [
        ([False], ["drift"]),
        ([True, False], ["recalibrated", "noise of 1", "drift"]),
        ([True, True], ["recalibrated", "noise of 1", "noise of 1", "seconds first"]),
    ],
)
def test_a_search_begins_with_seconds_where_recalibration_does_not_bring_the_model_near(
    misses: list[bool], steps: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []
    said = iter(misses)
    problem = searching({}).problem
    start, near = Point(np.zeros((2, 7))), Point(np.ones((2, 7)))
    monkeypatch.setattr(search_runs, "fitted_runs", lambda _: (0,))
    monkeypatch.setattr(search_runs, "is_large", lambda *_: next(said))
    monkeypatch.setattr(search_runs, "is_implausible", lambda _: False)
    monkeypatch.setattr(search_runs, "recalibrated", lambda *_: done.append("recalibrated") or near)
    monkeypatch.setattr(search_runs, "replace", lambda item, **_: item)
    monkeypatch.setattr(
        search_runs, "with_noise_of", lambda it, at: done.append(f"noise of {at.per_run[0, 0]:.0f}") or it
    )
    monkeypatch.setattr(search_runs, "_with_drift", lambda part, begin: done.append("drift") or (part, begin))
    monkeypatch.setattr(search_runs, "short_horizon_fits", lambda *_: done.append("seconds first") or ("short",))
    monkeypatch.setattr(search_runs, "diverging_beyond", lambda *_: [])
    ran: list[Any] = []
    monkeypatch.setattr(
        search_runs, "run_search", lambda _, begin, nominal, __, seeds: ran.append((begin, nominal, seeds))
    )
    ready: Any = SimpleNamespace(problem=problem, start=start, named={}, tolerance={}, own=frozenset("a"))
    assert search_runs.search_named(ready, no_progress).asked == frozenset("a")
    assert done == steps
    assert ran == [(near if len(misses) > 1 else start, start, ("short",) if all(misses) else ())]


def test_a_search_with_seeds_takes_them_in_place_of_the_first_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    """And typical drift, because the null's is that of a misfit that the seeds explain."""
    monkeypatch.setattr(search_runs, "fitted_runs", lambda _: (0,))
    for misses in ([False], [True, True]):
        said = iter(misses)
        monkeypatch.setattr(search_runs, "is_large", lambda *_, said=said: next(said))
        monkeypatch.setattr(search_runs, "recalibrated", lambda *_: Point(np.ones((2, 7))))
        monkeypatch.setattr(search_runs, "replace", lambda item, **_: item)
        monkeypatch.setattr(search_runs, "with_noise_of", lambda item, _: item)
        seeds: list[Any] = []
        monkeypatch.setattr(search_runs, "run_search", lambda *given, seeds=seeds: seeds.append(given[-1]))
        start = Point(np.zeros((2, 7)))
        ready: Any = SimpleNamespace(problem=searching({}).problem, start=start, named={}, tolerance={}, own=NONE)
        search_runs.search_named(ready, no_progress, ["seed"])  # type: ignore[list-item]
        assert seeds == [["seed"]]


@pytest.mark.parametrize("explains", [False, True])
def test_fits_of_a_search_that_explains_its_runs_go_on_without_some_of_them(explains: bool) -> None:
    part = searching({"": -9.0, "a": -5.0, "ab": -1.0})
    part.problem.data = (None, None, None)
    for fit in part.fits.values():
        fit.excess = 0.0 if explains else 9.0
    made: Any = {
        ids: Fitted(
            frozenset(ids), Point(np.arange(21.0).reshape(3, 7), {}, fit.point.terms), fit.posterior, fit.excess
        )
        for ids, fit in part.fits.items()
    }
    part.fits.clear()
    part.fits.update(made)
    found = search_runs.seeds_without(part, [1])
    assert [fit.terms for fit in found] == ([frozenset("ab"), frozenset("a")] if explains else [])
    for fit in found:
        np.testing.assert_array_equal(fit.point.per_run, np.arange(21.0).reshape(3, 7)[[0, 2]])


@pytest.mark.parametrize(("nearest", "fitted"), [(0.4, True), (-0.4, True), (0.6, False)])
def test_a_set_is_fitted_without_an_effect_from_where_a_profile_brings_it_near_its_absence(
    nearest: float, fitted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A level of friction stood beside magnets, though its interval contained no effect: fits have several optima."""
    search = searching({"": 0.0, "ab": 9.0})
    for name in "ab":
        term: Any = SimpleNamespace(id=name, stepwise=False, coordinates=(None,) * (1 + (name == "b")))
        search.terms[name] = term  # type: ignore[index]
    columns = [SimpleNamespace(key=name) for name in "ab"]
    starts: list[Any] = []
    point = SimpleNamespace(value=lambda _: 1.0, at=lambda _, at: Point(np.zeros((2, 7)), {}, {"b": tuple(at)}))
    fit: Any = SimpleNamespace(columns=columns, point=point)
    search.fits[frozenset("ab")] = fit
    monkeypatch.setattr(search_runs, "replace", lambda _, point: point)

    def fit_set(search: Search, ids: frozenset[str], values: Any, origin: Any) -> None:
        starts.append((ids, values, origin.terms))
        search.fits[ids] = fit

    monkeypatch.setattr(search_runs, "fit_set", fit_set)
    profile: Any = SimpleNamespace(best=np.array([[1.0, 5.0], [nearest, 7.0], [2.0, 8.0]]))
    better = search_runs.fitted_where_absent(search, frozenset("ab"), {"b": profile})
    assert better == fitted  # of the effect with two coordinates none is left out
    assert starts == fitted * [(frozenset("b"), {"b": (nearest, 7.0)}, {"b": (nearest, 7.0)})]


def test_a_robot_that_recalibration_makes_implausible_is_searched_by_seconds_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    said = iter([True, False])
    monkeypatch.setattr(search_runs, "fitted_runs", lambda _: (0,))
    for name, answer in (("is_large", lambda *_: next(said)), ("is_implausible", lambda _: True)):
        monkeypatch.setattr(search_runs, name, answer)
    monkeypatch.setattr(search_runs, "recalibrated", lambda *_: Point(np.ones((2, 7))))
    monkeypatch.setattr(search_runs, "replace", lambda item, **_: item)
    monkeypatch.setattr(search_runs, "with_noise_of", lambda item, _: item)
    short: Any = SimpleNamespace(terms=frozenset("a"))
    monkeypatch.setattr(search_runs, "short_horizon_fits", lambda *_: (short,))
    diverging: list[int] = []
    monkeypatch.setattr(search_runs, "diverging_beyond", lambda *_: diverging)
    seeds: list[Any] = []
    monkeypatch.setattr(search_runs, "run_search", lambda *given: seeds.append(given[-1]))
    ready: Any = SimpleNamespace(problem=searching({}).problem, start=None, named={}, tolerance={}, own=NONE)
    search_runs.search_named(ready, no_progress)
    assert seeds == [(short,)]
    diverging.append(1)
    begun = searching({})
    monkeypatch.setattr(
        search_runs, "replace", lambda item, **more: replace(item, **more) if item is begun and "fits" in more else item
    )
    monkeypatch.setattr(search_runs, "_begun", lambda *_: (begun, None, True))
    part = search_runs.search_named(ready, no_progress)
    assert (part.fits, part.diverging, len(seeds)) == ({short.terms: short}, (1,), 1)  # without a search of whole runs


@pytest.mark.parametrize("succeeds", [True, False])
def test_a_set_is_fitted_without_held_out_runs_from_its_fit_to_all_which_stands_where_that_fails(
    monkeypatch: pytest.MonkeyPatch, *, succeeds: bool
) -> None:
    asked: list[Any] = []
    found = fit_of(3.0, "fitted") if succeeds else None
    monkeypatch.setattr(search_runs, "fit_set", lambda *given: asked.append(given) or found)
    part = searching({"": 0.0})
    part.tolerance = {"other": 2.0}
    whole = searching({"": 0.0, "a": 5.0})
    whole.runs = (0, 1)
    source = whole.fits[frozenset("a")]
    assert search_runs.refit_without_held_out(part, whole, frozenset("a")) is (found or source)
    ((search, ids, starts, origin),) = asked
    assert (search.runs, search.tolerance, search.fits) == ((0,), {"other": 2.0}, {})
    assert (ids, starts, origin) == (frozenset("a"), {"a": (5.0,)}, source)
