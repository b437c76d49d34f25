"""The sections on a diagnosis, from diagnosis.json alone, whoever wrote it and whatever it says."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest

from evaluator.diagnosis.assessment.residuals.disagreement import COLUMNS, QUANTITIES, SHOWN_SIGMAS, every_dependence
from evaluator.report.diagnosis.knowledge import finding_sentences, preferred_sentence
from evaluator.report.diagnosis.next_runs import next_runs_sentence
from evaluator.report.diagnosis.sections import diagnosis_sections
from evaluator.report.diagnosis.values import length, parameter, parameters, sizes
from evaluator.report.diagnosis.view import DiagnosisView
from evaluator.report.diagnosis.where import where_sentences
from evaluator.report.diagnosis.words import (
    left_out_sentence,
    not_tried_sentence,
    rivals_sentence,
    verdict_sentence,
)
from evaluator.report.numbers import UNKNOWN
from evaluator.report.verdict import verdict_lines
from simulator.effects.catalogue import EFFECTS

# As the file contract shows it: another program may write no more than this.
CONTRACT: dict[str, Any] = {
    "format": 1,
    "verdict": "effect",
    "effects": [
        {
            "id": "plate-tilt",
            "name": "the plate is not level",
            "parameters": {"angle_deg": {"value": 1.81, "low": 1.72, "high": 1.90}},
            "equivalent": ["tether-spring"],
            "probability": 0.998,
        }
    ],
    "gap": {
        "unit": "mm",
        "held_out_runs": ["r03", "r09"],
        "before": {"fit": 0.41, "held_out": 0.44},
        "after": {"fit": 0.006, "held_out": 0.007},
        "noise_floor": 0.006,
    },
    "where": [],
    "rivals": [],
    "next_experiment": None,
}
SENTENCE = "measured sideways speed varies with heading: 0.04 mm/s more at 278 degrees, whichever way it drives"


def pieces_of(across: float, seed: int = 0) -> pd.DataFrame:
    """Pieces of twelve runs that slide sideways by so much, in mm/s, at heading 0, and back at 180 degrees."""
    rng = np.random.default_rng(seed)
    rows = []
    for run in range(12):
        for second, heading in enumerate(rng.uniform(0, 360, 6)):
            slide = across * np.cos(np.radians(heading))
            misfit = {"along_mm_s": 0.0, "across_mm_s": slide, "yaw_deg_s": 0.0}
            misfit = {name: value + 0.003 * rng.normal() for name, value in misfit.items()}
            place = dict(zip(("x_mm", "y_mm"), rng.uniform(-20, 20, 2), strict=True))
            speeds = {"direction": (-1.0) ** run, "side": float(run % 3 - 1), "speed_rpm": 30.0 + run % 4}
            turn = {"difference_rpm": 20.0 * (run % 3 - 1) ** 2, "heading_deg": heading}
            rows.append({"run": f"r{run}", "time_s": second + 0.5, "order": run, **misfit, **place, **speeds, **turn})
    table = pd.DataFrame(rows)[list(COLUMNS)]
    return table.assign(**{f"after_{name}": 0.003 * rng.normal(size=len(table)) for name in QUANTITIES})


def test_a_diagnosis_of_another_program_is_shown_with_verdict_size_equivalents_and_gap() -> None:
    verdict, gap = diagnosis_sections(DiagnosisView(CONTRACT, None, outdated=False))
    assert verdict.text == (
        "Missing in the model: the plate is not level (plate-tilt), angle 1.81° [95 %: 1.72 to 1.90].",
        (
            "These runs cannot distinguish plate-tilt from: a wire pulls toward a fixed anchor (tether-spring). To "
            "distinguish them: put a level on the plate, or drive with the wires held loose."
        ),
    )
    assert "from 410 µm to 6 µm on fitted runs and from 440 µm to 7 µm on held-out runs" in gap.text[0]


def test_runs_to_make_stand_in_a_table_with_what_they_would_and_would_not_separate() -> None:
    run = {"left_rpm": -60.0, "right_rpm": 42.0, "x_mm": 1.5, "y_mm": -3.0, "heading_deg": 45, "duration_s": 8.0}
    following = {
        "runs": [{**run, "times": 2}],
        "separation_sigmas": {"mass-offset": 5.2},
        "most_runs": 8,
        "inseparable_sigmas": {"tether-spring": 1.25},
    }
    verdict, _ = diagnosis_sections(DiagnosisView({**CONTRACT, "next_experiment": following}, None, outdated=False))
    assert verdict.tables[1].rows == (("−60", "42", "8", "1.5", "−3", "45", "2"),)
    assert "5.2 sigmas from mass-offset" in verdict.text[-1]
    assert "Even 8 further runs" in verdict.text[-1]
    assert "tether-spring (1.2 sigmas)" in verdict.text[-1]
    assert "−60 / 42 rpm for 8 s" in next_runs_sentence({"next_experiment": following})


@pytest.mark.parametrize(
    ("rival", "told"),
    [
        ({"effects": ["viscous-drag"], "log_odds": 5.3, "strains": []}, True),
        ({"effects": ["viscous-drag"], "log_odds": 1.5, "strains": []}, False),
        ({"effects": ["viscous-drag"], "log_odds": 8.7, "strains": ["green_y_mm", "yellow_y_mm"]}, False),
        ({"effects": ["free:speed.one"], "log_odds": 5.3, "strains": []}, False),
        ({"effects": [], "log_odds": 5.3, "strains": []}, False),
    ],
)
def test_a_rival_more_probable_than_the_verdict_is_told_with_its_odds(rival: dict[str, Any], told: bool) -> None:
    sentence = rivals_sentence({"verdict": "none", "rivals": [rival]})
    assert ("odds of 200 to 1" in sentence and "viscous" in sentence) is told
    assert bool(sentence) is told
    assert rivals_sentence({"verdict": "unknown", "rivals": [rival]}) == ""
    unconfirmed = rivals_sentence({"verdict": "effect", "rivals": [rival | {"carries_over": False}]})
    assert ("no better than chance" in unconfirmed) is told


def test_a_limit_that_limits_nothing_is_infinite_and_a_large_force_is_a_number() -> None:
    value = {"value": 1e6, "low": 43.7038, "high": 1e6}
    assert sizes("ahead_rpm", value, "speed-limit") == ("∞", "43.7", "∞")
    assert sizes("ahead_rpm", {"value": 30.0, "low": 20.0, "high": 1e6}, "speed-limit") == ("30", "20", "∞")
    assert "∞" not in sizes("x_mN", value, "tether-pull")


def test_a_verdict_names_the_limits_that_act_and_from_where_on_others_may() -> None:
    """The headline of limited wheels went on with "ahead ∞ rpm [50.7 to ∞]"."""
    none = {"value": 1e6, "low": 43.7038, "high": 1e6}
    acts = {"value": 30.0, "low": 29.0, "high": 31.0}
    effect = {**CONTRACT["effects"][0], "id": "speed-limit", "name": "limit"}
    higher = "if there are other limits, they are above 43.7 rpm (ahead) and 43.7 rpm (turn)"
    for given, told in (
        ({"wheel_rpm": acts, "ahead_rpm": none, "turn_rpm": none}, f"wheel 30.0 rpm [95 %: 29.0 to 31.0]; {higher}."),
        ({"wheel_rpm": none, "ahead_rpm": none}, "wheel ∞ rpm [95 %: 43.7 to ∞], ahead ∞ rpm [43.7 to ∞]."),
    ):
        content = {**CONTRACT, "effects": [effect | {"parameters": given}]}
        assert f"Missing in the model: limit (speed-limit), {told}" in verdict_sentence(content)


def test_values_far_outside_their_tolerances_are_said_in_the_sentence_of_the_verdict() -> None:
    """The sentence had 90 words: the tolerances follow in a sentence for each value."""
    off = "radius of the left wheel: off by -0.03, tolerance 0.0071"
    later = "motion starts 20 ms later than start_s in all runs"
    begin = "No effect is missing, but not all values are as stated: radius of the left wheel off by −0.03"
    content: dict[str, Any] = {"verdict": "none", "findings": [off]}
    assert verdict_sentence(content) == f"{begin} (more than three tolerances)."
    content = {**content, "findings": [off, later], "known_together": {"sentence": "all deviate (p 0.1)"}}
    assert verdict_sentence(content) == f"{begin}; {later} (each more than three tolerances)."
    assert finding_sentences(content) == [
        "Radius of the left wheel: off by −0.03, tolerance 0.0071.",
        "Motion starts 20 ms later than start_s in all runs.",
        "All deviate (p 0.1).",
    ]


def test_values_off_together_are_said_in_the_sentence_of_the_verdict_and_among_the_findings() -> None:
    at_once = "the values with a tolerance deviate jointly by more than chance"
    content = {"verdict": "none", "findings": [], "known_together": {"sentence": f"{at_once} (probability 0.0004)"}}
    assert verdict_sentence(content) == f"No effect is missing, but not all values are as stated: {at_once}."
    assert finding_sentences(content) == [f"T{at_once[1:]} (probability 0.0004)."]
    usual = {**content, "known_together": {"sentence": None}}
    assert "Nothing is missing" in verdict_sentence(usual)
    assert finding_sentences(usual) == []


@pytest.mark.parametrize(
    ("content", "opening"),
    [
        ({"verdict": "none"}, "With the nominal values of the robot file"),
        ({"verdict": "none", "negligible": [{"id": "command-lag"}]}, "no relevant disagreement remains."),
        ({"verdict": "effect"}, "Measured sideways speed varies"),
    ],
)
def test_a_disagreement_beside_the_verdict_none_is_said_to_be_within_what_is_known(
    content: dict[str, Any], opening: str
) -> None:
    sentences = where_sentences({**content, "where": [{"sentence": SENTENCE}]}, 4)
    assert opening in sentences[0]
    assert "278 degrees" in sentences[-1]
    assert where_sentences({**content, "where": []}, 4) == []
    faint, told = ({"sentence": SENTENCE, "sigmas": sigmas} for sigmas in (1.9, SHOWN_SIGMAS))
    assert where_sentences({**content, "where": [faint]}, 4) == []
    assert where_sentences({**content, "where": [faint, told]}, 4) == sentences


def test_a_next_experiment_of_another_program_is_left_alone() -> None:
    verdict, _ = diagnosis_sections(
        DiagnosisView({**CONTRACT, "next_experiment": {"runs": ["x"]}}, None, outdated=False)
    )
    assert len(verdict.tables) == 1


@pytest.mark.parametrize(
    ("verdict", "said"),
    [("none", "Nothing is missing"), ("insufficient", "cannot decide"), ("unknown", "278 degrees")],
)
def test_every_verdict_is_one_sentence(verdict: str, said: str) -> None:
    content = {"format": 1, "verdict": verdict, "effects": [], "gap": None, "where": [{"sentence": SENTENCE}]}
    sections = diagnosis_sections(DiagnosisView(content, None, outdated=True))
    assert "run turnscope diagnose again" in sections[0].text[0]
    assert said in sections[0].text[1]


def test_what_the_pieces_hold_is_found_drawn_and_gone_after() -> None:
    pieces = pieces_of(0.02)
    strongest = max(every_dependence(pieces), key=lambda item: item.sigmas)
    assert (strongest.quantity, strongest.by, strongest.parity) == ("across_mm_s", "heading", "even")
    view = DiagnosisView({**CONTRACT, "where": [{"sentence": strongest.sentence}]}, pieces, outdated=False)
    (where,) = (section for section in diagnosis_sections(view) if section.name == "diagnosis-where")
    over, panels = where.figures
    table = over.data.set_index(["quantity", "by", "model"])["sigmas"]
    assert table["sideways", "heading, even", "before"] > 5
    assert table["sideways", "heading, even", "after"] < SHOWN_SIGMAS
    assert "sideways speed" in panels.panels[0]
    plain = " ".join((*over.panels, *panels.panels))
    assert all(f"var({variable}" in plain for variable in ("--vermillion", "--blue", "--ink"))


def test_chance_alone_stands_out_in_few_experiments() -> None:
    found = [
        max(item.sigmas for item in every_dependence(pieces_of(0.0, seed)) if item.quantity == "along_mm_s")
        for seed in range(30)
    ]
    assert sum(value >= SHOWN_SIGMAS for value in found) <= 2


def test_every_parameter_of_every_effect_has_words_and_no_underscore() -> None:
    for effect in EFFECTS.values():
        for item in effect.parameters:
            words, _ = parameter(item.name)
            assert words
            assert "_" not in words
    words = "a relative error of the surface speed varying with the cosine of heading (driving wheels)"
    assert parameter("speed.cos_heading.driving") == (words, "")
    squared = "a moment about the vertical growing with the square of forward speed"
    assert parameter("moment.u_abs_u") == (squared, "µN·mm/(mm/s)²")
    assert parameter("rms_across_mm_s", "free-form") == ("sideways (RMS)", "mm/s")
    assert parameter("magic.of_wheels") == ("magic of wheels", "")  # a file of another program
    assert parameter("moment.moon_phase") == ("moment moon phase", "")
    several = {"id": "free-form", "parameters": {"moment.u_abs_u": {}, "speed.cos_heading.driving": {}}}
    assert [each for each, _ in parameters(several).values()] == [squared, words]
    waves = {"id": "free-form", "parameters": {"moment.cos_heading": {}, "moment.sin_heading": {}}}
    assert [each for each, _ in parameters(waves).values()] == ["cosine of heading", "sine of heading"]
    del several["parameters"]["speed.cos_heading.driving"]  # what its name says already
    assert parameters(several) == {"moment.u_abs_u": ("size", "µN·mm/(mm/s)²")}


def test_lengths_are_told_in_the_unit_of_their_size() -> None:
    told = [length(value) for value in (0.00764, 0.9994, 5.964, 410.2, 1893.0, None)]
    assert told == ["7.64 µm", "999 µm", "5.96 mm", "410 mm", "1.89 m", UNKNOWN]


def test_runs_that_are_left_out_are_named_with_the_reason() -> None:
    assert left_out_sentence({"skipped_runs": {}}) == ""
    content = {"skipped_runs": {"r2": "no marks"}, "left_out_runs": {"r7": "wheel-toe rests on it alone"}}
    assert left_out_sentence(content) == ("Left out of the diagnosis: r2 (no marks); r7 (wheel-toe rests on it alone).")


@pytest.mark.parametrize(
    ("verdict", "probability", "line"),
    [
        ("effect", 0.9999, "plate-tilt, probability above 0.999:"),
        ("effect", 0.62, "plate-tilt, probability 0.620:"),
        ("effect", 0.0004, "plate-tilt, probability below 0.001:"),
        ("unknown", 0.0004, "plate-tilt:"),
    ],
)
def test_a_probability_is_told_of_what_is_named_and_is_neither_nought_nor_one(
    verdict: str, probability: float, line: str
) -> None:
    content = {**CONTRACT, "reason": "so", "verdict": verdict}
    content["effects"] = [{**CONTRACT["effects"][0], "probability": probability}]
    assert line in verdict_lines(content)


def test_a_parameter_is_told_with_its_bounds_and_four_disagreements_are() -> None:
    said = {"angle_deg": {"value": -1.81234, "low": -1.9, "high": -1.72}}
    content = {**CONTRACT, "reason": "so", "effects": [{**CONTRACT["effects"][0], "parameters": said}]}
    content["where"] = [{"sentence": f"disagreement {number}"} for number in range(5)]
    lines = verdict_lines(content)
    assert "  angle_deg = −1.81  [95 %: −1.90 to −1.72]" in lines
    assert [line for line in lines if "isagreement" in line] == [f"Disagreement {number}." for number in range(4)]


def test_effects_that_these_runs_cannot_show_are_told_with_the_reason() -> None:
    content = {"not_tried": ["plate-tilt", "speed-drift", "stray-magnet"]}
    said = not_tried_sentence(content)
    assert "fixed to the plate were not tested: plate-tilt, stray-magnet. Commands are not repeated" in said
    assert said.endswith("effects that change from run to run were not tested: speed-drift.")
    assert not_tried_sentence({"not_driven": ["right turns", "backward motion"]}) == (
        "These runs have no right turns and no backward motion: what acts there alone was not tested."
    )
    limit = {"ahead_rpm": {"value": 1e6, "low": 51.7, "high": 1e6}}
    content = {**CONTRACT, "reason": "so", "effects": [{**CONTRACT["effects"][0], "id": "speed-limit"}]}
    content["effects"][0]["parameters"] = limit
    assert "  ahead_rpm = ∞  [95 %: 51.7 to ∞]" in verdict_lines(content)


def test_what_follows_from_exact_frictions_is_told_with_their_keys() -> None:
    (told,) = [
        line
        for line in verdict_lines({**CONTRACT, "reason": "so", "exact_frictions": ["slip.a", "slip.b"]})
        if "counts as exact" in line
    ]
    assert told.endswith("[tolerance] of robot.toml (slip.a, slip.b; of open ground about 0.3).")
    assert not any("counts as exact" in line for line in verdict_lines({**CONTRACT, "reason": "so"}))


def test_runs_that_are_unlike_the_others_are_told_beside_the_verdict() -> None:
    sentence = "r08, r09: the left wheels turn 1.5 % faster than in the other runs"
    lines = verdict_lines({**CONTRACT, "reason": "so", "unlike_runs": [{"runs": ["r08", "r09"], "sentence": sentence}]})
    assert lines[lines.index(f"{sentence}.") - 1].startswith("Runs unlike the others")


def test_values_that_the_data_prefer_are_told_the_farthest_first() -> None:
    def value(name: str, found: float, taken: float) -> dict[str, Any]:
        return {"quantity": name, "unit": "mm", "taken": taken, "found": found, "low": found - 0.1, "high": found + 0.1}

    items = [value("near", 1.0, 1.0), value("far", -2.5, 1.0), value("nought", 0.05, 0.01), value("next", 1.9, 1.0)]
    assert preferred_sentence({"known_to": items}) == (
        "Of the values with a tolerance, the data prefer: far −2.50 mm [−2.60, −2.40] (2.5 tolerances); "
        "next 1.90 mm [1.80, 2.00]; near 1.00 mm [0.90, 1.10]."
    )
    alike = {"equivalent": ["drive-speed-scale", "time-base"]}
    assert preferred_sentence({"known_to": [{**item, **alike} for item in items[:2]]}).endswith(
        "far −2.50 mm [−2.60, −2.40] (2.5 tolerances, or drive-speed-scale, or time-base); near 1.00 mm [0.90, 1.10]."
    )
    unsure = {**value("clock", 4.1, 1.0), "low": 0.4, "high": 7.8}  # on open ground: 2.2 standard errors
    told = preferred_sentence({"known_to": [unsure, *items]})
    assert told.index("far") < told.index("clock") < told.index("near")


def test_nominal_values_with_a_relative_tolerance_are_told_in_percent() -> None:
    """Friction 3 tolerances off stood in no sentence, and beside it a wheel radius 0.6 off."""
    nominal = {
        "slip.lateral_friction": {"relative_change": 0.152, "sigma": 0.035, "tolerance": 0.05},
        "slip.longitudinal_friction": {"relative_change": -0.09, "sigma": 0.03, "tolerance": 0.05},  # 1.8 tolerances
        "slip.lateral_shape": {"relative_change": 0.05, "sigma": 0.03, "tolerance": 0.05},  # 0 is within its interval
        "magnetic_attraction.driven_wheel_mN": {"relative_change": 0.23, "sigma": 0.078, "tolerance": 0.1},
        "wheels.radius_mm": {"relative_change": 0.5, "sigma": 0.01, "tolerance": 0.005},  # told as a length
    }
    known = {"unit": "mm", "taken": 0.0025, "found": -0.0015, "low": -0.002, "high": -0.001, "name": "radius"}
    told = preferred_sentence({"nominal": nominal, "known_to": [{"quantity": "wheels.radius_mm", **known}]})
    assert told == (
        "Of the values with a tolerance, the data prefer: lateral friction 15 % [8, 22] (3.0 tolerances); "
        "attraction of a driven wheel 23 % [8, 38] (2.3 tolerances); longitudinal friction −9 % [−15, −3]; "
        "radius −0.0015 mm [−0.0020, −0.0010]."
    )


def test_nominal_values_that_predict_held_out_runs_worse_are_not_among_those_that_the_data_prefer() -> None:
    """ "No finding" was said of them, and in the next sentence that the data prefer them."""
    some = {"unit": "mm", "taken": 0.05, "found": 0.02, "low": 0.01, "high": 0.03}
    known = [
        {"quantity": "wheels.track_mm", "name": "track", **some},
        {"quantity": "green_x_mm", "name": "mark", **some},
    ]
    gap = {"noise_floor": 0.01, "predicted": {"before": {"held_out": 0.04}, "after": {"held_out": 0.06}}}
    worse = {"verdict": "none", "known_to": known, "gap": gap}
    assert preferred_sentence(worse) == "Of the values with a tolerance, the data prefer: mark 0.020 mm [0.010, 0.030]."
    assert "track" in preferred_sentence({**worse, "gap": {}})


def test_an_unknown_verdict_without_a_disagreement_is_a_whole_sentence() -> None:
    content: dict[str, Any] = {"verdict": "unknown", "effects": [], "where": []}
    assert verdict_sentence(content) == "The model lacks something that no known effect explains."
