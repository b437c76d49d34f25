"""A single run that disagrees with a robot that explains all others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from evaluator.diagnosis.candidates.coordinates import on_open_ground
from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.misread.alternatives import REMEDIES
from evaluator.diagnosis.mistakes.misread.hypotheses import reading_of
from evaluator.diagnosis.mistakes.misread.judgement import unsigned_speeds
from evaluator.diagnosis.mistakes.recognised import Correction, Found, Mistake
from simulator.robot import Robot

# Ratio of speeds of neighbouring runs. A run that is a quarter faster or slower has at least 64 % of the evidence for
# an effect that grows with speed, so that a strong effect in one run is visible in the other. The same holds for the
# ratio of the wheel speeds.
SPEED_FACTOR, SHARE_STEP = 1.25, 0.1
ONE_FACTOR = 0.03  # difference of the factors of both sides up to which they may be one: half of their second digit
REPEAT = "inspect the recording, or repeat the run"


def has_similar_runs(run: RunData, others: Sequence[RunData]) -> bool:
    """Whether other runs drive similarly; otherwise an effect may act in this run alone.

    Another run has the same wheel speeds, or both speeds and their ratio lie between or next to those of others: an
    effect that depends on speed or slip then acts in other runs, too.
    """
    if any(unsigned_speeds(other) == unsigned_speeds(run) for other in others):
        return True
    around = [_drive(pair) for other in others for pair in _pairs(other)]
    return bool(around) and all(_among(_drive(pair), around) for pair in _pairs(run))


def turns_like_others(run: RunData, others: Sequence[RunData]) -> bool:
    """Whether other runs drive similarly with the same side slower, or the run has no slower side.

    Left out, the only sharp right turn among left turns makes whatever is wrong with these an effect of one side.
    """
    return _slower_sides(run) == {0.0} or has_similar_runs(
        run, [other for other in others if _slower_sides(other) & _slower_sides(run)]
    )


def _slower_sides(run: RunData) -> set[float]:
    """Signs of the unsigned speeds of left minus right wheels; 0 if a run drives straight ahead."""
    return {float(np.sign(abs(left) - abs(right))) for left, right in _pairs(run)}


def _pairs(run: RunData) -> list[tuple[float, float]]:
    return [(stretch.left_rpm, stretch.right_rpm) for stretch in run.run_command.driven]


def _drive(pair: tuple[float, float]) -> tuple[float, float, float]:
    """Speed of the faster wheel and of the slower, rpm, and the slower over the faster, with its sign."""
    slower, faster = sorted(pair, key=abs)
    return abs(faster), abs(slower), slower / faster


def _among(drive: tuple[float, float, float], around: Sequence[tuple[float, float, float]]) -> bool:
    """Whether all three numbers of a run lie between or next to those of others."""
    lowest, highest = (tuple(pick(column) for column in zip(*around, strict=True)) for pick in (min, max))
    speeds = all(
        low / SPEED_FACTOR <= value <= high * SPEED_FACTOR
        for value, low, high in zip(drive[:2], lowest[:2], highest[:2], strict=True)
    )
    return speeds and lowest[2] - SHARE_STEP <= drive[2] <= highest[2] + SHARE_STEP


def outlying_run(
    run: RunData, others: Sequence[RunData], robot: Robot, gains: tuple[float, float] | None = None
) -> Mistake:
    """The mistake of the only run that disagrees; robot: with values fitted to the others.

    For a robot of a metre the kind is not determined, because one of two dozen other commands fits the influence of the
    ground by chance. gains: relative excess of its wheel speeds, if only these disagree.
    """
    alone = f"{run.id} disagrees with the robot that the other {len(others)} runs determine"
    on_ground = on_open_ground([robot], [run])
    reading = None if on_ground else reading_of(run, others, robot)
    of_speeds = None if run.log is not None or on_ground else gains
    if of_speeds is not None and (reading is None or not _has_speeds(reading, run, of_speeds)):
        return _of_other_speeds(run, alone, of_speeds)
    if reading is None:
        unread = "" if on_ground else "none of the usual mistakes explains it; "
        return Mistake((run.id,), "outlying", f"{alone}; {unread}{REPEAT}")
    seen, remedy, equivalent = reading.seen, reading.remedy, reading.equivalent
    faster = reading.correction.seconds_times if reading.correction and run.log is None else 1.0
    if faster != 1.0 and "wrong-command" not in equivalent:  # slip depends on ratios of speeds, so that either fits
        found = _rounded(run.command, (faster - 1, faster - 1))
        seen += f", or as if it were commanded about {found} rpm, not {run.left_rpm:g} / {run.right_rpm:g}"
        seen += _of_wheels(faster)
        remedy, equivalent = f"{remedy}; or {REMEDIES['wrong-command']}", (*equivalent, "wrong-command")
    corrections = {run.id: reading.correction} if reading.correction else {}
    sentence = f"{alone}: it {seen}; {remedy}"
    return Mistake((run.id,), reading.kind, sentence, equivalent_kinds=equivalent, corrections=corrections)


def _has_speeds(reading: Found, run: RunData, gains: tuple[float, float]) -> bool:
    """Whether a reading gives the wheels the speeds that they had, to the two digits to which these are stated."""
    changed = reading.correction or Correction()
    command = changed.command or tuple(changed.seconds_times * speed for speed in run.command)
    return _rounded(command, (0.0, 0.0)) == _rounded(run.command, gains)


def _rounded(command: tuple[float, ...], gains: tuple[float, float]) -> str:
    """A command of both sides, multiplied by gains, with two digits."""
    return " / ".join(f"{float(f'{speed * (1 + gain):.2g}'):g}" for speed, gain in zip(command, gains, strict=True))


def _of_wheels(times: float) -> str:
    """The words for wheels that are larger or smaller by the factor by which a run is faster."""
    return f", or as if its wheels were {times:.2g} times as large (another robot?)"


def _of_other_speeds(run: RunData, alone: str, gains: tuple[float, float]) -> Mistake:
    """The mistake of a run whose wheels turn faster or slower than commanded: another command, if it reads as one."""
    found = _rounded(run.command, gains)
    if found != _rounded(run.command, (0.0, 0.0)):
        seen = f"it moves as if it were commanded about {found} rpm, not {run.left_rpm:g} / {run.right_rpm:g}"
        if abs(gains[0] - gains[1]) < ONE_FACTOR:
            seen += _of_wheels(1 + sum(gains) / 2)
        return Mistake((run.id,), "wrong-command", f"{alone}: {seen}; {REMEDIES['wrong-command']}")
    left, right = (f"{100 * abs(gain):.1g} % {'faster' if gain > 0 else 'slower'}" for gain in gains)
    seen = f"its left wheels turn {left} than commanded, its right wheels {right}"
    return Mistake((run.id,), "outlying", f"{alone}: {seen}; {REPEAT}")
