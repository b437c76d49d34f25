"""Of several effects, those that rest on one of several similar runs leave the answer without a second search."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import pytest

from evaluator.diagnosis import deciding as module

PAIR, FORM = frozenset({"magnet-imbalance", "speed-ripple"}), frozenset({"speed-ripple", "free:x"})
RIPPLE = frozenset({"speed-ripple"})


@dataclass
class AnswerSaid:
    """What an answer says."""

    verdict: str
    reason: str
    chosen: frozenset[str]


@dataclass
class Fitted:
    """A search by the sets that it has fitted."""

    fits: dict[frozenset[str], Any]
    problem: Any = field(default_factory=lambda: SimpleNamespace(open_ground=False))


@pytest.mark.parametrize(
    ("rests", "verdicts", "similar", "ends"),
    [
        ({PAIR: 2}, {RIPPLE: "effect"}, True, RIPPLE),
        ({PAIR: 2, FORM: 2}, {RIPPLE: "effect", FORM: "unknown"}, True, RIPPLE),  # a form in place of the effect
        ({PAIR: 2, FORM: 1}, {RIPPLE: "effect", FORM: "unknown"}, True, PAIR),  # which other runs need as well
        ({PAIR: 2}, {RIPPLE: "unknown"}, True, PAIR),
        ({PAIR: 2}, {RIPPLE: "effect"}, False, PAIR),  # the only drive of its kind
        ({}, {RIPPLE: "effect"}, True, PAIR),
    ],
)
def test_an_effect_beside_others_that_rests_on_one_run_is_left_out_without_a_second_search(
    rests: dict[frozenset[str], int], verdicts: dict[frozenset[str], str], similar: bool, ends: frozenset[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    session: Any = SimpleNamespace(data=tuple(SimpleNamespace(id=f"r{number}") for number in range(4)))
    sets = [PAIR, FORM, RIPPLE] if FORM in verdicts else [PAIR, RIPPLE]

    def answer(search: Fitted, *_: Any) -> Any:
        chosen = next(ids for ids in sets if ids in search.fits)
        return AnswerSaid(verdicts.get(chosen, "effect"), "so", chosen)

    def sole(_: Fitted, ids: frozenset[str], families: int) -> Any:
        assert families == 1
        return SimpleNamespace(run=rests[ids], effects=ids - RIPPLE) if ids in rests else None

    monkeypatch.setattr(module, "answer", answer)
    monkeypatch.setattr(module, "sole_run", sole)
    monkeypatch.setattr(module, "has_similar_runs", lambda run, others: similar and run not in others)
    whole: Any = Fitted(dict.fromkeys(sets))
    search, said = module._answered(whole, session, {"x": None})  # type: ignore[dict-item]
    assert said.chosen == ends
    if ends == PAIR:
        assert (search, said.reason) == (whole, "so")
    else:
        assert list(search.fits) == [RIPPLE]
        why = "r2 alone needs magnet-imbalance as well, because it was disturbed or shows it best: repeat it"
        assert said.reason == f"so; {why}"
