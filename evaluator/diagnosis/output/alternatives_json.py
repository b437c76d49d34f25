"""Alternatives to the verdict in diagnosis.json: other sets of effects, and runs that would distinguish them."""

from __future__ import annotations

import math
from collections import Counter

from evaluator.diagnosis.assessment.knowledge import strained
from evaluator.diagnosis.assessment.model_comparison import Set
from evaluator.diagnosis.assessment.verdict import KEEP, carries_over
from evaluator.diagnosis.design.next_runs import MOST_RUNS
from evaluator.diagnosis.output.content import NextExperimentContent, RivalContent
from evaluator.diagnosis.output.effects_json import rounded
from evaluator.diagnosis.result import Diagnosis
from evaluator.wording import power_of_ten

RIVALS_LISTED = 8  # the most probable first


def rivals(diagnosis: Diagnosis) -> list[RivalContent]:
    """The most probable other sets of effects, with the reasons against them."""
    table = diagnosis.standing
    assert table is not None
    best = table.of(diagnosis.chosen)
    found: list[RivalContent] = []
    for ids, score, probability in zip(table.sets, table.scores, table.probability, strict=True):
        if ids != diagnosis.chosen and len(found) < RIVALS_LISTED:
            found.append(
                {
                    "effects": sorted(ids),
                    "probability": round(float(probability), 4),
                    "log_odds": rounded(float(score) - best),
                    "reason": _reason(diagnosis, ids, float(score) - best),
                    "strains": _strains(diagnosis, ids),
                    "carries_over": _carries_over(diagnosis, ids),
                }
            )
    return found


def _carries_over(diagnosis: Diagnosis, ids: Set) -> bool | None:
    """Whether each effect of a set also predicts left-out commands; None except on open ground, where it must."""
    search = diagnosis.search
    assert search is not None
    return carries_over(search, ids) if search.problem.open_ground else None


def _strains(diagnosis: Diagnosis, ids: Set) -> list[str]:
    """Quantities that a set moves beyond their tolerances."""
    search = diagnosis.search
    assert search is not None
    return sorted(strained(search.fits[ids], search.null, search.tolerance))


def _reason(diagnosis: Diagnosis, ids: Set, odds: float) -> str:
    """Why a set was not chosen; odds: logarithm of its odds relative to the chosen one."""
    chosen = diagnosis.chosen
    if not ids:
        return f"without any effect the runs are {_times(odds)} less probable"
    if ids < chosen:
        return f"leaving out {', '.join(sorted(chosen - ids))} makes the runs {_times(odds)} less probable"
    if odds > 0 and _carries_over(diagnosis, ids) is False:
        return "an effect in it predicts commands left out no better than chance"
    if ids > chosen and odds < KEEP[0]:
        return f"adding {', '.join(sorted(ids - chosen))} is not significant"
    return f"makes the runs {_times(odds)} less probable" if odds < 0 else _refused(diagnosis, ids)


def _refused(diagnosis: Diagnosis, ids: Set) -> str:
    """Why a set that is more probable than the chosen one was not chosen."""
    assert diagnosis.search is not None
    if at_bounds := diagnosis.search.fits[ids].at_bounds:
        return f"{' and '.join(sorted(at_bounds))} would be larger than is plausible: at a bound of the size"
    return "not every effect in it is worth odds of 3000 to 1 beside the others"


def _times(odds: float) -> str:
    """A factor in words, from the logarithm of its inverse."""
    if -odds > math.log(1e4):
        return f"{power_of_ten(-odds / math.log(10))} times"
    return f"{math.exp(-odds):.{1 if -odds < math.log(10) else 0}f} times"


def next_experiment(diagnosis: Diagnosis) -> NextExperimentContent | None:
    """The runs that would distinguish the alternatives; None if none are needed."""
    following = diagnosis.next_runs
    if following is None:
        return None
    times = Counter(following.runs)
    return {
        "runs": [
            {
                "left_rpm": run.left_rpm,
                "right_rpm": run.right_rpm,
                "x_mm": run.x_mm,
                "y_mm": run.y_mm,
                "heading_deg": run.heading_deg,
                "duration_s": run.duration_s,
                "times": count,
            }
            for run, count in times.items()
        ],
        "separation_sigmas": {name: rounded(value) for name, value in following.sigmas.items()},
        "most_runs": MOST_RUNS,
        "inseparable_sigmas": {name: rounded(value) for name, value in following.inseparable.items()},
    }
