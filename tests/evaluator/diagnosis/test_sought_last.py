"""Effects of large robots, which for small ones are sought instead of others or if no other explains the runs."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import pytest

from evaluator.diagnosis import deciding

LAST: Any = {"friction-across": "term"}
ACROSS, LEVEL = frozenset(LAST), frozenset({"friction-level"})


@dataclass(frozen=True)
class Searched:
    """A search whose fits are known by their sets."""

    fits: dict[frozenset[str], str]
    terms: dict[str, str] = field(default_factory=lambda: {"friction-level": "term"})
    failed: dict[frozenset[str], str] = field(default_factory=dict)
    steps: int = 99
    most_steps: int = 100

    def reached(self, ids: frozenset[str]) -> str | None:
        return self.fits.get(ids)


def test_they_are_added_to_the_best_set_with_and_without_each_of_its_effects(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    monkeypatch.setattr(deciding, "extend", lambda search, ids, among: asked.append((search.most_steps, ids, among)))
    given: Any = Searched({frozenset(): "null", LEVEL: "level"})
    wider: Any = deciding._with_last(given, LAST, LEVEL)
    assert asked == [(99 + deciding.LAST_STEPS, ids, LAST) for ids in (LEVEL, frozenset())]
    assert wider.terms == {"friction-level": "term", "friction-across": "term"}
    assert wider.fits is not given.fits
    asked.clear()
    few: Any = Searched({frozenset(): "null"})
    deciding._with_last(few, LAST, LEVEL | {"scrub-torque"})
    assert [ids for _, ids, _ in asked] == [frozenset()]  # sets that were never fitted are no place to begin


@pytest.mark.parametrize(
    ("verdict", "chosen", "taken", "challenged"),
    [("effect", ACROSS, True, True), ("effect", LEVEL, True, False), ("unknown", ACROSS, False, False)],
)
def test_their_answer_counts_if_it_is_an_effect_that_free_form_terms_have_challenged(
    verdict: str, chosen: frozenset[str], taken: bool, challenged: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps: list[str] = []
    before, more = SimpleNamespace(verdict="unknown", named=LEVEL), SimpleNamespace(verdict=verdict, chosen=chosen)
    monkeypatch.setattr(deciding, "_with_last", lambda *_: "wider")
    monkeypatch.setattr(deciding, "_answered", lambda search, *_: steps.append("answered") or (search, more))
    monkeypatch.setattr(deciding, "challenge_with_free_terms", lambda *_: steps.append("challenged"))
    ready: Any = SimpleNamespace(last=LAST, free={})
    given: Any = ("search", before, ready, "session", "progress")
    assert deciding._answered_with_last(*given) == (("wider", more) if taken else ("search", before))
    assert steps == ["answered", *["challenged", "answered"] * challenged]
