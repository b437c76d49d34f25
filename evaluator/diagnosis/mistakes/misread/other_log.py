"""Recordings of poses that move as the command log of another one says, or by their own with a sign or side exchanged.

Whole recordings are compared with whole logs without a model: a part of one has few commands, and the ground displaces
it from any model as far as a mistake does. Speed and yaw rate must both follow, so that a push, a wire or a wheel that
slips is no mistake.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.misread.alternatives import Alternative, correction_to, of_wheels
from evaluator.diagnosis.mistakes.misread.turn_sense import DELAYS_S, EXACTLY, FEWEST_FRAMES, SHOWS
from evaluator.diagnosis.mistakes.motion import midpoint_and_heading
from evaluator.diagnosis.mistakes.recognised import Found
from evaluator.interchange.log_offset import correlations

CHANGES = 0.5  # of the largest speed: a motion about as steady as its command follows any other one
MOST_COMPARED = 2000  # recordings that do not follow their logs times all: some seconds


def misassigned(data: Sequence[RunData]) -> list[Found]:
    """The recordings whose log is another one's, and the few whose log has both sides reversed or exchanged.

    data: whole recordings; those without a log, or whose log does not change its turn or its speed, say nothing. Where
    not most follow their logs, signs and sides are left to what all runs say.
    """
    told = [run for run in data if run.log is not None and len(run.time_s) >= FEWEST_FRAMES and _tells(run)]
    own = [_followed(run, run) for run in told]
    odd = [(run, found) for run, found in zip(told, own, strict=True) if min(found) < SHOWS]
    if len(odd) * len(told) > MOST_COMPARED:
        return []
    most_follow = 2 * len(odd) < len(told)
    found = ((most_follow and _sense(run, followed)) or _of_another(run, told) for run, followed in odd)
    return [item for item in found if item]


def _tells(run: RunData) -> bool:
    """Whether the log of a run changes its turn and its speed by half of the largest or more."""
    command = run.run_command.command
    both = command.right_rpm - command.left_rpm, command.right_rpm + command.left_rpm
    return all(np.ptp(part) >= CHANGES * np.abs(part).max() > 0 for part in both)


def _followed(run: RunData, other: RunData) -> tuple[float, float]:
    """Correlations of speed and of yaw rate of a run with the log of another, at the delay where both are largest."""
    time_s, middle_mm, heading_rad = midpoint_and_heading(run)
    pose = np.column_stack([middle_mm, heading_rad])
    ahead, turn = correlations(time_s, pose, other.run_command.command.at, DELAYS_S)[0]
    best = int(np.argmax(np.abs(ahead) + np.abs(turn)))
    return float(ahead[best]), float(turn[best])


def _sense(run: RunData, followed: tuple[float, float]) -> Found | None:
    """The finding that a run follows its own log with a sign of all speeds, or with its sides, exchanged."""
    ahead, turn = followed
    if turn > -EXACTLY or abs(ahead) < EXACTLY:
        return None
    stated = Alternative(None, run)
    if ahead > 0:
        seen = "turns as if left and right were exchanged in its command log, all the time"
        way = of_wheels(run, "sides-swapped", "", 1.0, exchanged=True)
        remedy = "exchange left and right in its command log"
        return Found(run.id, "sides-swapped", seen, remedy, correction=correction_to(way, stated))
    seen = "drives the opposite way to its command log, all the time"
    way = of_wheels(run, "reversed", "", -1.0)
    return Found(run.id, "reversed", seen, "change the signs in its command log", correction=correction_to(way, stated))


def _of_another(run: RunData, told: Sequence[RunData]) -> Found | None:
    """The finding that a run follows the log of another one."""
    fits = [(min(_followed(run, other)), other.id) for other in told if other is not run]
    best, other = max(fits, default=(0.0, ""))
    if best < EXACTLY:
        return None
    seen = f"moves as the command log of {other} says, and not as its own"
    return Found(run.id, "wrong-command", seen, "give it the log that belongs to it (commands)")
