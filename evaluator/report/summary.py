"""The summary at the top of the report: radii, agreement with the simulation, diagnosis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from evaluator.report.diagnosis.gap import gap_sentence
from evaluator.report.diagnosis.words import (
    as_sentence,
    equivalents_sentence,
    moved_marks_sentence,
    reason_sentence,
    verdict_sentence,
)
from evaluator.report.numbers import number, significant
from evaluator.report.runs import RunView, column
from evaluator.turning.motion.curvature import Z_975
from evaluator.turning.pooling import pooled
from evaluator.workflow import Analysis
from evaluator.workflow.runs.job import SPACING_PERCENT

SMALL_BESIDE = 0.5  # added in quadrature, half of an interval makes it 12 % wider
MOST_FIRST = 8  # mistakes before the numbers: a screen of them; all of them stand with the quality of the measurement


@dataclass(frozen=True)
class Number:
    """A headline number with its range in words."""

    name: str
    value: str
    range: str


def summary(
    runs: Sequence[RunView], faults: dict[str, str], diagnosis: dict[str, Any] | None, directions: pd.DataFrame
) -> list[str]:
    """Sentences, most important first."""
    turning = [run for run in runs if run.turns]
    sentences = [_tightest(turning)] if turning else ["No run turns, so there is no turning radius."]
    explained = diagnosis is not None and diagnosis.get("verdict") == "none"
    sentences += [_directions(directions), _agreement(turning, explained=explained), _speed(runs)]
    doubts = [_only_mark(runs), _scale(runs)]
    if diagnosis is not None:
        doubts += _mistakes_of_diagnosis(diagnosis, {run.run for run in runs})
        doubts.append(diagnosis_sentence(diagnosis))
    sentences = [*doubts, *sentences]
    if faults:
        named = ", ".join(list(faults)[:5]) + (", …" if len(faults) > 5 else "")
        total = len(faults) + len({run.run for run in runs})
        sentences.append(f"{len(faults)} of {total} runs gave no result ({named}); reasons below.")
    return [sentence for sentence in sentences if sentence]


def mistakes_first(analysis: Analysis) -> list[str]:
    """Mistakes of the experiment, for the top of the report, those of all runs first; of many, their number."""
    mistakes = sorted(analysis.mistakes, key=lambda item: not item.everywhere)
    sentences = [as_sentence(item.sentence) for item in mistakes]
    if len(sentences) > MOST_FIRST + 1:
        sentences[MOST_FIRST:] = [f"{len(sentences) - MOST_FIRST} more mistakes are listed in the section on quality."]
    if analysis.excluded_runs:
        runs = ", ".join(run.id for run in analysis.experiment.run if run.id in analysis.excluded_runs)
        sentences.append(f"Left out of all results below until this is corrected: {runs}.")
    return sentences


def _mistakes_of_diagnosis(diagnosis: dict[str, Any], shown: set[str]) -> list[str]:
    """Mistakes that only the diagnosis recognises: their runs are not left out of the other results (shown: by id)."""
    found = diagnosis.get("mistakes") or []
    return [as_sentence(item["sentence"]) for item in found if shown.intersection(item["runs"])]


def headline(runs: Sequence[RunView]) -> list[Number]:
    """Headline numbers of the report."""
    turning = [run for run in runs if run.turns]
    numbers = []
    if turning:
        best = tightest(turning)
        places = _by_places(best)
        further = f"; positions of the marks {places}" if places else ""
        numbers.append(Number("tightest turn", _radius(best), f"95 %: {_interval(best)}, run {best.id}{further}"))
        off = np.abs(column(turning, "radius_difference_percent", "comparison"))
        if np.isfinite(off).any():
            worst = turning[int(np.nanargmax(off))]
            numbers.append(
                Number(
                    "simulated radius",
                    f"{_percent(np.nanmedian(off))} off",
                    f"median; worst {_percent(np.nanmax(off))}, run {worst.id}",
                )
            )
    share = 100 * column(runs, "share_used")
    if np.isfinite(share).any():
        numbers.append(
            Number("frames used", f"{np.nanmedian(share):.1f} %", f"median; lowest {np.nanmin(share):.1f} %")
        )
    ratio = 100 * (column(runs, "mark_spacing_ratio") - 1)
    if np.isfinite(ratio).any():
        numbers.append(
            Number(
                "scale check",
                f"{number(np.nanmedian(ratio), 2, sign=True)} %",
                "distance of the marks against robot.toml",
            )
        )
    return numbers


def diagnosis_sentence(diagnosis: dict[str, Any]) -> str:
    """The result of `turnscope diagnose` in two or three sentences; of what is not explained, with the reason."""
    open_end = diagnosis.get("verdict") in ("unknown", "insufficient")
    reason = reason_sentence(diagnosis) if open_end else ""
    effects = diagnosis.get("effects") or []
    gap = gap_sentence(diagnosis) if effects else ""
    alike = [equivalents_sentence(effect) for effect in effects] if diagnosis.get("verdict") == "effect" else []
    said = verdict_sentence(diagnosis), *alike, reason, moved_marks_sentence(diagnosis), gap
    return " ".join(filter(None, said))


def _scale(runs: Sequence[RunView]) -> str:
    """A warning if the distance of the marks is wrong, because all lengths are then doubtful."""
    off = 100 * (column(runs, "mark_spacing_ratio") - 1)
    if not np.isfinite(off).any() or abs(np.nanmedian(off)) < SPACING_PERCENT:
        return ""
    way = "farther apart" if np.nanmedian(off) > 0 else "nearer"
    return (
        f"The marks are {abs(np.nanmedian(off)):.0f} % {way} than robot.toml says: either their positions there are "
        "off, or all lengths below by as much (see Quality of the measurement)."
    )


def _only_mark(runs: Sequence[RunView]) -> str:
    """What a robot with a single mark does not show."""
    named = sorted({run.only_mark[0] for run in runs if run.only_mark})
    if not named:
        return ""
    return (
        f"A single mark ({', '.join(named)}) shows no heading: radii, speeds and paths below are those of this mark, "
        "not of the robot's centre, and the simulated path is laid on the measured one."
    )


def tightest(turning: Sequence[RunView]) -> RunView:
    """The run of which it is most certain that it turns tightly: the one with the least upper bound of its radius.

    The radius of a turn by few degrees may lie anywhere below its bound; that of many such phases of a command log is
    the least by chance. Nothing needs to be said of a least angle: it is in the bound.
    """

    def bound_mm(run: RunView) -> float:
        high_mm = run.value("radius_high_mm")
        return high_mm if np.isfinite(high_mm) else float("inf")

    return min(turning, key=lambda run: (bound_mm(run), run.value("radius_mm")))


def _tightest(turning: Sequence[RunView]) -> str:
    best = tightest(turning)
    widest = max(turning, key=lambda run: run.value("radius_mm"))
    text = f"The tightest turn has a radius of {_radius(best)} (95 %: {_interval(best)}; run {best.id}, {best.command})"
    if widest is not best:
        radius = f"{significant(widest.value('radius_mm') / widest.unit.mm)} {widest.unit.name}"
        text += f"; the widest {radius} (run {widest.id}, {widest.command})"
    return " ".join(filter(None, [f"{text}.", places_sentence([best])]))


def places_sentence(runs: Sequence[RunView]) -> str:
    """What the places of the marks add to the interval of the tightest turn, 95 %, if that is not little."""
    turning = [run for run in runs if run.turns]
    added = _by_places(tightest(turning)) if turning else ""
    if not added:
        return ""
    return (
        "The intervals take the marks to be where robot.toml says; a usual error of their positions adds "
        f"{added} (95 %, run {tightest(turning).id}): state yours in robot.toml, [known_to] mark_position_mm."
    )


def _by_places(run: RunView) -> str:
    """What the places of the marks add to a radius, 95 %, if it is not small beside half of its interval."""
    added = Z_975 * run.by_places_mm
    if added < SMALL_BESIDE * (run.value("radius_high_mm") - run.value("radius_low_mm")) / 2:
        return ""
    return f"±{significant(added / run.unit.mm, 1)} {run.unit.name}"


def _directions(directions: pd.DataFrame) -> str:
    """Backward against forward at the same wheel speeds, over all commands driven both ways."""
    if directions.empty:
        return ""
    known = directions[np.isfinite(directions["radius_change_low_percent"])]
    if known.empty:
        return ""
    low, high = known["radius_change_low_percent"], known["radius_change_high_percent"]
    change = pooled(known["radius_change_percent"].to_numpy(float), ((high - low) / (2 * Z_975)).to_numpy(float))
    over = f"{len(known)} pairs of commands" if len(known) > 1 else "one pair of commands"
    least, most = (significant(bound, 2, sign=True) for bound in (change.low, change.high))
    bounds = f"95 %: {least} to {most} %, {over}"
    # several pairs scatter, and so do several runs; of a single one the measurement is all that is known
    once = len(known) == 1 and known[["forward_runs", "backward_runs"]].to_numpy().min() == 1
    if once:
        bounds = (
            f"95 % of the measurement alone: {least} to {most} %; a single run does not show what varies between runs"
        )
    if change.low <= 0 <= change.high:
        return f"Forward and backward turns do not differ significantly ({bounds})."
    size = f"{_percent(abs(change.mean))} {'tighter' if change.mean < 0 else 'wider'}"
    if once:
        return f"The backward turn was {size} than the forward turn at the same wheel speeds ({bounds})."
    return f"Backward turns are {size} than forward turns at the same wheel speeds ({bounds})."


def _agreement(turning: Sequence[RunView], *, explained: bool) -> str:
    """Simulated radii against measured intervals; explained: whether a diagnosis found nothing missing."""
    if not turning:
        return ""
    off = column(turning, "radius_difference_percent", "comparison")
    simulated = column(turning, "simulated_radius_mm", "comparison")
    low, high = column(turning, "radius_low_mm"), column(turning, "radius_high_mm")
    inside = int(np.sum((simulated >= low) & (simulated <= high)))
    radius, places = column(turning, "radius_mm"), Z_975 * np.array([run.by_places_mm for run in turning])
    low, high = radius - np.hypot(radius - low, places), radius + np.hypot(high - radius, places)
    allowed = int(np.sum((simulated >= low) & (simulated <= high)))
    if not np.isfinite(off).any():
        return "The simulated robot drives straight in the measured turns."
    worst = int(np.nanargmax(np.abs(off)))
    text = f"The simulated radius lies inside the measured 95 % interval in {inside} of {len(turning)} turns"
    if allowed > inside:
        text += f", in {allowed} with the tolerance of the positions of the marks"
    way = "wider" if off[worst] > 0 else "tighter"
    text += f"; at worst it is {_percent(abs(off[worst]))} {way} than measured (run {turning[worst].id})"
    if explained and inside < len(turning):
        text += ". This is with the values of robot.toml; the diagnosis adjusts them within their tolerances"
    return f"{text}."


def _speed(runs: Sequence[RunView]) -> str:
    straight = [run for run in runs if run.straight and run.left_rpm]
    if not straight:
        return ""
    measured, simulated = column(straight, "speed_mm_s"), column(straight, "simulated_speed_mm_s", "comparison")
    off = 100 * (measured / simulated - 1)
    if not np.isfinite(off).any():
        return ""
    worst = int(np.nanargmax(np.abs(off)))
    furthest = f"largest deviation: run {straight[worst].id}"
    return f"Speeds of straight runs agree with the simulation within {_percent(abs(off[worst]))} ({furthest})."


def _radius(run: RunView) -> str:
    """A radius with the digits that its interval supports."""
    return f"{run.value('radius_mm') / run.unit.mm:.{_digits(run)}f} {run.unit.name}"


def _interval(run: RunView) -> str:
    low, high = (run.value(f"radius_{end}_mm") / run.unit.mm for end in ("low", "high"))
    digits = _digits(run)
    if not np.isfinite(high):
        return f"{low:.{digits}f} {run.unit.name} to straight"
    return f"{low:.{digits}f} to {high:.{digits}f} {run.unit.name}"


def _digits(run: RunView) -> int:
    """Decimals that show the width of the interval by at least one digit."""
    width = (run.value("radius_high_mm") - run.value("radius_low_mm")) / run.unit.mm
    return int(np.clip(np.ceil(-np.log10(width / 2)), 1, 5)) if 0 < width < np.inf else 2


def _percent(value: float) -> str:
    return f"{significant(value, 2)} %"
