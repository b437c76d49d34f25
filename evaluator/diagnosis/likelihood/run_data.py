"""Interface of the diagnosis to a simulator: marks of runs for given parameters, in batches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from evaluator.interchange.commands import RunCommand, constant
from simulator.robot import Robot

Floats = NDArray[np.float64]
Values = Mapping[str, tuple[float, ...]]
# One standard deviation of what is not a value of robot.toml (an error that runs share, a quantity of the laboratory),
# as a deviation: that of a nominal value known to two per cent.
SHARED_UNIT = 0.02
START_POSE = 3  # of the numbers per run, and of a state, the first: x, y, heading
PER_RUN = 7  # of a run: start x, y, heading; friction, left gain, right gain; start of motion


def is_shared(key: str) -> bool:
    """Whether a deviation is in units of its standard deviation over SHARED_UNIT, not relative as in robot.toml."""
    return "." not in key


class NotSimulatedError(FloatingPointError):
    """Runs cannot be simulated at a point of the parameters."""

    def __init__(self, runs: Sequence[str]) -> None:
        """runs: their ids."""
        self.runs = tuple(runs)
        super().__init__(f"run {self.runs[0]} cannot be simulated at this point")


@dataclass(frozen=True)
class RunData:
    """One recorded run, independent of its source.

    time_s: (n,) presentation times. marks_mm: (n, 4) x, y of the first and of the second mark in the plate frame, NaN
    where one is missing: the robot's own two, or its reference pair (robot_geometry.reference_marks). line_rad:
    direction from the second to the first in the body frame. order: its place in the session, from 0. systematic: (n,
    4) by key, shift of the marks, mm, by one standard deviation of an error that runs share (of their camera, or of the
    appearance of a mark). log: the commands, if there is more than one or the run does not start at rest; left_rpm and
    right_rpm are then the command held longest, start_s and stop_s the first and the last time with a motor on.
    from_poses: the marks were computed from poses, so that their distance has no information. start_is_stated: whether
    the file states start_s, which is otherwise 0. filmed: whether the marks are known to be from a film. run_in:
    velocity of the midpoint of the marks along and across the heading, mm/s, and yaw rate, rad/s, as measured RUN_IN_S
    before a run that does not start at rest; None: rest.
    """

    id: str
    left_rpm: float
    right_rpm: float
    start_s: float
    stop_s: float | None
    time_s: Floats
    marks_mm: Floats
    order: int
    systematic: Mapping[str, Floats] = field(default_factory=dict)
    line_rad: float = np.pi / 2
    log: RunCommand | None = None
    from_poses: bool = False
    start_is_stated: bool = True
    filmed: bool = False
    run_in: tuple[float, float, float] | None = None

    @cached_property
    def run_command(self) -> RunCommand:
        """The commands of the run."""
        return self.log or constant(self.left_rpm, self.right_rpm, self.start_s, self.stop_s)

    def first(self, frames: int) -> RunData:
        """The first frames of the run."""
        systematic = {key: shift[:frames] for key, shift in self.systematic.items()}
        return replace(self, time_s=self.time_s[:frames], marks_mm=self.marks_mm[:frames], systematic=systematic)

    @property
    def command(self) -> tuple[float, float]:
        """Left and right rpm."""
        return self.left_rpm, self.right_rpm


@dataclass(frozen=True)
class Task:
    """One run to predict: its index and parameters.

    nominal: relative deviations of nominal values, by dotted key of robot.toml; errors that runs share and quantities
    of the laboratory, by their key, in SHARED_UNIT to the standard deviation. terms: coordinates of candidate effects
    by id. per_run: PER_RUN numbers, the start pose x, y (mm), heading (rad) of the robot's centre, and random effects:
    relative deviations of friction, left and right wheel speed; how much later than stated it starts, in standard
    deviations of that.
    """

    run: int
    per_run: tuple[float, ...]
    nominal: Mapping[str, float] = field(default_factory=dict)
    terms: Values = field(default_factory=dict)


class Forward(Protocol):
    """A simulator of an experiment; robots: one per run."""

    robots: tuple[Robot, ...]

    def marks(self, tasks: Sequence[Task]) -> list[Floats]:
        """Marks (n, 4) in mm at the frame times of each task's run; NaN where the simulation fails."""
        ...

    def of_frames(self, data: Sequence[RunData]) -> Forward:
        """The simulator of these runs at other frames."""
        ...


def aligned_starts(data: Sequence[RunData], forward: Forward) -> Floats:
    """Start poses that fit the nominal prediction to the first part of every run, (n, 7), with zero random effects."""
    per_run = np.zeros((len(data), PER_RUN))
    predicted = forward.marks([Task(run, (0.0,) * PER_RUN) for run in range(len(data))])
    for run, (item, marks) in enumerate(zip(data, predicted, strict=True)):
        seen = np.flatnonzero(np.isfinite(item.marks_mm).all(axis=1))
        early = seen[: max(len(seen) // 8, 5)]
        measured = item.marks_mm[early].reshape(-1, 2)
        model = marks[early].reshape(-1, 2)
        measured_z, model_z = (a[:, 0] + 1j * a[:, 1] for a in (measured, model))
        turn = np.angle(np.sum((measured_z - measured_z.mean()) * np.conj(model_z)))  # one mean is enough
        shift = measured_z.mean() - np.exp(1j * turn) * model_z.mean()
        per_run[run, :3] = shift.real, shift.imag, turn
    return per_run
