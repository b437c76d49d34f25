"""Sentences and tables of a diagnosis: each is there where diagnosis.json gives a reason, with its numbers."""

from __future__ import annotations

from typing import Any

import pandas as pd
import pytest

from evaluator.report.diagnosis import sections
from evaluator.report.diagnosis.gap import not_followed_sentence
from evaluator.report.diagnosis.knowledge import (
    knowledge_section,
    mistakes_section,
    negligible_sentence,
)
from evaluator.report.diagnosis.next_runs import next_runs_sentence, separations_sentence
from evaluator.report.diagnosis.sections import diagnosis_sections
from evaluator.report.diagnosis.values import parameter, percent_text, signed_percent, value_text, with_interval
from evaluator.report.diagnosis.view import DiagnosisView
from evaluator.report.diagnosis.words import (
    MEASUREMENTS,
    as_sentence,
    closes,
    effect_words,
    equivalents_sentence,
    left_out_sentence,
    moved_marks_sentence,
    rivals_sentence,
    smoothed_sentence,
    together_sentence,
    unlike_sentences,
    verdict_sentence,
)
from evaluator.report.numbers import UNKNOWN
from evaluator.report.verdict import verdict_lines
from simulator.effects.catalogue import EFFECTS
from tests.evaluator.report.test_gap_said import EFFECT, GAP

FREE = {"id": "free-form", "name": "a moment", "parameters": {}, "fitted": True}


def view(content: dict[str, Any], pieces: pd.DataFrame | None = None, *, outdated: bool = False) -> DiagnosisView:
    return DiagnosisView(content, pieces, outdated)


@pytest.mark.parametrize(
    ("probability", "equivalent", "said"),
    [
        (0.5, ["drive-speed-scale"], True),
        (0.7, ["drive-speed-scale"], False),
        (0.5, [], False),
        (None, ["drive-speed-scale"], False),
    ],
)
def test_an_effect_that_is_a_toss_of_a_coin_stands_beside_its_equivalent(
    probability: float | None, equivalent: list[str], *, said: bool
) -> None:
    effect = {
        "id": "time-base", "name": "seconds are off by a factor", "probability": probability, "equivalent": equivalent,
        "parameters": {},
    }  # fmt: skip
    told = verdict_sentence({"verdict": "effect", "effects": [effect]})
    both = "or equally: both driving wheels are faster or slower than commanded (drive-speed-scale)."
    assert told.endswith(both) == said
    if equivalent:
        would = "To distinguish them: film a clock, or count the turns of a wheel in a minute."
        assert equivalents_sentence(effect).endswith(would)
    assert "To distinguish" not in equivalents_sentence({"id": "dead-band", "equivalent": ["own"]})
    assert set(MEASUREMENTS) <= set(EFFECTS)


def test_quantities_stand_in_a_table_with_what_was_assumed_and_found() -> None:
    items = [
        {"quantity": "a", "name": "track", "unit": "mm", "taken": 0.02, "found": 0.0412, "low": 0.03, "high": 0.05},
        {"quantity": "b", "unit": "1", "taken": 0.5, "found": -1.0, "low": None, "high": None},
        {"quantity": "c", "unit": None, "taken": None, "found": None},
    ]
    section = knowledge_section({"known_to": items, "findings": ["r1 is off"], "negligible": [{"id": "plate-tilt"}]})
    assert section is not None
    assert section.tables[0].rows == (
        ("track", "mm", "0.02", "0.041", "0.030 to 0.050", "far"),
        ("b", "1", "0.5", "−1", UNKNOWN, ""),
        ("c", "", UNKNOWN, UNKNOWN, UNKNOWN, ""),
    )
    assert section.text[0] == "r1 is off."
    assert section.text[1].startswith("Detected, but below the limits of relevance: plate-tilt (radius 0.000 %")
    assert knowledge_section({}) is None
    changes = {"radius_percent": 0.0123, "speed_percent": -0.1, "path_noise_floors": 0.25}
    assert negligible_sentence({"negligible": [{"id": "plate-tilt", "changes": changes}]}).endswith(
        "plate-tilt (radius 0.012 %, speed −0.100 %, path 0.250 of the noise floor)."
    )


def test_mistakes_come_first_with_the_runs_that_are_left_out() -> None:
    items = [{"sentence": "r2: backward", "runs": ["r2"]}, {"sentence": "r1, r2: late", "runs": ["r1", "r2"]}]
    section = mistakes_section({"mistakes": items})
    assert section is not None
    assert section.text == ("r2: backward.", "r1, r2: late.", "Left out of every number of the diagnosis: r2, r1.")
    assert mistakes_section({"mistakes": []}) is None


def test_a_gap_has_its_halves_its_held_out_runs_and_those_not_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sections, "gap_before_after", lambda *_, **__: None)
    gap = {**GAP, "held_out_runs": ["r3", "r9"], "held_out_gain_sigmas": 24.6}
    content = {
        "verdict": "effect", "effects": [EFFECT], "gap": gap, "runs_not_followed": ["r5"],
        "constancy": {"slow and fast": 0.0009, "left and right": 0.001, "forward and backward": None},
    }  # fmt: skip
    section = sections._gap(content)
    assert section is not None
    assert section.text[1].startswith("Held-out runs: r3, r9, which the effect predicts better by 25 sigmas; the sizes")
    assert section.text[2] == "The chosen model does not follow r5. Inspect these recordings first."
    assert section.tables[0].rows == (("slow and fast", "0.090 %", "no"), ("left and right", "0.10 %", "yes"))
    bare = sections._gap({"verdict": "unknown", "gap": {**GAP, "held_out_runs": ["r3"]}, "runs_not_followed": ["r5"]})
    assert bare is not None
    assert bare.text[1] == (
        "Held-out runs: r3; values were adjusted without them, but the verdict is that of all runs."
    )
    assert (len(bare.text), bare.tables) == (2, ())
    assert sections._gap({"gap": {"before": {}}}) is None


def test_alternatives_are_behind_by_their_odds_and_nominal_values_are_adjusted_in_percent() -> None:
    rivals = [
        {"effects": ["plate-tilt", "free:moment.one"], "probability": 0.0024, "log_odds": -6.04, "reason": "so"},
        {"effects": [], "log_odds": None},
        {"other": 1},
        "x",
    ]
    nominal = {"wheels.radius_mm": {"relative_change": -0.0002, "sigma": 0.001, "tolerance": 0.005},
               "mass": {"relative_change": None, "sigma": None, "tolerance": 0.02}}  # fmt: skip
    verdict, alternatives, small = diagnosis_sections(view({"verdict": "none", "rivals": rivals, "nominal": nominal}))
    assert verdict.name == "diagnosis"
    first, second = alternatives.tables[0].rows
    assert first[0].startswith("plate-tilt with ")
    assert first[1:] == ("0.24 %", "6.0", "so")
    assert second == ("nothing missing", UNKNOWN, UNKNOWN, "")
    assert small.tables[0].rows == (
        ("radius of the wheels", "−0.020 %", "0.10 %", "0.50 %"), ("mass", UNKNOWN, UNKNOWN, "2.0 %"),
    )  # fmt: skip
    ground = [{**rivals[0], "carries_over": False}, {"effects": [], "reason": "no", "carries_over": True}]
    _, alternatives = diagnosis_sections(view({"verdict": "none", "rivals": ground}))
    assert alternatives.tables[0].head == ("effects", "reason against it")  # odds alone name nothing there
    assert alternatives.tables[0].rows == ((first[0], "so"), ("nothing missing", "no"))
    assert diagnosis_sections(None) == ()
    assert [signed_percent(share) for share in (0.0123, None)] == ["+1.2 %", UNKNOWN]
    assert [percent_text(share) for share in (0.0, 1e-4, -0.01)] == ["< 0.01 %", "0.010 %", "−1.0 %"]


def test_of_many_disagreements_eight_are_told_and_the_others_counted() -> None:
    where: list[Any] = [{"sentence": f"disagreement {number}"} for number in range(10)]
    effect = {"verdict": "effect", "effects": [EFFECT], "where": [*where, "a word of another program", {}]}
    (_, told) = diagnosis_sections(view(effect))
    assert told.text[0] == "Without these effects, the robot file and the runs disagree as follows:"
    assert told.text[1:9] == tuple(f"Disagreement {number}." for number in range(8))
    assert told.text[9:] == ("A word of another program.", "2 more in diagnosis.json.")
    (_, told) = diagnosis_sections(
        view({"verdict": "unknown", "effects": [EFFECT | {"fitted": False}], "where": where[:1]})
    )
    assert told.text == ("Disagreement 0.",)


@pytest.mark.parametrize(
    ("value", "text"),
    [(None, UNKNOWN), (1234.5, "1234"), (-999.4, "−999"), (1e6, "1e+06"), (1e3, "1000"), (0.01234, "0.0123")],
)
def test_values_have_three_digits_and_no_exponent_at_usual_sizes(value: float | None, text: str) -> None:
    assert value_text(value) == text
    assert with_interval({"value": value, "low": None, "high": 2.0}) == (text, UNKNOWN, "2")


@pytest.mark.parametrize(
    ("name", "effect", "words"),
    [
        ("deg_per_mN", "axle-compliance", ("size", "°/mN")),
        ("angle_deg", "plate-tilt", ("angle", "°")),
        ("per_mm_x", "", ("along x", "per mm")),
        ("x_mm", "", ("x", "mm")),
        ("ratio", "", ("ratio", "")),
    ],
)
def test_a_parameter_is_named_without_its_unit(name: str, effect: str, words: tuple[str, str]) -> None:
    assert parameter(name, effect) == words


def test_sentences_that_have_no_reason_are_empty() -> None:
    nothing: dict[str, Any] = {"verdict": "none", "effects": []}
    empty = (left_out_sentence, next_runs_sentence, rivals_sentence, separations_sentence, negligible_sentence)
    assert [sentence(nothing) for sentence in empty] == [""] * len(empty)
    assert unlike_sentences(nothing) == []
    assert equivalents_sentence(nothing) == ""
    assert as_sentence("") == ""
    assert as_sentence("r01: -5 rpm") == "r01: −5 rpm."
    assert as_sentence("speed: -5 rpm.") == "Speed: −5 rpm."
    assert as_sentence("from r06 on it is lower: was the plate cleaned?") == (
        "From r06 on it is lower: was the plate cleaned?"
    )
    assert effect_words("plate-tilt") == "plate-tilt"


def test_that_nothing_is_left_over_is_said_only_where_nothing_is(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("disagreement_map", "disagreement_panels"):
        monkeypatch.setattr(f"evaluator.report.diagnosis.sections.{name}", lambda *_, **__: None)
    nothing = "The residuals do not depend significantly on any quantity that was examined."
    for where, said in ([], nothing), ([{"sentence": "it turns"}], "It turns."):
        (_, told) = diagnosis_sections(view({"verdict": "unknown", "where": where}, pd.DataFrame({"run": ["r1"]})))
        assert told.text == (said,)


def test_of_runs_left_out_for_one_reason_five_are_named_and_the_others_counted() -> None:
    six = {f"r{k}": "dark" for k in range(6)}
    assert left_out_sentence({"skipped_runs": six}) == "Left out of the diagnosis: r0, r1, r2, r3, r4, r5 (dark)."
    assert "r0, r1, r2, r3, r4 and 2 others (dark); x (late)" in left_out_sentence(
        {"skipped_runs": six | {"r6": "dark"}, "left_out_runs": {"x": "late"}}
    )


def test_further_runs_are_said_with_how_often_and_what_they_separate() -> None:
    run = {"left_rpm": 5.0, "right_rpm": -6.0, "duration_s": 8.0, "x_mm": 1.5, "y_mm": -2.0, "heading_deg": 90.0}
    following = {"runs": [{**run, "times": times} for times in (1, 2, 3)]}
    said = next_runs_sentence({"next_experiment": following})
    each = "5 / −6 rpm for 8 s from x 1.5 mm, y −2 mm at heading 90°"
    assert said == f"Most informative further runs: {each}; {each} (twice); {each} (3 times)."
    apart = {"separation_sigmas": {"a + b": 5.21, "c": None, "d": 1.0}, "inseparable_sigmas": {"e": 0.44}}
    named = [{"id": "plate-tilt"}, {"id": "speed-ripple"}]
    assert separations_sentence({"next_experiment": apart, "effects": named}) == (
        "Expected separation with these further runs: 5.2 sigmas from a with b and 1.0 sigmas from d. "
        "Even many further runs at these speeds on this plate would not distinguish plate-tilt with "
        "speed-ripple from e (0.4 sigmas): inspect the robot, the plate and the wires, or drive faster."
    )
    assert separations_sentence({"next_experiment": {"separation_sigmas": {"a": 1.0}}}).endswith("1.0 sigmas from a.")
    assert separations_sentence({"next_experiment": None}) == ""


@pytest.mark.parametrize(
    ("content", "closed", "said"),
    [
        ({"verdict": "unknown", "effects": [FREE]}, True, "explains; the best free-form explanation is a moment."),
        (
            {"verdict": "unknown", "effects": [EFFECT | {"fitted": False}, FREE | {"fitted": False}]},
            False, "explains, and no free-form term does either; the nearest is a moment; and the plate is not level.",
        ),
        (
            {"verdict": "unknown", "effects": [], "where": [{"sentence": "speed is -1 mm/s off"}]},
            False, "does either; the largest disagreement: speed is −1 mm/s off.",
        ),
        ({"verdict": "insufficient"}, True, "These runs cannot decide whether an effect is missing, or which."),
        ({"verdict": "insufficient", "stopped": True}, True, "The search ended before a decision."),
        ({"verdict": "odd"}, True, ""),
    ],
)  # fmt: skip
def test_a_verdict_says_what_explains_most(content: dict[str, Any], closed: bool, said: str) -> None:
    assert verdict_sentence(content).endswith(said)
    assert closes(content) is closed


def test_what_a_terminal_shows_has_findings_once_and_runs_not_followed_where_a_model_was_found() -> None:
    content: dict[str, Any] = {"verdict": "none", "reason": "so", "effects": [], "findings": ["wheel is off"]}
    lines = verdict_lines(content)
    assert sum("heel is off" in line for line in lines) == 1
    effect = {**content, "verdict": "effect", "effects": [EFFECT], "runs_not_followed": ["r5", "r6"]}
    lines = verdict_lines(effect)
    assert "Wheel is off." in lines
    assert "The chosen model does not follow r5, r6. Inspect these recordings first." in lines
    assert "Left out" not in " ".join(lines)
    assert "Left out of the diagnosis: r7 (alone)." in verdict_lines(
        {**content, "left_out_runs": {"r7": "alone"}, "skipped_runs": {"r8": "dark"}}
    )
    lost = {**effect, "verdict": "unknown", "effects": [{**EFFECT, "fitted": False}]}
    assert "follow" not in " ".join(verdict_lines(lost))
    assert not_followed_sentence({**lost, "gap": {"by_run": {f"r{run}": {} for run in range(5)}}}) == ""
    told = not_followed_sentence({**lost, "gap": {"by_run": {f"r{run}": {} for run in range(6)}}})
    assert told == "The nearest model follows all runs but r5, r6. Inspect these recordings first."
    first = verdict_lines({**content, "mistakes": [{"sentence": "r1: backward", "runs": ["r1"]}]})
    assert first[0] == "r1: backward."


@pytest.mark.parametrize(
    ("id_", "bounds", "said"),
    [
        ("command-lag", ((0.0, 0.01), (0.0, 0.03)), "(dead_time_s = 0 and time_constant_s = 0)"),
        ("command-lag", ((0.0, 0.01), (0.02, 0.03)), ""),
        ("magnet-strength", ((0.9, 1.1), (0.5, 1.5)), "(driving_factor = 1 and driven_factor = 1)"),
        ("magnet-strength", ((0.9, 1.1), (1.1, 1.5)), ""),
        ("magnet-strength", ((0.9, 1.1), (None, 1.5)), ""),
        ("axle-compliance", ((-0.1, 0.1),), ""),  # of one value
        ("free:x", ((-0.1, 0.1), (-0.1, 0.1)), ""),
    ],
)
def test_values_that_may_each_be_those_of_no_effect_are_not_all_at_once(
    id_: str, bounds: tuple[tuple[float | None, float], ...], said: str
) -> None:
    names = [item.name for item in EFFECTS[id_].parameters] if id_ in EFFECTS else ["a", "b"]
    content = {name: {"value": 0.0, "low": low, "high": high} for name, (low, high) in zip(names, bounds, strict=True)}
    found = together_sentence({"id": id_, "parameters": content})
    assert found == (f"Each of these values may be the one of no effect, but not all at once {said}." if said else "")


def test_frames_of_smoothed_tracks_that_are_not_used_are_told() -> None:
    assert smoothed_sentence({"noise": {"smoothed": True}}).startswith("The tracks are smoothed over several frames")
    assert [smoothed_sentence(content) for content in ({"noise": {"smoothed": False}}, {"noise": None}, {})] == [""] * 3


def test_displaced_marks_are_told_to_displace_everything_measured() -> None:
    """The radius of a tightest turn stayed 33 % wrong above the finding that the marks are 1 mm off."""
    given = {"x_mm": (0.98, 0.01), "y_mm": (-0.87, 0.01), "angle_deg": (8.0, 0.1)}
    parameters = {
        name: {"value": best, "low": best - half, "high": best + half} for name, (best, half) in given.items()
    }
    content: dict[str, Any] = {"verdict": "effect", "effects": [{"id": "mark-offset", "parameters": parameters}]}
    said = moved_marks_sentence(content)
    assert "another point than the robot's centre" in said
    assert "by 8.00° about the centre, move them by (0.980, −0.870) mm" in said
    assert moved_marks_sentence({**content, "verdict": "unknown"}) == ""
    assert moved_marks_sentence({"verdict": "effect", "effects": []}) == ""
