"""Exchanged sides of robots on open ground, by the sense of their turns alone.

Slip, scrub and the lag of the drive take any share of a commanded turn and move its path as far as a mistake does, the
more so the larger the robot. They do not reverse a turn that lasts: yaw rate and commanded difference of the sides are
correlated, with free gain and delay, so that neither size nor law of slip matters. A single run may be pushed or start
in a turn: its sides are exchanged only if it turns the other way by the gain of nearly all others, all the time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.misread.alternatives import Alternative, correction_to, of_wheels
from evaluator.diagnosis.mistakes.motion import midpoint_and_heading
from evaluator.diagnosis.mistakes.recognised import MOST, Found
from evaluator.interchange.log_offset import correlations
from evaluator.wording import verb

# Correlation from which the commands explain half of the squares of the yaw rate; less may be a disturbance.
SHOWS = float(np.sqrt(0.5))
EXACTLY = 0.95  # of a single run: the commands explain nine tenths of the squares of its yaw rate
FEWEST_FRAMES = 12
FEWEST = 3  # runs that show a sense: of fewer, one or two may have been pushed
DELAYS_S = np.arange(0.0, 1.05, 0.1)  # lag of a large robot


@dataclass(frozen=True)
class Turn:
    """How a run turns: correlation with its command, and yaw rate over commanded difference, rad/s per rpm."""

    correlation: float
    gain: float


def turned_otherwise(data: Sequence[RunData]) -> list[Found]:
    """The runs of a session with exchanged sides: nearly all, or few that turn exactly as nearly all others would.

    If nearly all are, found are all runs with a commanded turn but those that turn as commanded.
    """
    turns = [turn_of(run) for run in data]
    shown, otherwise = sum(map(bool, turns)), sum(turn is not None and turn.correlation < 0 for turn in turns)
    if shown < FEWEST:
        return []
    if otherwise >= MOST * shown:
        odd = [
            (turn is None or turn.correlation < 0)
            and any(item.left_rpm != item.right_rpm for item in run.run_command.driven)
            for run, turn in zip(data, turns, strict=True)
        ]
    elif otherwise <= (1 - MOST) * shown:
        usual = float(np.median([turn.gain for turn in turns if turn is not None and turn.gain > 0]))
        odd = [turn is not None and turn.correlation < -EXACTLY and 0.5 < -turn.gain / usual < 2.0 for turn in turns]
    else:
        return []
    seen = (
        "turns as if left and right were exchanged, or moves as if seen in a mirror (of "
        f"{shown} runs or parts of runs whose turns follow their commands, {otherwise} "
        f"{verb(otherwise, 'turns', 'turn')} the other way)"
    )
    remedy = "exchange left and right in the commands; or mirror the recording, or the y and headings of its poses"
    return [
        Found(
            run.id, "sides-swapped", seen, remedy, ("mirrored",), correction_to(_exchanged(run), Alternative(None, run))
        )
        for run, is_odd in zip(data, odd, strict=True)
        if is_odd
    ]


def turn_of(run: RunData) -> Turn | None:
    """How a run turns; None if its command does not show in its yaw rate, or it drives backward instead."""
    time_s, middle_mm, heading_rad = midpoint_and_heading(run)
    if len(time_s) < FEWEST_FRAMES:
        return None
    command = run.run_command.command.at
    found, gains = correlations(time_s, np.column_stack([middle_mm, heading_rad]), command, DELAYS_S)
    best = int(np.abs(found[1]).argmax())
    if abs(found[1, best]) < SHOWS or found[0, best] < -SHOWS:  # driven the opposite way, which is another mistake
        return None
    return Turn(float(found[1, best]), float(gains[1, best]))


def _exchanged(run: RunData) -> Alternative:
    return of_wheels(run, "sides-swapped", "", 1.0, exchanged=True)
