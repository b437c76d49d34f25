"""Sets on ground grow by names and forms alike, and what stood in for something that was found later is taken out."""

from __future__ import annotations

import sys
from collections.abc import Collection
from itertools import pairwise
from types import SimpleNamespace
from typing import Any, cast

import pytest

from evaluator.diagnosis import search_ground
from evaluator.diagnosis.inference.search import Search
from evaluator.diagnosis.search_ground import exchange, grow, on_runs_except

FORM = "free:mixed"
NAMES = ("lag", "proxy", "other", FORM)
EVIDENCE = {
    frozenset(ids): value
    for ids, value in (
        (("proxy",), 100.0),
        ((FORM,), 150.0),
        (("lag",), 20.0),
        (("proxy", FORM), 200.0),
        (("lag", FORM), 400.0),
        (("lag", "proxy"), 110.0),
        (("lag", "proxy", FORM), 401.0),  # the proxy gains no more than chance
    )
}


def fit_of(ids: frozenset[str], at_bound: Collection[frozenset[str]] = ()) -> Any:
    return SimpleNamespace(
        posterior=SimpleNamespace(log_evidence=EVIDENCE.get(ids, 0.0)),
        at_bounds=ids if ids in at_bound else (),
        point=None,
        excess=1.0,
    )


def search_of(
    monkeypatch: pytest.MonkeyPatch, at_bound: Collection[frozenset[str]] = ()
) -> tuple[Search, list[frozenset[str]]]:
    """A search whose fits have the evidence of the table, with the fit of nothing; and the sets that were extended."""
    asked: list[frozenset[str]] = []

    def fitted(search: Search, ids: frozenset[str], *_: object) -> Any:
        return search.fits.setdefault(ids, fit_of(ids, at_bound))

    def extended(
        search: Search, ids: frozenset[str], among: Collection[str], most: int, *, regardless: bool = False
    ) -> None:
        del regardless
        asked.append(ids)
        more = sorted(set(among) - ids, key=lambda effect: -EVIDENCE.get(ids | {effect}, 0.0))
        for effect in more[:most]:
            fitted(search, ids | {effect})

    acts = search_ground.acts_on_drive
    monkeypatch.setattr(search_ground, "acts_on_drive", lambda effect: effect not in NAMES and acts(effect))
    monkeypatch.setattr(search_ground, "carries_over", lambda *_: True)
    monkeypatch.setattr(search_ground, "fit_set", fitted)
    monkeypatch.setattr(search_ground, "extend", extended)
    search = Search(cast("Any", SimpleNamespace(open_ground=True)), dict.fromkeys(NAMES, cast("Any", None)), {}, (0,))
    fitted(search, frozenset())
    return search, asked


def test_sets_grow_by_the_leading_additions_whether_they_have_a_name_or_not(monkeypatch: pytest.MonkeyPatch) -> None:
    search, _ = search_of(monkeypatch)
    grow(search, 95, size=0, count=1, additions=2)
    assert set(search.fits) == {frozenset(), frozenset({"proxy"}), frozenset({FORM})}
    grow(search, 95, size=1, count=1, additions=1)  # the leading one alone, though another of its size was fitted
    assert set(search.fits) - {frozenset(), frozenset({"proxy"}), frozenset({FORM})} == {frozenset({"lag", FORM})}


def test_a_set_that_misses_the_runs_far_worse_than_the_best_of_its_size_is_left(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    search, asked = search_of(monkeypatch, at_bound=[frozenset({"other"})])
    sets = [frozenset(), frozenset({"proxy"}), frozenset({"lag"}), frozenset({"other"}), frozenset({"lag", FORM})]
    misses: dict[frozenset[str], float] = dict(zip(sets, (9.0, 1.0, 2.01, 0.1, 5.0), strict=True))
    for ids, excess in misses.items():
        search.fits[ids] = fit_of(ids, [frozenset({"other"})])
        search.fits[ids].excess = excess  # type: ignore[misc]
    kept = [frozenset(), frozenset({"proxy"}), frozenset({"other"}), frozenset({"lag", FORM})]
    assert search_ground._near(search, sets) == kept  # what ends at a bound is no measure
    search.fits[frozenset({"lag"})].excess = 2.0  # type: ignore[misc]
    assert search_ground._near(search, sets) == sets
    grow(search, 95, size=1, count=2, additions=1)
    assert asked == [frozenset({"proxy"}), frozenset({"lag"})]


DRIVE_FORM = "free:left_drive.right_command=right_drive.left_command"


@pytest.fixture
def of_drives(monkeypatch: pytest.MonkeyPatch) -> Search:
    """A search without fits of effects of the drive and of others."""
    search, _ = search_of(monkeypatch)
    names = ("command-lag", "speed-limit", "dead-band", "scrub-torque", DRIVE_FORM, "free:moment.one")
    search.terms = dict.fromkeys(names, cast("Any", None))
    return search


def test_what_acts_on_the_drive_is_fitted_whatever_its_place_in_the_screening(of_drives: Search) -> None:
    of_drives.fits[frozenset({"command-lag"})] = lag = fit_of(frozenset({"command-lag"}))
    search_ground.try_drives(of_drives, 95, 0)
    drives = ("command-lag", "speed-limit", "dead-band", DRIVE_FORM)
    assert set(of_drives.fits) == {frozenset(), *(frozenset({effect}) for effect in drives)}
    assert of_drives.fits[frozenset({"command-lag"})] is lag


def test_of_the_drive_what_was_not_fitted_is_tried_and_beside_an_effect_names_alone(
    of_drives: Search, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where nothing is fitted beside, what delays motion is tried whatever it promises: the start absorbs it."""
    lag, names = frozenset({"command-lag"}), {"speed-limit", "dead-band"}
    of_drives.terms["acceleration-limit"] = cast("Any", None)
    of_drives.fits[lag] = fit_of(lag)
    asked: list[Any] = []

    def extend(_: Search, ids: frozenset[str], drives: list[str], most: int, *, regardless: bool = False) -> None:
        asked.append((ids, set(drives), most, regardless))

    monkeypatch.setattr(search_ground, "extend", extend)
    search_ground.try_drives(of_drives, 95, 0)
    names.add("acceleration-limit")
    assert asked == [
        (frozenset(), {"acceleration-limit"}, 1, True),
        (frozenset(), {*names, DRIVE_FORM}, 4, False),
    ]
    asked.clear()
    search_ground.try_drives(of_drives, 95, 1)
    assert asked == [(lag, names, 3, False)]


def test_named_effects_of_the_drive_are_combined_and_their_best_pair_grows_beside_a_better_set(
    of_drives: Search, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A drag resembles limited wheels, and only a third effect shows which of them is right."""
    better, pair, other = (
        {"scrub-torque", "command-lag"},
        {"speed-limit", "command-lag"},
        {"dead-band", "command-lag"},
    )
    values = {("command-lag",): 50.0, ("scrub-torque",): 60.0}
    values |= {tuple(sorted(ids)): value for ids, value in ((better, 90.0), (pair, 80.0), (other, 70.0))}
    monkeypatch.setattr(sys.modules[__name__], "EVIDENCE", {frozenset(ids): value for ids, value in values.items()})
    for ids in ({"command-lag"}, {"scrub-torque"}, better):
        of_drives.fits[frozenset(ids)] = fit_of(frozenset(ids))
    search_ground.try_drives(of_drives, 95, 1)
    assert {ids for ids in of_drives.fits if len(ids) == 2} == {frozenset(ids) for ids in (better, pair, other)}
    grow(of_drives, 95, size=2, count=1, additions=9)
    grown = {ids for ids in of_drives.fits if len(ids) == 3}
    assert all(ids > better or ids > pair for ids in grown)
    assert frozenset(pair | {"free:moment.one"}) in grown


@pytest.mark.parametrize(
    ("at_bound", "best"),
    [((), {"lag", FORM}), ((frozenset({"lag", FORM}),), {"lag", "proxy", FORM})],
)
def test_a_proxy_that_was_picked_first_gives_way_to_what_is_better_in_its_place(
    at_bound: tuple[frozenset[str], ...], best: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    search, asked = search_of(monkeypatch, at_bound)
    for ids in (frozenset({"proxy"}), frozenset({"proxy", FORM})):
        search.fits[ids] = fit_of(ids, at_bound)
    exchange(search, 95)
    exchange(search, 95)
    assert search_ground._ranked(search, 95)[0] == best
    assert frozenset({FORM}) in search.fits  # what each effect stands against was fitted
    assert len(asked) == len(set(asked))  # each once: a view of all candidates is dear


def test_sets_that_cannot_be_the_answer_come_last_and_the_most_probable_of_them_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bound = frozenset({"lag", FORM}), frozenset({FORM})
    search, _ = search_of(monkeypatch)
    for ids in EVIDENCE:
        search.fits[ids] = fit_of(ids, bound)
    assert search_ground._ranked(search, 95)[-2:] == [{"lag", FORM}, {FORM}]


@pytest.mark.parametrize("gain", [0.1, -0.1])
def test_a_set_with_an_effect_that_does_not_help_significantly_comes_before_the_null_where_it_helps_on_average(
    gain: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    search, _ = search_of(monkeypatch)
    search.problem = cast("Any", SimpleNamespace(open_ground=True, data=()))
    monkeypatch.setattr(search_ground, "carries_over", lambda _, ids: "proxy" not in ids)
    monkeypatch.setattr(search_ground, "mean_gain", lambda *_: gain)
    for ids in EVIDENCE:
        search.fits[ids] = fit_of(ids)
    nothing = frozenset[str]()
    weak = [{"lag", "proxy", FORM}, {"proxy", FORM}, {"lag", "proxy"}, {"proxy"}]
    following = [*weak, nothing] if gain > 0 else [nothing, *weak]
    assert search_ground._ranked(search, 95) == [{"lag", FORM}, {FORM}, {"lag"}, *following]


def test_what_leads_goes_on_under_another_noise_and_a_set_without_a_form_with_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    search, _ = search_of(monkeypatch)
    for ids in EVIDENCE:
        search.fits[ids] = fit_of(ids)
    monkeypatch.setattr(search_ground, "fit_model", lambda *_: fit_of(frozenset()))
    monkeypatch.setattr(search_ground, "RIVALS_KEPT", 2)
    whole = search_ground._under(search, 95, runs=(0, 1, 2))
    assert whole.runs == (0, 1, 2)
    leading = {frozenset({"lag", "proxy", FORM}), frozenset({"lag", FORM})}
    assert set(whole.fits) == {frozenset(), *leading, frozenset({"lag", "proxy"}), frozenset({"proxy"})}


@pytest.mark.parametrize("long", [False, True])
def test_a_search_on_ground_grows_settles_its_noise_and_exchanges_in_this_order(
    monkeypatch: pytest.MonkeyPatch, *, long: bool
) -> None:
    """Noise changes once while sets grow and once afterwards; a long session is decided by more runs than searched."""
    done: list[Any] = []
    shares: list[float] = []
    noise = iter([None, "second", None, "third", None])
    runs = {"deciding": (0, 1, 2), "searched": (0, 1), "fitted": (0,)} if long else {"fitted": (0, 2)}

    def begun(problem: Any, _: Any, terms: Any, tolerance: Any, chosen: Any) -> Any:
        done.append(("null", problem, chosen))
        assert (terms, tolerance) == ([], {})
        return fit_of(frozenset())

    def settled(search: Search, families: int) -> Search | None:
        problem: Any = next(noise)
        done.append(("settled", problem))
        assert families == 2
        return None if problem is None else search.anew(problem=problem, fits=dict(search.fits))

    def under(search: Search, _: int, **changes: Any) -> Search:
        done.append(("under", changes))
        return search.anew(fits=dict(search.fits), **changes)

    def noted(name: str) -> Any:
        return lambda _search, _families, *rest: done.append((name, *rest))

    for name in ("grow", "try_drives", "exchange", "_against_each"):
        monkeypatch.setattr(search_ground, name, noted(name))
    for name, function in (("fit_model", begun), ("_settled", settled), ("_under", under)):
        monkeypatch.setattr(search_ground, name, function)
    data = (None,) * (4 if long else 3)
    for name in ("deciding", "searched", "fitted"):
        monkeypatch.setattr(search_ground, f"{name}_runs", lambda _, name=name: runs.get(name, (0, 1, 2)))
    problem: Any = SimpleNamespace(data=data)
    ready: Any = SimpleNamespace(
        problem=problem, terms=dict.fromkeys(NAMES), tolerance={}, start="start", own=frozenset({"lag"}), free=(1, 2)
    )

    monkeypatch.setattr(Search, "null", property(lambda _: SimpleNamespace(point="null point")))

    def told(_: str, share: float, *__: float) -> None:
        shares.append(share)

    part, whole = search_ground.searched_on_ground(search_ground.singles_on_ground(ready, told), ready, told)
    order = [
        ("null", problem, runs.get("searched", (0, 1, 2))),
        *(("grow", 0, 1, 7), ("try_drives", 0), ("settled", None)),
        *(("grow", 1, 2, 3), ("try_drives", 1), ("settled", "second")),
        *(("grow", 2, 1, 3), ("settled", None)),
        *(("exchange",), ("settled", "third"), ("exchange",), ("settled", None)),
    ]
    order += [("under", {"runs": (0, 1, 2)}), ("_against_each",)] if long else [("null", "third", (0, 2))]
    assert done == order
    assert (whole.problem, whole.runs, whole.asked) == ("third", (0, 1, 2), frozenset({"lag"}))
    assert (part is whole) == long
    assert part.runs == ((0, 1, 2) if long else (0, 2))
    assert shares == sorted(shares)
    assert (shares[0], shares[-1] < 1.0) == (0.1, True)


@pytest.mark.parametrize(
    ("ranked", "failing", "rounds"),
    [
        ("ab ab", "", [("ab", "a", "b")]),
        ("ab ab", "a", [("ab", "b")]),  # what cannot be fitted is not extended
        ("ab cd cd", "", [("ab", "a", "b"), ("cd", "c", "d")]),
        ("ab cd ab cd ab", "", [("ab", "a", "b"), ("cd", "c", "d"), ("ab", "a", "b")]),  # three times at most
        ("abcd abcd", "", [("abc", "abd", "acd", "bcd")]),  # four effects are as many as a set has on ground
    ],
)
def test_all_candidates_are_tried_in_place_of_each_effect_until_the_best_set_stays(
    ranked: str, failing: str, rounds: list[tuple[str, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    search, _ = search_of(monkeypatch)
    names = ["".join(sorted(ids)) for ids in map(frozenset, ranked.split())]
    answers = iter([item for pair in pairwise(names) for item in pair])
    search.fits |= {frozenset(name): fit_of(frozenset(name)) for name in names}
    search.steps = 70
    fitted: list[tuple[frozenset[str], Any]] = []
    extended: list[frozenset[str]] = []

    def fit_set(_: Search, ids: frozenset[str], __: Any, origin: Any) -> Any:
        fitted.append((ids, origin))
        return None if ids == frozenset(failing) else origin

    monkeypatch.setattr(search_ground, "_ranked", lambda *_: [frozenset(next(answers))])
    monkeypatch.setattr(search_ground, "fit_set", fit_set)
    monkeypatch.setattr(search_ground, "_extend_once", lambda _, ids: extended.append(ids))
    exchange(search, 95)
    assert sorted(map(sorted, extended)) == sorted(sorted(name) for one in rounds for name in one)
    best = [frozenset(max(one, key=len)) if len(one) < 4 else frozenset("abcd") for one in rounds]
    assert [origin for _, origin in fitted] == [search.fits[ids] for ids in best for _ in ids]
    assert search.most_steps == 70 + search_ground.MOST_STEPS


def test_noise_that_settles_is_that_of_the_best_set(monkeypatch: pytest.MonkeyPatch) -> None:
    search, _ = search_of(monkeypatch)
    answers = iter([None, "settled"])
    monkeypatch.setattr(search_ground, "_ranked", lambda *_: [frozenset("b"), frozenset("a")])
    monkeypatch.setattr(search_ground, "settled_noise", lambda _, ids: next(answers) if ids == {"b"} else "other")
    monkeypatch.setattr(search_ground, "_under", lambda _, families, **changes: (families, changes))
    assert search_ground._settled(search, 95) is None
    assert search_ground._settled(search, 95) == (95, {"problem": "settled"})


@pytest.mark.parametrize(
    ("gains", "helps"),
    [
        ({"": 1.0, "a": 1.0, "b": 1.0}, True),
        ({"": -1.0, "a": 1.0, "b": 1.0}, False),
        ({"": 1.0, "a": -1.0, "b": 1.0}, False),
        ({"": 1.0, "a": 1.0, "b": 0.0}, False),
        ({"": 1.0, "a": 1.0}, True),  # what was not fitted is not asked
        ({"": 1.0, "c": -1.0}, True),  # nor what is no part of it
    ],
)
def test_a_set_helps_that_predicts_better_than_the_null_and_than_itself_without_one_effect(
    gains: dict[str, float], helps: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    search, _ = search_of(monkeypatch)
    search.problem = cast("Any", SimpleNamespace(open_ground=True, data=()))
    search.fits = {frozenset(name): cast("Any", name) for name in (*gains, "ab")}
    monkeypatch.setattr(search_ground, "mean_gain", lambda _fit, other, *_: gains[cast("str", other)])
    assert search_ground._helps(search, frozenset("ab")) == helps


@pytest.mark.parametrize("settles", [True, False])
def test_the_best_sets_are_fitted_to_other_runs_with_the_noise_that_these_leave(
    settles: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Any] = []
    first, settled = SimpleNamespace(name="first"), SimpleNamespace(name="settled")
    monkeypatch.setattr(search_ground, "_under", lambda *given, **changes: asked.append((given, changes)) or first)
    monkeypatch.setattr(search_ground, "_settled", lambda *given: asked.append(given) or (settled if settles else None))
    search: Any = SimpleNamespace(runs=(0, 2, 3, 7))
    assert on_runs_except(search, 5, (2, 4)) is cast("Any", settled if settles else first)
    assert asked == [((search, 5), {"runs": (0, 3, 7)}), (first, 5)]
