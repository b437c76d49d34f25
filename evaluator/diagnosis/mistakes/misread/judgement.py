"""How well a run fits its file and the hypotheses on it, and the wheel speeds by which runs are alike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.misread.alternatives import Alternative
from evaluator.diagnosis.mistakes.recognised import Kind
from evaluator.interchange.commands import unsigned_rpm

Floats = NDArray[np.float64]

BETTER = 3.0  # least ratio of the misfits of file and mistake, and of the file's misfits of this and of similar runs
ALIKE = 1.3  # ratio of misfits within which two mistakes are distinguished by other evidence
# Number of other runs with the same ratio of wheel speeds, on either side and in both directions, with which a smaller
# misfit is sufficient: a physical effect changes all of these runs, and is excluded if they fit their file.
FEWEST_SIMILAR = 2
# Hypotheses that change no wheel speed. One of many other commands or rates may fit by chance.
SAME_SPEEDS: tuple[Kind, ...] = ("reversed", "sides-swapped", "marks-swapped", "mirrored")
# Hypotheses by which a run turns the other way. They are refuted by a run that does not turn that way by a quarter of
# what they predict: effects halve the turn of a run. A robot that scrub keeps from turning is nearer to an exchange
# of its sides within tolerances than to its file, if these bend the path to one side more than to the other.
OTHER_WAY: tuple[Kind, ...] = ("sides-swapped", "mirrored")
LEAST_TURN = 0.25
TURNING: tuple[Kind, ...] = ("reversed", *OTHER_WAY)  # hypotheses that change the sense of a turn


@dataclass(frozen=True)
class Judgement:
    """A run, the hypotheses on it (that of the file first), and the misfit of each, mm.

    extent_mm: of the path. speeds: of the wheels without side and sign. turn_rad: largest turn by the file, and how far
    the run has turned then the same way; NaN if unknown.
    """

    ways: list[Alternative]
    misfits_mm: Floats
    extent_mm: float
    speeds: tuple[tuple[float, float], ...]
    turn_rad: tuple[float, float] = (float("nan"), float("nan"))

    @property
    def share(self) -> float:
        """Misfit of the file over the extent of the path."""
        return float(self.misfits_mm[0]) / max(self.extent_mm, 1e-9)


def unsigned_speeds(run: RunData) -> tuple[tuple[float, float], ...]:
    """The wheel speeds of a run without side and sign, slower first, in the order of its commands."""
    return tuple(unsigned_rpm(item.left_rpm, item.right_rpm) for item in run.run_command.driven)


def speeds_of_sides(run: RunData) -> tuple[tuple[float, float], ...]:
    """Wheel speeds, left and right, of a run without direction: as if it began forward."""
    stretches = run.run_command.driven
    pairs = [(stretch.left_rpm, stretch.right_rpm) for stretch in stretches]
    backward = bool(pairs) and pairs[0] < (-pairs[0][0], -pairs[0][1])
    return tuple((-left, -right) if backward else (left, right) for left, right in pairs)
