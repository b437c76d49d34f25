"""Which sentences a verdict has in a terminal and on the page, which rival is told, how several things are listed."""

from __future__ import annotations

import math
from typing import Any

import pytest

from evaluator.diagnosis.assessment.verdict import KEEP
from evaluator.report.diagnosis.next_runs import RUN_KEYS, next_runs, separations_sentence
from evaluator.report.diagnosis.sections import diagnosis_sections
from evaluator.report.diagnosis.view import DiagnosisView
from evaluator.report.diagnosis.where import WITHOUT_EFFECTS
from evaluator.report.diagnosis.words import (
    NAMED_LOG_ODDS,
    reason_sentence,
    rivals_sentence,
    verdict_sentence,
    words_of,
)
from evaluator.report.summary import diagnosis_sentence
from evaluator.report.verdict import verdict_lines
from evaluator.wording import NOTHING_MISSING

SIZE = {"value": 1.8, "low": 1.7, "high": 1.9}
TILT = {"id": "plate-tilt", "name": "the plate is not level", "probability": 0.998, "parameters": {"angle_deg": SIZE}}
WHERE = [{"sentence": f"it turns at {number}"} for number in range(6)]
FOUND: dict[str, Any] = {"verdict": "effect", "reason": "so", "effects": [TILT], "where": WHERE}


def test_an_effect_has_its_probability_and_what_disagrees_without_it() -> None:
    lines = verdict_lines(FOUND)
    assert "plate-tilt, probability 0.998:" in lines
    assert lines[lines.index(WITHOUT_EFFECTS) + 1 :][:4] == [f"It turns at {number}." for number in range(4)]
    assert "It turns at 4." not in lines
    free = {"id": "free-form", "name": "a moment", "probability": 0.6, "parameters": {}, "fitted": True}
    lines = verdict_lines({**FOUND, "verdict": "unknown", "effects": [free]})
    assert "free-form:" in lines  # a term without a name has no probability as an effect
    unfitted = verdict_lines({**FOUND, "verdict": "unknown", "effects": [{**free, "fitted": False}]})
    assert WITHOUT_EFFECTS not in unfitted
    assert "It turns at 0." in unfitted
    assert WITHOUT_EFFECTS not in verdict_lines({**FOUND, "verdict": "none", "effects": []})


def test_an_effect_that_is_told_as_a_value_beyond_its_tolerance_is_no_rival_of_that() -> None:
    rival = {"effects": ["drive-speed-mismatch"], "log_odds": 3.2, "strains": []}
    known = {"name": "radius of the left over the right wheel", "equivalent": ["drive-speed-mismatch"]}
    content: dict[str, Any] = {"verdict": "none", "rivals": [rival], "known_to": [known]}
    finding = "radius of the left over the right wheel: off by +0.029, tolerance 0.0071"
    assert "drive-speed-mismatch" in rivals_sentence(content)
    assert rivals_sentence({**content, "findings": [finding]}) == ""
    more = {**rival, "effects": ["drive-speed-mismatch", "dead-band"]}
    assert "dead-band" in rivals_sentence({**content, "findings": [finding], "rivals": [more]})
    assert "drive-speed-mismatch" in rivals_sentence({**content, "findings": ["track: off by +0.2 mm"]})
    found = {**content, "verdict": "effect", "effects": [{"id": "dead-band"}], "rivals": [more]}
    assert rivals_sentence({**found, "findings": [finding]}) == ""
    assert "dead-band" in rivals_sentence({**found, "findings": []})


def test_a_free_form_term_that_may_be_zero_is_told_after_the_effects() -> None:
    free = {"id": "free-form", "name": "a moment", "parameters": {"m": {"value": 1.0, "low": 0.5, "high": 1.5}}}
    unknown: dict[str, Any] = {"verdict": "unknown", "effects": [TILT, free]}
    said = verdict_sentence(unknown)
    doubt = said.index(", beside effects that may be there or imitate the same: ")
    assert 0 < said.index("a moment") < doubt < said.index("the plate is not level")
    vague = {**free, "parameters": {"m": {"value": 1.0, "low": -0.1, "high": 2.1}}}
    said = verdict_sentence({**unknown, "effects": [vague, TILT]})
    assert 0 < said.index("the plate is not level") < said.index("a moment")
    assert "beside" not in said
    assert "a moment" in verdict_sentence({**unknown, "effects": [{**free, "parameters": {}}]})
    assert "the nearest known explanation is the plate" in verdict_sentence({**unknown, "effects": [TILT]})


def test_why_nothing_is_missing_is_told_once() -> None:
    none: dict[str, Any] = {"verdict": "none", "effects": [], "reason": NOTHING_MISSING}
    assert "explains these runs within noise" in verdict_sentence(none)
    assert reason_sentence(none) == ""
    assert (
        reason_sentence({**none, "reason": f"{NOTHING_MISSING}; the residuals are small"}) == "The residuals are small."
    )
    assert reason_sentence({**none, "reason": "the effects found are small"}) == "The effects found are small."
    assert reason_sentence({**none, "verdict": "insufficient"}) != ""
    assert reason_sentence({"verdict": "none"}) == ""


def test_nothing_is_missing_only_in_the_kinds_of_motion_that_were_driven() -> None:
    none: dict[str, Any] = {"verdict": "none", "effects": []}
    assert verdict_sentence(none).startswith("Nothing is missing: the model")
    some = verdict_sentence({**none, "not_driven": ["right turns", "backward motion"]})
    assert some.startswith("Nothing is missing in runs without right turns and without backward motion: the model")


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({}, True),
        ({"log_odds": math.log(5.0) - 0.01}, False),
        ({"log_odds": None}, False),
        ({"effects": []}, False),
        ({"effects": ["plate-tilt", "free:moment.one"]}, False),
        ({"strains": ["wheelbase_mm"]}, False),
    ],
)
@pytest.mark.parametrize("verdict", ["none", "effect", "unknown"])
def test_a_rival_is_told_that_is_five_times_as_probable_and_has_a_name_and_strains_nothing(
    verdict: str, more: dict[str, Any], *, said: bool
) -> None:
    rival = {"effects": ["dead-band", "plate-tilt"], "log_odds": math.log(5.0) + 0.01, "strains": [], **more}
    found = rivals_sentence({"verdict": verdict, "rivals": ["damaged", rival]})
    assert bool(found) == (said and verdict != "unknown")
    if found:
        odds = "odds of 5.1 to 1; an effect is named from 3000 to 1 on"
        assert found == f"Not decided by these runs: dead-band with plate-tilt ({odds})."
    headline = verdict_sentence({"verdict": "none", "rivals": [rival]})
    assert headline.startswith("Nothing is proven missing: " if said else "Nothing is missing: ")


def test_a_rival_that_does_not_carry_over_is_told_so() -> None:
    rival = {"effects": ["dead-band"], "log_odds": 9.0, "carries_over": False}
    said = rivals_sentence({"verdict": "none", "rivals": [rival]})
    few = "it predicts commands left out no better than chance, and more commands would decide"
    assert said == f"More probable in these runs, but not named: dead-band ({few})."
    rival["carries_over"] = True
    rival["reason"] = "it is too large"
    refused = "but not named: dead-band (odds of 8103 to 1; it is too large)"
    assert refused in rivals_sentence({"verdict": "none", "rivals": [rival]})
    assert min(KEEP[1:]) == NAMED_LOG_ODDS
    rival["log_odds"] = 50.0  # beyond e²⁰ the number says nothing more
    assert "(odds of 485165195 to 1;" in rivals_sentence({"verdict": "none", "rivals": [rival]})


def test_further_runs_without_all_their_values_are_left_out() -> None:
    run = dict.fromkeys(RUN_KEYS, 1)
    damaged = {key: value for key, value in run.items() if key != "times"}
    assert next_runs({"next_experiment": {"runs": [run, damaged, "damaged"]}}) == [run]
    assert next_runs({"next_experiment": {"runs": None}}) == []
    assert next_runs({"next_experiment": "damaged"}) == []


def test_of_three_things_the_first_two_have_a_comma_and_the_last_an_and() -> None:
    names = ("dead-band", "plate-tilt", "tether-pull")
    sigmas = dict(zip(names, (1.04, 2.06, 3.0), strict=True))
    following = {"separation_sigmas": {**sigmas, "unknown": None}, "inseparable_sigmas": {"dead-band": 0.5}}
    assert separations_sentence({"next_experiment": following}) == (
        "Expected separation with these further runs: 1.0 sigmas from dead-band, 2.1 sigmas from plate-tilt and "
        "3.0 sigmas from tether-pull. Even many further runs at these speeds on this plate would not distinguish "
        "the answer from dead-band (0.5 sigmas): inspect the robot, the plate and the wires, or drive faster."
    )
    assert words_of("dead-band + plate-tilt") == "dead-band with plate-tilt"


def test_the_summary_names_what_an_effect_cannot_be_distinguished_from() -> None:
    """It named a tilt alone, and the wire that explains the runs as well stood a page below."""
    said = diagnosis_sentence({**FOUND, "effects": [{**TILT, "equivalent": ["tether-spring"]}]})
    assert "cannot distinguish plate-tilt from: a wire pulls toward a fixed anchor (tether-spring)" in said
    assert "distinguish" not in diagnosis_sentence(FOUND)


def test_the_page_says_what_the_verdict_is_with_rivals_and_effects_that_cannot_be_distinguished() -> None:
    rival = {"effects": ["dead-band"], "log_odds": 9.0, "probability": 0.4}
    content = {
        **FOUND,
        "effects": [{**TILT, "equivalent": ["tether-pull"]}],
        "rivals": [rival],
        "next_experiment": {"separation_sigmas": {"tether-pull": 4.2}},
    }
    (verdict, *_) = diagnosis_sections(DiagnosisView(content, None, outdated=False))
    text = " ".join(verdict.text)
    for said in (
        "Missing in the model: the plate is not level",
        "So.",
        "cannot distinguish plate-tilt from",
        "4.2 sigmas",
    ):
        assert said in text
    assert "but not named: dead-band" in text
    assert "after this diagnosis" not in text
    (verdict, *_) = diagnosis_sections(DiagnosisView(content, None, outdated=True))
    assert verdict.text[0].startswith("The diagnosis is out of date, because recordings, robot or program changed")
    assert diagnosis_sections(None) == ()


def test_nothing_is_missing_if_values_are_off_that_are_certainly_beyond_two_tolerances() -> None:
    """A centre of gravity 40.2 mm [39.7, 40.7] off, of 14 mm, stood below a headline that nothing is missing."""
    gravity = {"quantity": "x", "name": "centre of gravity", "unit": "mm", "taken": 14.0, "found": 40.2}
    sure = {**gravity, "low": 39.7, "high": 40.7}
    ratio = {"quantity": "r", "name": "left over right", "unit": "1", "taken": 0.007, "found": -0.0152}
    known = [
        sure,
        {**gravity, "low": 27.9, "high": 52.5},  # its near end is within two tolerances
        {**gravity, "low": None, "high": None},
        {**sure, "from_run": "r3"},
        {**ratio, "low": -0.0155, "high": -0.0149},
    ]
    said = verdict_sentence({"verdict": "none", "known_to": known})
    assert said == (
        "Nothing is missing: the model explains these runs within noise, scatter and tolerances, if centre of gravity "
        "is off by 40.2 mm (2.9 tolerances) and left over right is off by −0.0152 (2.2 tolerances)."
    )
    assert verdict_sentence({"verdict": "none", "known_to": known[1:4]}).endswith("scatter and tolerances.")
