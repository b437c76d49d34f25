"""Free-form terms compete beside every set that could be the answer."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis import search_runs
from evaluator.diagnosis.inference.search import Search
from evaluator.diagnosis.likelihood.point import Point

NONE, ANSWER, REFUSED = frozenset[str](), frozenset({"spring"}), frozenset({"spring", "magnet"})


def test_free_terms_compete_beside_the_answer_where_the_best_set_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A magnet at the bound of what it may be said what the spring cannot: no free-form term was asked to say it."""
    evidence = {NONE: 0.0, ANSWER: 100.0, REFUSED: 200.0}
    fits = {ids: SimpleNamespace(point=ids, posterior=SimpleNamespace(log_evidence=e)) for ids, e in evidence.items()}
    terms = {effect: SimpleNamespace(id=effect, stepwise=False) for effect in REFUSED}
    search: Any = SimpleNamespace(fits=fits, terms=terms, problem=SimpleNamespace(open_ground=False))
    seen: list[Any] = []

    def screened(_: Any, point: Any, inside: list[str], free: Any) -> Any:
        del free
        seen.append((point, frozenset(inside)))
        return SimpleNamespace(evidence=lambda *_: 0.0, offers=[])

    monkeypatch.setattr(search_runs, "screen", screened)
    monkeypatch.setattr(search_runs, "rank_named", lambda *_: (None, ANSWER))
    monkeypatch.setattr(search_runs, "fit_null_from_rivals", lambda _: seen.append("null"))
    monkeypatch.setattr(search_runs, "_ask_for_names", lambda _, families: seen.append(("names", families)))
    monkeypatch.setattr(search_runs, "_fit_without_named", lambda _, families: seen.append(("without", families)))
    search_runs.challenge_with_free_terms(search, {}, lambda *_: None)
    assert seen == [(NONE, NONE), (REFUSED, REFUSED), (ANSWER, ANSWER), ("names", 0), ("without", 0), "null"]


@pytest.mark.parametrize(
    ("best", "asked"),
    [
        ({"free:x"}, [(NONE, {"magnet", "toe"})]),  # the spring alone was fitted
        ({"spring", "free:x"}, [(ANSWER, {"toe"})]),  # with the magnet, too
        ({"toe", "free:x"}, []),  # not reached without the free-form term
        ({"spring"}, []),
    ],
)
def test_effects_are_asked_for_in_place_of_the_free_form_term_of_the_most_probable_set(
    best: set[str], asked: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """They were sought in the fitted runs alone, which may lack what held-out runs show."""
    seen: list[Any] = []
    fits: Any = dict.fromkeys([NONE, ANSWER, REFUSED, frozenset(best)])
    terms = dict.fromkeys(("spring", "magnet", "toe", "free:x"))
    search: Any = SimpleNamespace(
        fits=fits, terms=terms, reached=lambda ids: ids if ids in (NONE, ANSWER, REFUSED) else None
    )
    monkeypatch.setattr(search_runs, "standing", lambda *_: SimpleNamespace(sets=[frozenset(best), NONE]))
    monkeypatch.setattr(search_runs, "extend", lambda _, ids, among: seen.append((ids, among)))
    search_runs._ask_for_names(search, 100)
    assert seen == asked


def test_a_named_effect_beside_a_free_form_term_competes_with_its_absence(monkeypatch: pytest.MonkeyPatch) -> None:
    """As long as the set without one of them is the better one, that is asked for less still."""
    whole, tighter = frozenset({"spring", "toe", "free:x"}), frozenset({"toe", "free:x"})
    scores = {whole: 9.0, tighter: 10.0, frozenset({"spring", "free:x"}): 1.0, frozenset({"free:x"}): 2.0}
    search: Any = SimpleNamespace(fits={whole: "fit"}, explained=0.0)
    search.reached = search.fits.get
    seen: list[Any] = []

    def fitted(_: Any, ids: frozenset[str], begin: Any, origin: str, explained: float) -> None:
        seen.append((set(ids), origin))
        assert (begin, explained) == ({}, 0.0)
        search.fits[ids] = f"fit of {len(ids)}"

    ranked = lambda *_: SimpleNamespace(sets=sorted(search.fits, key=lambda ids: -scores[ids]))  # noqa: E731
    monkeypatch.setattr(search_runs, "standing", ranked)
    monkeypatch.setattr(search_runs, "fit_set", fitted)
    search_runs._fit_without_named(search, 100)
    assert seen == [({"toe", "free:x"}, "fit"), ({"spring", "free:x"}, "fit"), ({"free:x"}, "fit of 2")]
    seen.clear()
    search_runs._fit_without_named(search, 100)  # all are fitted
    scores[REFUSED], search.fits[REFUSED] = 20.0, "named alone"
    search_runs._fit_without_named(search, 100)
    assert not seen


@pytest.mark.parametrize(
    ("rival", "evidence", "refitted", "null"),
    [
        (20.0, 5.0, True, 5.0),
        (20.0, -3.0, True, 0.0),  # no better from there
        (-1.0, 5.0, False, 0.0),  # no more probable than the null
        (61.0, 5.0, False, 0.0),  # far more probable: no fit of the null would close that
        (20.0, None, True, 0.0),  # cannot be simulated
    ],
)
def test_the_null_is_fitted_from_the_parameters_of_sets_little_more_probable(
    rival: float, evidence: float | None, refitted: bool, null: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fit_of(value: float, place: str) -> Any:
        point = Point(np.zeros((1, 7)), {"place": 1.0 + (place == "rival")}, {"spring": (1.0,)})
        return SimpleNamespace(posterior=SimpleNamespace(log_evidence=value), point=point)

    begun: list[Point] = []

    def fitted(_: Any, point: Point, terms: Any, *__: Any) -> Any:
        assert not terms
        begun.append(point)
        if evidence is None:
            raise FloatingPointError
        return fit_of(evidence, "null")

    fits = {NONE: fit_of(0.0, "null"), ANSWER: fit_of(rival, "rival")}
    search = Search(None, {}, {}, (0,), fits=fits)  # type: ignore[arg-type]
    monkeypatch.setattr(search_runs, "fit_model", fitted)
    search_runs.fit_null_from_rivals(search)
    assert [(point.nominal, point.terms) for point in begun] == [({"place": 2.0}, {})] * refitted
    assert search.null.posterior.log_evidence == null
