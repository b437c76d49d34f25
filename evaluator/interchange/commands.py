"""Commands of a run, constant or from a log, in the time of the recording."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path

from evaluator.errors import InputError
from evaluator.files import read_with
from evaluator.interchange.bags import Topics, is_bag, read_commands
from evaluator.interchange.poses import LARGEST_CLOCK_S
from simulator.command import RPM_PER_RAD_S, Command, Stretch
from simulator.errors import SimulationError


@dataclass(frozen=True)
class RunCommand:
    """Command of a run over the time of its recording.

    starts_at_rest: whether the robot rests when its motors are first switched on. logged: whether the command comes
    from a log, so that the run may contain several phases. zero_s: time of the recording at which the clock of the log
    reads 0; None if both have the same clock.
    """

    command: Command
    starts_at_rest: bool = True
    logged: bool = False
    zero_s: float | None = None

    def later(self, by_s: float) -> RunCommand:
        """The same commands later in the recording."""
        zero_s = None if self.zero_s is None else self.zero_s + by_s
        return replace(self, command=self.command.retimed(later_s=by_s), zero_s=zero_s)

    def true_clock(self, factor: float, late_s: float = 0.0) -> tuple[float, float]:
        """What to add to times of the command, and to multiply the sum by, for true times.

        factor: of times of the recording over true ones, see time-base. late_s: of the command, in the recording. A
        camera with another frame rate than stated does not slow the motors: the clock of their log is right.
        """
        if self.zero_s is None:
            return late_s, 1 / factor
        return (self.zero_s + late_s) / factor - self.zero_s, 1.0

    def in_true_time(self, factor: float) -> Command:
        """The command in true time; factor: see true_clock."""
        later_s, times = self.true_clock(factor)
        return self.command.retimed(times, later_s * times)

    @cached_property
    def driven(self) -> tuple[Stretch, ...]:
        """Intervals of constant command with a motor on, in order of time."""
        return tuple(item for item in self.command.stretches() if item.is_driven)

    @property
    def start_s(self) -> float | None:
        """Time at which the motors are first switched on; None if they were on before, or never are."""
        begin = min((item.begin_s for item in self.driven), default=-math.inf)
        return begin if math.isfinite(begin) else None

    @property
    def stop_s(self) -> float | None:
        """Time at which the motors are finally switched off; None if they are not."""
        end = max((item.end_s for item in self.driven), default=math.inf)
        return end if math.isfinite(end) else None

    def main(self, first_s: float, last_s: float) -> tuple[float, float]:
        """The command held longest between two times with a motor on, left and right rpm; 0, 0 if there is none."""
        held: dict[tuple[float, float], float] = {}
        for item in self.driven:
            key = item.left_rpm, item.right_rpm
            held[key] = held.get(key, 0.0) + max(min(item.end_s, last_s) - max(item.begin_s, first_s), 0.0)
        return max(held, key=lambda key: held[key], default=(0.0, 0.0))


def unsigned_rpm(left_rpm: float, right_rpm: float) -> tuple[float, float]:
    """Speeds of the slower and of the faster wheel, rpm, without side and sign."""
    speeds = abs(left_rpm), abs(right_rpm)
    return min(speeds), max(speeds)


@lru_cache(maxsize=1024)  # many runs of a session have one command; what is returned is immutable
def constant(
    left_rpm: float, right_rpm: float, start_s: float, stop_s: float | None, *, starts_at_rest: bool = True
) -> RunCommand:
    """One constant command; start_s has no meaning if the robot already moves."""
    if starts_at_rest:
        return RunCommand(Command.constant(left_rpm, right_rpm, start_s, stop_s))
    return RunCommand(Command.always(left_rpm, right_rpm, stop_s), starts_at_rest=False)


def from_log(
    path: Path,
    zero_s: float = 0.0,
    clock_s: float = 0.0,
    *,
    starts_at_rest: bool = True,
    topics: Topics | None = None,
) -> RunCommand:
    """The commands of a log or a bag whose clock reads 0 at zero_s of the recording.

    clock_s: reading of the recording's clock at its beginning, if it counts from 1970; so may the clock of the log.
    topics: of a bag; their wheels and track are also used for a table of velocities. Raises InputError with the file.
    """

    def read(file: Path) -> Command:
        if is_bag(file):
            time_s, sides_rad_s = read_commands(file, topics or Topics())
            return Command.held_samples(time_s, RPM_PER_RAD_S * sides_rad_s, starts_at_rest=starts_at_rest)
        of_drive = {} if topics is None else {"wheel_radius_m": topics.wheel_radius_m, "track_m": topics.track_m}
        return Command.held(file, starts_at_rest=starts_at_rest, **of_drive)

    try:
        command = read_with(read, path)
    except SimulationError as error:
        raise InputError(str(error)) from error
    if abs(command.time_s[-1]) > LARGEST_CLOCK_S:
        return RunCommand(command.retimed(later_s=zero_s - clock_s), starts_at_rest, logged=True)
    return RunCommand(command.retimed(later_s=zero_s), starts_at_rest, logged=True, zero_s=zero_s)
