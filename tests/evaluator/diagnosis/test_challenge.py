"""Free-form terms compete beside every set that could be the answer."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from evaluator.diagnosis import search_runs

NONE, ANSWER, REFUSED = frozenset[str](), frozenset({"spring"}), frozenset({"spring", "magnet"})


def test_free_terms_compete_beside_the_answer_where_the_best_set_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A magnet at the bound of what it may be said what the spring cannot: no free-form term was asked to say it."""
    evidence = {NONE: 0.0, ANSWER: 100.0, REFUSED: 200.0}
    fits = {ids: SimpleNamespace(point=ids, posterior=SimpleNamespace(log_evidence=e)) for ids, e in evidence.items()}
    terms = {effect: SimpleNamespace(id=effect, stepwise=False) for effect in REFUSED}
    search: Any = SimpleNamespace(fits=fits, terms=terms, problem=SimpleNamespace(open_ground=False))
    seen = []

    def screened(_: Any, point: Any, inside: list[str], free: Any) -> Any:
        del free
        seen.append((point, frozenset(inside)))
        return SimpleNamespace(evidence=lambda *_: 0.0, offers=[])

    monkeypatch.setattr(search_runs, "screen", screened)
    monkeypatch.setattr(search_runs, "rank_named", lambda *_: (None, ANSWER))
    search_runs.challenge_with_free_terms(search, {}, lambda *_: None)
    assert seen == [(NONE, NONE), (REFUSED, REFUSED), (ANSWER, ANSWER)]
