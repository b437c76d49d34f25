"""Exchanged sides of robots on open ground, by the sense of their turns alone.

Slip, scrub and the lag of the drive take any share of a commanded turn and move its path as far as a mistake does, the
more so the larger the robot. They do not reverse a turn that lasts: yaw rate and commanded difference of the sides are
correlated, with free gain and delay, so that neither size nor law of slip matters. A single run may be pushed or start
in a turn; the sides are exchanged where nearly all runs turn the other way.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.misread.alternatives import Alternative, correction_to
from evaluator.diagnosis.mistakes.misread.command_unit import driven
from evaluator.diagnosis.mistakes.motion import midpoint_and_heading
from evaluator.diagnosis.mistakes.recognised import MOST, Found
from evaluator.interchange.log_offset import correlations

# Correlation from which the commands explain half of the squares of the yaw rate; less may be a disturbance.
SHOWS = float(np.sqrt(0.5))
FEWEST_FRAMES = 12
FEWEST = 3  # runs that show a sense: of fewer, one or two may have been pushed
DELAYS_S = np.arange(0.0, 1.05, 0.1)  # lag of a large robot


def turned_otherwise(data: Sequence[RunData]) -> list[Found]:
    """The runs of a session with exchanged sides; none if less than nearly all that show it turn the other way.

    Found are all runs with a commanded turn but those that turn as commanded.
    """
    senses = [sense_of_turn(run) for run in data]
    shown, otherwise = sum(bool(sense) for sense in senses), sum(sense < 0 for sense in senses)
    if shown < FEWEST or otherwise < MOST * shown:
        return []
    seen = (
        "turns as if left and right were exchanged, or moves as if seen in a mirror (of "
        f"{shown} runs or parts of runs whose turns follow their commands, {otherwise} turn the other way)"
    )
    remedy = "exchange left and right in the commands; or mirror the recording, or the y and headings of its poses"
    return [
        Found(
            run.id, "sides-swapped", seen, remedy, ("mirrored",), correction_to(_exchanged(run), Alternative(None, run))
        )
        for run, sense in zip(data, senses, strict=True)
        if sense <= 0 and any(item.left_rpm != item.right_rpm for item in run.run_command.driven)
    ]


def sense_of_turn(run: RunData) -> int:
    """1 if a run turns as its command says, -1 if the other way, 0 if neither shows or it drives backward instead."""
    time_s, middle_mm, heading_rad = midpoint_and_heading(run)
    if len(time_s) < FEWEST_FRAMES:
        return 0
    ahead, turn = correlations(time_s, np.column_stack([middle_mm, heading_rad]), run.run_command.command.at, DELAYS_S)
    best = int(np.abs(turn).argmax())
    if abs(turn[best]) < SHOWS or ahead[best] < -SHOWS:  # driven the opposite way, which is another mistake
        return 0
    return int(np.sign(turn[best]))


def _exchanged(run: RunData) -> Alternative:
    return Alternative("sides-swapped", driven(run, 1.0, exchanged=True))
