"""The gap in words: before and after, on fitted and held-out runs, as predicted, and what varies from run to run."""

from __future__ import annotations

from typing import Any

import pytest

from evaluator.report.diagnosis.gap import gap_sentence, predicted_sentence, scatter_sentence

GAP = {"before": {"fit": 0.41, "held_out": 0.44}, "after": {"fit": 0.006, "held_out": 0.007}, "noise_floor": 0.005}
EFFECT = {"id": "plate-tilt", "name": "the plate is not level", "probability": 0.998, "parameters": {}}
RMS = "the RMS distance between simulated and measured marks"
FLOOR = "the noise floor is 5 µm."
ON_GROUND = "the noise floor, with unmodelled effects of the ground, is 5 µm."
BOTH = "from 410 µm to 6 µm on fitted runs and from 440 µm to 7 µm on held-out runs"
FOUND = {"verdict": "effect", "effects": [EFFECT], "gap": GAP}
FEW = {**GAP, "before": {"fit": 0.41}}
SAME = {**GAP, "before": GAP["after"]}
HARDLY = {**GAP, "before": {"fit": 0.0060001, "held_out": 0.0070001}}
LOST = {**GAP, "after": {"fit": None, "held_out": 0.1}}


DIVERGED = "where friction that varies as usual leads to another path"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (FOUND, f"With the effects found, {RMS} changes {BOTH}; {FLOOR}"),
        (
            {"verdict": "none", "effects": [], "gap": FEW},
            f"With nominal values adjusted within their tolerances, {RMS} changes {BOTH[:34]}; {FLOOR}",
        ),
        (
            {"verdict": "none", "effects": [], "gap": SAME},
            f"T{RMS[1:]} is 6 µm on fitted runs and 7 µm on held-out runs; {FLOOR}",
        ),
        (
            {"verdict": "none", "effects": [], "gap": HARDLY},
            f"T{RMS[1:]} is 6 µm on fitted runs and 7 µm on held-out runs; {FLOOR}",
        ),
        (
            {"verdict": "unknown", "effects": [], "gap": LOST},
            f"T{RMS[1:]} is 440 µm on held-out runs; {FLOOR}",
        ),
        (
            {**FOUND, "noise": {"run_to_run": None}},
            f"With the effects found, {RMS} changes {BOTH}; {ON_GROUND}",
        ),
        (
            {**FOUND, "gap": {**GAP, "elsewhere": ["r3", "r5"]}},
            f"With the effects found, {RMS} changes {BOTH}; {FLOOR[:-1]}; without r3, r5, which neither model follows.",
        ),
        (
            {**FOUND, "gap": {**GAP, "elsewhere": [], "diverging": ["r8"]}},
            f"With the effects found, {RMS} changes {BOTH}; {FLOOR[:-1]}; without r8, {DIVERGED}.",
        ),
        ({"verdict": "none", "gap": {}}, ""),
        ({"verdict": "none"}, ""),
    ],
)
def test_the_gap_is_said_before_and_after_where_a_model_was_found(content: dict[str, Any], said: str) -> None:
    assert gap_sentence(content) == said


def predicted(verdict: str = "effect", **gap: Any) -> str:
    effects = [EFFECT] if verdict == "effect" else []
    return predicted_sentence({"verdict": verdict, "effects": effects, "gap": gap})


def test_what_is_predicted_from_start_poses_is_said_with_the_runs_that_are_not() -> None:
    how = "Predicted from the start poses alone, with nothing fitted to single runs, the distance "
    both = {"before": {"fit": 0.1, "held_out": 0.2}, "after": {"fit": 0.01, "held_out": 0.02}}
    found = predicted(predicted=both)
    assert found.startswith(
        f"{how}changes from 100 µm to 10 µm on fitted runs and from 200 µm to 20 µm on held-out runs. "
    )
    assert found.endswith("are those of the fitted runs.")
    fit = {side: {"fit": values["fit"]} for side, values in both.items()}
    assert predicted("unknown", predicted=fit).startswith(f"{how}is 100 µm on fitted runs. ")
    same = {side: {"fit": 0.1} for side in both}
    assert predicted(predicted=same).startswith(f"{how}is 100 µm on fitted runs. ")
    lost = predicted(predicted=fit, not_predicted={"r1": "it tips", "r2": "so"})
    assert lost.endswith(". Not predicted: r1 (it tips); r2 (so).")
    assert predicted(not_predicted={"r1": "it tips"}) == (
        "No run can be predicted from its start pose alone. Not predicted: r1 (it tips)."
    )
    assert predicted() == ""


@pytest.mark.parametrize(
    ("verdict", "after", "said"), [("none", 0.211, True), ("none", 0.209, False), ("effect", 0.211, False)]
)
def test_adjusted_values_that_predict_held_out_runs_worse_are_no_finding(
    verdict: str, after: float, *, said: bool
) -> None:
    """By more than the noise floor of 10 µm."""
    parts = {"before": {"fit": 0.2, "held_out": 0.2}, "after": {"fit": 0.1, "held_out": after}}
    found = predicted(verdict, predicted=parts, noise_floor=0.01)
    assert found.endswith("are no finding: held-out runs are predicted worse with them.") == said


def test_what_varies_from_run_to_run_is_said_where_a_prediction_misses_it() -> None:
    """ "Nothing is missing" stood beside 65 µm predicted at a noise floor of 6 µm, and no word of the cause."""
    gap = {"noise_floor": 0.006, "predicted": {"after": {"fit": 0.0121}}}
    content: dict[str, Any] = {
        "verdict": "none", "gap": gap, "noise": {"run_to_run": {"friction": 0.106, "wheel_speed": 0.0064}}
    }  # fmt: skip
    assert scatter_sentence(content) == (
        "A prediction knows neither the errors of the start pose nor what varies from run to run: friction by 11 %, "
        "wheel speeds by 0.64 % (1 sigma)."
    )
    known = {"friction": 0.106, "friction_95": [0.071, 0.16], "wheel_speed": 0.0064, "wheel_speed_95": [0.00008, 0.01]}
    assert (
        "friction by 11 % [95 %: 7.1 to 16 %], wheel speeds by 0.64 % [95 %: < 0.01 to 1.0 %] (1 sigma)"
    ) in scatter_sentence({**content, "noise": {"run_to_run": known}})
    assert scatter_sentence({**content, "verdict": "unknown"}) == ""
    assert scatter_sentence({**content, "noise": {"run_to_run": None}}) == ""
    rounding = scatter_sentence({**content, "noise": {"run_to_run": {**known, "commands_rounded_to_rpm": 5.0}}})
    assert rounding.endswith(
        "Commands rounded to 5 rpm vary so much, and all commands of the file are: give what was sent."
    )
    assert scatter_sentence({**content, "gap": {**gap, "predicted": {"after": {"fit": 0.0119}}}}) == ""
    assert scatter_sentence({**content, "gap": {"noise_floor": 0.006}}) == ""
