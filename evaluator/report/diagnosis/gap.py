"""Sentences on the distance between simulation and measurement: the gap, its prediction, and runs far from both."""

from __future__ import annotations

from typing import Any

from evaluator.report.diagnosis.values import length, scatter_text
from evaluator.report.diagnosis.words import closes

Json = dict[str, Any]

NOISE_FLOOR, FLOOR_OF_GROUND = "the noise floor is", "the noise floor, with unmodelled effects of the ground, is"
MISSED = 2.0  # noise floors of predicted distance from which a prediction misses more than noise
FEW = 1 / 3  # share of runs beyond the noise up to which these, not the model, may be at fault


def gap_sentence(content: Json) -> str:
    """Gap before and after, on fitted and held-out runs, beside the noise floor; empty without a gap."""
    gap = content.get("gap") or {}
    if not gap.get("before"):
        return ""
    shown = [
        [length(side[part]) for part in ("fit", "held_out") if side.get(part)] for side in (gap["before"], gap["after"])
    ]
    same = not content.get("effects") and shown[0] == shown[1]
    again = closes(content) and not same

    def change(part: str, where: str) -> str:
        before, after = gap["before"].get(part), gap["after"].get(part)
        if before is None or after is None:
            return ""
        return f"{f'from {length(before)} to {length(after)}' if again else length(before)} on {where}"

    parts = " and ".join(filter(None, (change("fit", "fitted runs"), change("held_out", "held-out runs"))))
    # without an estimate of run-to-run scatter, as on open ground, the noise is the residual of the best model
    has_scatter = (content.get("noise") or {}).get("run_to_run", True)
    noise = f"{NOISE_FLOOR if has_scatter else FLOOR_OF_GROUND} {length(gap['noise_floor'])}"
    if lost := gap.get("elsewhere"):
        noise = f"{noise}; without {', '.join(lost)}, which neither model follows"
    if free := gap.get("diverging"):
        noise = f"{noise}; without {', '.join(free)}, where friction that varies as usual leads to another path"
    if not again:
        return f"The RMS distance between simulated and measured marks is {parts}; {noise}."
    how = after_words(content).capitalize()
    return f"{how}, the RMS distance between simulated and measured marks changes {parts}; {noise}."


def after_words(content: Json) -> str:
    """What the model has after the diagnosis; empty if no model explains the runs."""
    effects = content.get("effects") or []
    if not closes(content):
        return ""
    if not effects:
        return "with nominal values adjusted within their tolerances"
    named = any(effect.get("id") != "free-form" for effect in effects)
    return f"with {'the effects found' if named else 'the free-form explanation'}"


def held_out_words(content: Json) -> str:
    """In what held-out runs had no part, and in what they had one."""
    if not content.get("effects"):
        return "values were adjusted without them, but the verdict is that of all runs"
    return "the sizes of the effects were fitted without them, but the effects themselves were chosen with all runs"


def predicted_sentence(content: Json) -> str:
    """Gap of a simulation from the start pose alone, before and after; empty if unknown."""
    gap = content.get("gap") or {}
    predicted, cannot = gap.get("predicted") or {}, gap.get("not_predicted") or {}
    without = f" Not predicted: {'; '.join(f'{run} ({reason})' for run, reason in cannot.items())}." if cannot else ""

    def change(part: str, where: str) -> str:
        before, after = (predicted.get(side, {}).get(part) for side in ("before", "after"))
        if before is None or after is None:
            return ""
        if not closes(content) or before == after:
            return f"{length(before)} on {where}"
        return f"from {length(before)} to {length(after)} on {where}"

    parts = [text for text in (change("fit", "fitted runs"), change("held_out", "held-out runs")) if text]
    if not parts:
        return without and f"No run can be predicted from its start pose alone.{without}"
    common = (
        "Before and after, values common to all runs (start of motion, clock, scale, level, mark offsets) are those of "
        "the fitted runs."
    )
    changes = "changes" if parts[0].startswith("from") else "is"
    how = "Predicted from the start poses alone, with nothing fitted to single runs"
    worse = (
        " The nominal values of the robot that were adjusted within their tolerances are no finding: held-out runs are "
        "predicted worse with them."
    )
    doubt = worse if predicts_worse(content) else ""
    return f"{how}, the distance {changes} {' and '.join(parts)}. {common}{doubt}{without}"


def predicts_worse(content: Json) -> bool:
    """Whether nothing is missing, but adjusted values predict held-out runs worse, by more than noise."""
    gap = content.get("gap") or {}
    before, after = ((gap.get("predicted") or {}).get(side, {}).get("held_out") for side in ("before", "after"))
    if content.get("verdict") != "none" or before is None or after is None:
        return False
    return bool(after > before + gap.get("noise_floor", 0.0))


def scatter_sentence(content: Json) -> str:
    """What a prediction from the start pose cannot know, where it misses more than noise; empty elsewhere."""
    gap, scatter = content.get("gap") or {}, (content.get("noise") or {}).get("run_to_run")
    left = ((gap.get("predicted") or {}).get("after") or {}).get("fit")
    if content.get("verdict") not in ("none", "effect") or not scatter or left is None:
        return ""
    if left <= MISSED * gap["noise_floor"]:
        return ""
    friction, speed = (scatter_text(scatter, key) for key in ("friction", "wheel_speed"))
    step = scatter.get("commands_rounded_to_rpm")
    rounding = (
        f" Commands rounded to {step:g} rpm vary so much, and all commands of the file are: give what was sent."
        if step
        else ""
    )
    return (
        "A prediction knows neither the errors of the start pose nor what varies from run to run: friction by "
        f"{friction}, wheel speeds by {speed} (1 sigma).{rounding}"
    )


def not_followed_sentence(content: Json) -> str:
    """Runs that the model does not follow though it follows most; empty if it follows all, or few."""
    lost = content.get("runs_not_followed") or []
    if not lost:
        return ""
    if closes(content):
        return f"The chosen model does not follow {', '.join(lost)}. Inspect these recordings first."
    runs = (content.get("gap") or {}).get("by_run") or {}
    if len(lost) > FEW * len(runs):
        return ""
    return f"The nearest model follows all runs but {', '.join(lost)}. Inspect these recordings first."
