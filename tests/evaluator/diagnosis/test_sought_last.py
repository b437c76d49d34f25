"""Effects of large robots, which for small ones are sought instead of others or if no other explains the runs."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from evaluator.diagnosis import deciding
from evaluator.diagnosis.diagnosis import diagnose
from evaluator.diagnosis.inference.watch import SearchStoppedError
from evaluator.progress import no_progress
from tests.evaluator.diagnosis.hidden import hidden_session, offer_few

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
    alike: list[Any] = []
    monkeypatch.setattr(deciding, "fit_alike", alike.append)
    given: Any = Searched({frozenset(): "null", LEVEL: "level"})
    wider: Any = deciding._with_last(given, LAST, LEVEL)
    assert alike == [wider]  # from coordinates far away, once they are fitted
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

    def stopped(*_: Any) -> None:
        raise SearchStoppedError(180.0)

    monkeypatch.setattr(deciding, "_with_last", stopped)
    assert deciding._answered_with_last(*given) == ("search", before)


@pytest.mark.parametrize("verdict", ["unknown", "effect", "none", "insufficient"])
@pytest.mark.parametrize("other", [False, True])
def test_they_are_asked_beside_an_effect_or_where_nothing_explains_and_profiled_if_they_change_the_answer(
    verdict: str, other: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, after = SimpleNamespace(verdict=verdict, chosen=LEVEL), SimpleNamespace(verdict="effect", chosen=ACROSS)
    profiled: list[Any] = []
    monkeypatch.setattr(deciding, "_answered", lambda search, *_: (search, before))
    monkeypatch.setattr(deciding, "fitted_where_absent", lambda *_: False)
    monkeypatch.setattr(deciding, "profiles_of", lambda search, ids: profiled.append((search, ids)) or {"of": ids})
    monkeypatch.setattr(deciding, "_answered_with_last", lambda *_: ("wider", after) if other else ("same", before))
    monkeypatch.setattr(deciding, "_without_contradicted", lambda search, said, _: (search, said))
    ready: Any = SimpleNamespace(last=LAST, free={}, problem=SimpleNamespace(open_ground=False))
    given: Any = ("search", ready, "session", "progress")
    search, said, profiles = deciding.decided(*given)
    asked = verdict in ("unknown", "effect")
    assert search == ("search" if not asked else "wider" if other else "same")
    assert said is (after if asked and other else before)
    assert profiles == ({"of": said.chosen} if said.verdict == "effect" else {})
    assert len(profiled) == (verdict == "effect") + (asked and other)


@pytest.mark.parametrize("verdict", ["none", "effect", "unknown", "insufficient"])
@pytest.mark.parametrize("open_ground", [False, True])
def test_contradicted_tolerances_are_freed_on_a_plate_where_the_model_explains_the_runs(
    verdict: str, open_ground: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    said, freed = SimpleNamespace(verdict=verdict, chosen=LEVEL), SimpleNamespace(verdict=verdict, chosen=LEVEL)
    monkeypatch.setattr(deciding, "_answered", lambda search, *_: (search, said))
    monkeypatch.setattr(deciding, "fitted_where_absent", lambda *_: False)
    monkeypatch.setattr(deciding, "profiles_of", lambda search, _: {"of": search})
    monkeypatch.setattr(deciding, "_without_contradicted", lambda *_: ("freed", freed))
    ready: Any = SimpleNamespace(last={}, free={}, problem=SimpleNamespace(open_ground=open_ground))
    given: Any = ("search", ready, "session", "progress")
    found = deciding.decided(*given)
    search = "freed" if verdict in ("none", "effect") and not open_ground else "search"
    assert found == (search, freed if search == "freed" else said, {"of": search} if verdict == "effect" else {})


def test_a_ramp_of_the_motors_of_a_small_robot_is_no_lag(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A lag delays each run alike and a ramp the fast ones more; a ramp of 0.25 s was a lag, of probability 1."""
    offer_few(monkeypatch, ("command-lag", "acceleration-limit"), ("none",))
    session = hidden_session(tmp_path, {"acceleration-limit": {"wheel_rpm_s": 210.0}}, exact=True)
    found = diagnose(session, no_progress)
    assert (found.verdict, found.chosen) == ("effect", frozenset({"acceleration-limit"}))
    assert found.fit.point.terms["acceleration-limit"][2] == pytest.approx(1 / 210.0, rel=0.02)
