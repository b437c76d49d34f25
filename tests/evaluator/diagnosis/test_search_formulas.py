"""What a search screens, fits and keeps, worked out on paper, without a simulation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.inference import strategy
from evaluator.diagnosis.inference.fit_cache import question_of
from evaluator.diagnosis.inference.screening import Screen, _wants_whole_change
from evaluator.diagnosis.inference.search import Search, fit_set
from evaluator.diagnosis.inference.short_horizon import is_large, within
from evaluator.diagnosis.inference.watch import Watch
from evaluator.diagnosis.likelihood.point import Column, Point
from simulator.effects.coordinates import Coordinate
from tests.evaluator.diagnosis.searches import LINE, NONE, candidate, of, searching

A = frozenset({"a"})


@pytest.mark.parametrize(
    ("x_mm", "turn_rad", "length", "large"),
    [
        (0.9, 0.0, 1.0, False),
        (1.1, 0.0, 1.0, True),
        (0.0, 0.09, 1.0, False),
        (0.0, 0.11, 1.0, True),
        (90.0, 0.0, 100.0, False),  # of a robot a hundred times as long
        (110.0, 0.0, 100.0, True),
    ],
)
def test_a_search_begins_with_seconds_where_a_run_misses_by_a_millimetre_or_a_tenth_of_a_radian(
    x_mm: float, turn_rad: float, length: float, large: bool
) -> None:
    odd = np.tile([0.6 * x_mm, 0.8 * x_mm, 1.83 * turn_rad, 0.0], (9, 1))
    odd[3] = np.nan
    runs: Any = SimpleNamespace(
        data=[None, None], residuals=lambda _: [np.zeros((9, 4)), odd], half_distance_mm=1.83, length=length
    )
    point: Any = SimpleNamespace(task=lambda run: run)
    assert is_large(runs, point) == large


def test_horizons_are_shorter_than_the_longest_run_after_its_start() -> None:
    runs = [SimpleNamespace(time_s=np.array([0.0, end]), start_s=start) for start, end in ((0.5, 3.0), (1.0, 2.0))]
    timed: Any = SimpleNamespace(data=runs)
    assert within(timed, (1.0, 2.4, 2.6)) == [1.0, 2.4]
    runs[0].start_s = -5.0  # before the recording
    assert within(timed, (2.9, 3.1)) == [2.9]


def seen(columns: list[Column], evidence: Callable[[list[int]], float], means: list[float]) -> Screen:
    """A view with these means of whatever is asked."""
    model: Any = SimpleNamespace(runs=8, log_evidence=evidence)
    model.posterior, model.taken = lambda _: SimpleNamespace(mean=np.array(means)), lambda _: model
    return Screen(tuple(columns), model, model, (), (), {})


def test_a_screened_candidate_pays_for_its_numbers_that_do_not_vary_yet_and_begins_where_its_slopes_lead() -> None:
    spot = candidate(
        "spot", Coordinate("force", 0.0, 1.0, 0.0, 20.0), Coordinate("x", 0.0, 1.0), Coordinate("y", 0.0, 1.0)
    )
    columns = [Column("spot", 0, spot, (0.0, 3.0, 4.0)), Column("line", 0, LINE), Column("line", 0, LINE, to=(7.0,))]
    view = seen(columns, lambda at: 50.0 - len(at), [2.5])
    assert view.evidence(("spot", (0,))) == pytest.approx(49.0 - np.log(8))  # of three numbers two are hidden
    assert view.evidence(("spot", (0,)), ("line", (1,))) == pytest.approx(48.0 - np.log(8))
    assert view.start_of(("spot", (0,))) == (2.5, 3.0, 4.0)
    assert view.start_of(("line", (1,))) == (0.0,)
    assert view.start_of(("line", (2,))) == (7.0,)
    assert seen(columns, lambda _: 0.0, [-2.5]).start_of(("spot", (0,))) == (1.0, 3.0, 4.0)  # a step within its bounds


@pytest.mark.parametrize(("share", "wanted"), [(0.49, False), (0.51, True), (1.49, True), (1.51, False)])
def test_a_change_as_a_whole_is_offered_where_about_all_of_it_is_wanted(share: float, wanted: bool) -> None:
    assert _wants_whole_change(seen([], lambda _: 0.0, [0.2, share]).beyond, (0,)) == wanted


@pytest.mark.parametrize(
    ("pair", "single", "pays"), [(of(5.0), of(5.1), False), (of(5.2), of(5.1), True), (None, of(9.0), True)]
)
def test_nothing_is_added_to_two_effects_of_which_one_alone_is_more_probable(
    pair: Any, single: Any, pays: bool
) -> None:
    """A pair whose fit has not converged may still be the better one."""
    both, b = A | {"b"}, frozenset({"b"})
    fits = {NONE: of(0.0), A: of(1.0), b: single, **({both: pair} if pair else {})}
    search = searching(fits=fits, failed={} if pair else {both: of(-3.0)})
    assert strategy._is_worth_extending(search, both) == pays
    assert strategy._is_worth_extending(search, A)  # a single effect has no effects alone but itself


def test_the_best_fit_explains_the_runs_below_one_and_a_half_times_the_noise() -> None:
    assert searching(fits={NONE: of(1.0), A: of(5.0, excess=1.49)}).explained == 5.0
    assert searching(fits={NONE: of(1.0), A: of(5.0, excess=1.51)}).explained == -np.inf
    assert searching(fits={A: of(5.0, converged=False)}).explained == -np.inf
    assert searching().explained == -np.inf
    search = searching(fits={NONE: of(1.0, excess=1.4), A: of(15.0, excess=1.6)}, steps=100)
    assert search.so_far == (
        "of 2 fitted models the most probable is a, which does not explain the runs: its residuals are 1.6 times the "
        "mean square of the noise"
    )
    quiet = searching(fits={NONE: of(1.0), A: of(15.0, excess=0.34)}).so_far  # a set far from the true one
    assert "0.34 times the mean square of the noise, which an earlier misfit inflated, so that this decides no" in quiet
    found = searching(fits={NONE: of(1.0), A: of(15.0, excess=0.7)}).so_far
    assert found.endswith(
        "explains the runs (its residuals are 0.7 times the mean square of the noise), but is no finding before other "
        "models are fitted"
    )
    assert (search.exhausted, search.largest, searching(steps=99).exhausted) == (True, 3, False)
    search.problem.open_ground = True
    assert (search.explained, search.largest) == (-np.inf, 4)


def test_a_search_anew_has_made_no_fit_and_no_step_whatever_else_stays() -> None:
    search = searching(fits={NONE: of(1.0)}, failed={A: None}, asked=A, extended={A}, steps=70, most_steps=170)
    found = search.anew(runs=(1,))
    assert (found.fits, found.failed, found.extended, found.steps, found.most_steps) == ({}, {}, set(), 0, 100)
    assert (found.runs, found.asked, found.terms) == ((1,), A, search.terms)


def test_the_best_fit_of_a_set_is_kept_with_the_steps_of_all(monkeypatch: pytest.MonkeyPatch) -> None:
    answers = iter([of(5.0), of(7.0), of(6.0)])
    monkeypatch.setattr("evaluator.diagnosis.inference.search.fit_model", lambda *_, **__: next(answers))
    search = searching(fits={NONE: of(0.0)}, failed={A: None})
    kept = [fit_set(search, A, {}, of(0.0)) for _ in range(3)]
    assert [item.posterior.log_evidence for item in kept if item] == [5.0, 7.0, 7.0]
    assert (search.failed, search.steps) == ({}, 9)
    assert search.problem.watch.so_far.startswith("of 2 fitted models the most probable is a,")
    assert search.problem.watch.explained
    monkeypatch.setattr("evaluator.diagnosis.inference.search.fit_model", lambda *_, **__: of(9.0, excess=1.6))
    fit_set(search, A, {}, of(0.0))
    assert not search.problem.watch.explained


def test_a_threshold_that_is_chosen_and_not_fitted_counts_as_a_number(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    monkeypatch.setattr(
        "evaluator.diagnosis.inference.search.fit_model", lambda *given, **_: asked.append(given) or of(5.0)
    )
    search = searching(fits={NONE: of(0.0)})
    search.terms = {"a": replace(LINE, stepwise=True), "b": LINE}
    found = fit_set(search, A | {"b"}, {"a": (2.0,), "b": (3.0,)}, of(0.0))
    assert found is not None
    assert found.posterior.log_evidence == 4.0
    assert (asked[0][2], asked[0][5]) == ([LINE], {"a": (2.0,)})


def test_a_fit_that_fails_is_begun_again_without_friction_and_gains(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    answers = iter([of(5.0, converged=False), of(5.0), of(8.0)])

    def fitted(_: Any, begin: Point, *given: Any, **__: Any) -> Any:
        asked.append((begin, given[4]))
        return next(answers)

    monkeypatch.setattr("evaluator.diagnosis.inference.search.fit_model", fitted)
    search = searching(fits={NONE: of(0.0)})
    found = fit_set(search, A, {"a": (2.0,)}, of(0.0))
    assert found is not None
    assert found.posterior.log_evidence == 8.0
    assert [limit for _, limit in asked] == [None, (0.03, 0.006, 0.006, 1.0), None]
    np.testing.assert_array_equal(asked[1][0].per_run, np.tile([1.0] * 3 + [0.0] * 4, (2, 1)))
    assert (asked[1][0].nominal, asked[1][0].terms) == ({}, {"a": (2.0,)})


@pytest.mark.parametrize(("converged", "overreaches"), [(True, True), (False, False)])
def test_a_fit_under_usual_scatter_goes_on_only_where_it_ended_with_usual_friction(
    converged: bool, overreaches: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    second = of(7.0, converged=converged)
    second.overreaches = overreaches
    answers = iter([of(5.0, converged=False), second])
    monkeypatch.setattr("evaluator.diagnosis.inference.search.fit_model", lambda *_, **__: next(answers))
    search = searching(fits={NONE: of(0.0)})
    assert (fit_set(search, A, {}, of(0.0)) is second) == converged
    assert search.failed == ({} if converged else {A: second})


@pytest.mark.parametrize(
    ("freed", "widened", "led", "best"),
    [
        (8.0, [], None, 8.0),
        (7.0, [], None, 7.0),  # as probable as with usual friction and gains
        (3.0, [7.1, 7.2], 6.0, 6.0),
        (3.0, [7.1, 7.2], 2.0, 3.0),
        (3.0, [7.1, None], None, 3.0),  # runs cannot be simulated on the way
        (None, [7.1, 7.2], 6.0, 6.0),
        (None, [7.1, 7.2], None, 7.0),
    ],
)
def test_a_fit_that_is_less_probable_with_any_friction_at_once_is_led_there_by_widening_steps(
    freed: float | None, widened: list[float | None], led: float | None, best: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Any] = []
    answers = iter([5.0, 7.0, freed, *widened, *([led] if widened and widened[-1] else [])])

    def fitted(_: Any, begin: Point, *given: Any, **__: Any) -> Any:
        asked.append((given[4], begin.nominal.get("from")))
        evidence = next(answers)
        if evidence is None:
            raise FloatingPointError
        found = of(evidence, converged=len(asked) > 1)
        found.point = replace(found.point, nominal={"from": evidence})
        return found

    monkeypatch.setattr("evaluator.diagnosis.inference.search.fit_model", fitted)
    found = fit_set(searching(fits={NONE: of(0.0)}), A, {}, of(0.0))
    assert found is not None
    assert found.posterior.log_evidence == best
    usual = (0.03, 0.006, 0.006, 1.0)
    twice, four = (tuple(times * size for size in usual) for times in (2.0, 4.0))
    steps = [(None, 7.0), (twice, 7.0), (four, 7.1), (None, 7.2)][
        : 1 + 2 * bool(widened) + (led is not None or widened == [7.1, 7.2])
    ]
    assert asked[2:] == steps
    assert next(answers, "none left") == "none left"


def test_a_screened_set_is_fitted_from_its_two_best_places_and_hopeless_ones_are_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tried = []
    monkeypatch.setattr(strategy, "fit_set", lambda _, ids, starts, *__: tried.append((*ids, starts[next(iter(ids))])))
    promised = {0: 100.0, 1: 99.0, 2: 98.0, 3: 97.0, 4: 96.0, 5: 75.1, 6: 74.9}
    names = "aaabcde"
    view: Any = SimpleNamespace(evidence=lambda offer: promised[offer[1]], start_of=lambda offer: offer[1])
    sets: Any = [((name, place),) for place, name in enumerate(names)]
    search = searching(fits={NONE: of(0.0, excess=9.0)})
    search.terms = dict.fromkeys("abcdefgh", LINE)
    strategy._refit(search, view, sets, 7, of(0.0))
    assert tried == [("a", 0), ("a", 1), ("b", 3), ("c", 4), ("d", 5)]  # 25 below the best: no further
    tried.clear()
    strategy._refit(search, view, sets, 2, of(0.0))
    assert tried == [("a", 0), ("a", 1), ("b", 3)]
    search.steps = 100
    strategy._refit(search, view, sets, 2, of(0.0))
    assert len(tried) == 3
    search.steps, search.problem.open_ground = 0, True  # there the screening of a large misfit says little
    strategy._refit(search, view, sets, 7, of(0.0))
    assert tried[3:] == [("a", 0), ("a", 1), ("b", 3), ("c", 4), ("d", 5), ("e", 6)]


def test_once_a_set_explains_the_runs_seven_more_are_fitted_at_most(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[frozenset[str]] = []
    monkeypatch.setattr(strategy, "fit_set", lambda _, ids, *__: tried.append(ids))
    view: Any = SimpleNamespace(evidence=lambda _: 100.0, start_of=lambda _: ())
    sets: Any = [((name, ()),) for name in "abcdefghijk"]
    for excess, count in ((1.4, 7), (1.6, 9)):
        tried.clear()
        strategy._refit(searching(fits={NONE: of(0.0, excess=excess)}), view, sets, 9, of(0.0))
        assert len(tried) == count


def test_numbers_of_a_fit_are_the_same_question_to_nine_digits() -> None:
    asked = [question_of({"x": np.array([value])}, None, "b") for value in (1.0, 1.0 + 1e-10, 1.0 + 1e-8)]
    assert asked[0] == asked[1] != asked[2]


class Promises:
    """A screening that promises evidence by the names of its offers; 100 without any."""

    def __init__(self, promised: dict[str, float]) -> None:
        self.promised = promised
        self.offers = [(name, ()) for name in promised if len(name) == 1]

    def evidence(self, *offers: tuple[str, tuple[int, ...]]) -> float:
        return self.promised.get("".join(sorted(name for name, _ in offers)), 100.0)


def placed(fit: Any, point: Point) -> Any:
    return SimpleNamespace(**{**vars(fit), "point": point})


def test_what_is_promised_two_and_more_is_fitted_the_best_first(monkeypatch: pytest.MonkeyPatch) -> None:
    view = Promises({"a": 101.9, "b": 102.1, "c": 109.0, "ab": 112.0, "ac": 110.9, "bc": 120.0})
    asked: list[tuple[list[str], int]] = []
    begun: list[int] = []
    monkeypatch.setattr(strategy, "screen", lambda *_: view)
    monkeypatch.setattr(strategy, "replace", placed)
    monkeypatch.setattr(strategy, "_extend_without_scatter", lambda *_: None)

    def refit(_: Any, __: Any, sets: Any, most: int, ___: Any, starts: int = 2) -> None:
        asked.append((["".join(name for name, _ in each) for each in sets], most))
        begun.append(starts)

    monkeypatch.setattr(strategy, "_refit", refit)
    search = searching(fits={NONE: of(0.0)})
    search.terms = dict.fromkeys("abcdefghi", LINE)
    strategy.extend(search, NONE)
    assert asked[-1] == (["c", "b"], 3)
    strategy.extend(search, NONE, regardless=True)
    assert (asked[-1], begun[-1]) == ((["c", "b", "a"], 3), 1)
    asked.clear()
    search.asked = frozenset("c")
    search.terms = {**search.terms, "c": SimpleNamespace(begin=(), stepwise=False)}
    strategy.extend(search, NONE)  # what the user asks for is fitted by itself
    assert asked == [(["c"], 1), (["b"], 3)]
    search.asked = NONE
    asked.clear()
    strategy._from_the_null(search)  # every single one in its order, and pairs that gain over either of their effects
    assert asked[1:] == [(["c", "b", "a"], 7), (["cb", "ba"], 2)]
    search.problem.horizon_s = 2.5
    strategy._from_the_null(search)
    assert asked[-2] == (["c", "b", "a"], 9)  # over a short horizon every single effect


@pytest.mark.parametrize(
    ("horizon_s", "open_ground", "looks"), [(np.inf, False, 2), (2.5, False, 1), (np.inf, True, 1)]
)
def test_an_addition_that_friction_and_gains_of_the_fit_hide_is_fitted_without_them(
    horizon_s: float, open_ground: bool, looks: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    views = iter([Promises({"a": 101.0, "b": 103.0}), Promises({"a": 121.0, "b": 109.0, "c": 101.9})])
    seen: list[Point] = []
    fitted: list[tuple[frozenset[str], Point]] = []
    offered: list[str] = []

    def screen(_: Search, point: Point, __: object, terms: Any) -> Promises:
        seen.append(point)
        offered.append("".join(term.id for term in terms))
        return next(views)

    monkeypatch.setattr(strategy, "screen", screen)
    monkeypatch.setattr(Promises, "start_of", lambda *_: (), raising=False)

    def fit_set(search: Search, ids: frozenset[str], _: object, origin: Any, __: float) -> None:
        fitted.append((ids, origin.point))
        search.fits[ids] = of(0.0)

    monkeypatch.setattr(strategy, "fit_set", fit_set)
    monkeypatch.setattr(strategy, "replace", placed)
    search = searching(fits={NONE: of(0.0, excess=9.0)})
    search.terms = {name: replace(LINE, id=name, stepwise=name == "s") for name in "abcs"}
    search.problem.horizon_s, search.problem.open_ground = horizon_s, open_ground
    strategy.extend(search, NONE)
    assert len(seen) == len(offered) == looks
    assert offered == ["abcs", "abc"][:looks]
    assert [ids for ids, _ in fitted] == [frozenset("b"), A][:looks]
    poses, scatter = np.split(seen[-1].per_run, [3], axis=1)
    assert poses.all()
    assert scatter.any() == (looks == 1)
    assert seen[-1].nominal == {"key": 1.0}
    assert fitted[-1][1] is seen[-1]


def test_the_best_two_effects_and_the_best_pair_are_extended_if_they_do_not_lag(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    extended: list[str] = []
    for name in ("_fit_whole_changes", "_from_the_nominal"):
        monkeypatch.setattr(strategy, name, lambda *_: None)
    monkeypatch.setattr(strategy, "fit_model", lambda *_: of(-100.0, excess=9.0))

    def extend(search: Search, ids: frozenset[str]) -> None:
        extended.append("".join(sorted(ids)))
        search.fits |= {frozenset("ab"): of(-2.0), frozenset("bc"): of(-1.0)}

    monkeypatch.setattr(strategy, "extend", extend)
    for second, wanted in ((-61.5, ["c", "a", "bc"]), (-62.5, ["c", "bc"])):
        extended.clear()
        singles = {A: of(second), frozenset("b"): of(-90.0), frozenset("c"): of(-2.0)}
        monkeypatch.setattr(strategy, "_from_the_null", lambda search, more=singles: search.fits.update(more))
        shares: list[float] = []
        point = Point(np.zeros((2, 7)))
        strategy.run_search(searching(), point, point, lambda _, share, *__, to=shares: to.append(share))
        assert extended == wanted
        assert shares == pytest.approx([0.1, *([0.475, 0.65] if len(wanted) == 3 else [0.65]), 1.0])
    for excess, sizes in ((1.0, []), (1.6, ["c"])):  # over the first seconds until a set explains them, here a pair
        extended.clear()
        monkeypatch.setattr(
            strategy,
            "_from_the_null",
            lambda search, left=excess: search.fits.update({frozenset("c"): of(-2.0, excess=left)}),
        )
        short = searching()
        short.problem.horizon_s = 2.5
        short.terms = {"c": LINE}
        strategy.run_search(short, point, point, lambda *_: None)
        assert extended == sizes


def test_progress_is_a_share_and_is_repeated_at_every_look() -> None:
    told: list[tuple[str, float]] = []
    watch = Watch(lambda stage, done: told.append((stage, done)), seconds=1e9)
    watch.look()
    watch("fit", 3, 4)
    watch.look()
    assert told == [("fit", 0.75)] * 2
