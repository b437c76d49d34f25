"""Commands in another unit than rpm of the wheels: how fast the robot moves, over what its command says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.run_data import PER_RUN, RunData, Task
from evaluator.diagnosis.likelihood.simulation import Simulated
from evaluator.diagnosis.mistakes.disturbances import SETTLED_S
from evaluator.diagnosis.mistakes.intervals import phases_of
from evaluator.diagnosis.mistakes.motion import motion_of
from evaluator.diagnosis.mistakes.recognised import MOST
from evaluator.interchange.commands import RunCommand
from simulator.command import RPM_PER_RAD_S, Command
from simulator.robot import Robot

Floats = NDArray[np.float64]

# Factor of all speeds, or its inverse, from which a unit may be the cause, and beyond which no effect of the catalogue
# is (the bounds of drive-speed-scale and time-base).
LEAST_FACTOR, MOST_OF_EFFECTS = 1.5, 2.0
STRAIGHT_SHARE = 0.5  # mean speed of both sides over that of the faster, from which the middle moves about as they roll
# Largest relative difference from the factor of a unit: motors and friction slow a robot by up to a fifth; where an
# effect may be the cause too, radii and clocks are known to a few per cent.
UNIT_SHARE, NEAR_SHARE = 0.25, 0.06
COMMON_SHARE = 0.15  # largest relative difference of a run's factor from that of all


@dataclass(frozen=True)
class Factor:
    """By how much the wheels turn faster than commanded, as the motion shows, and the unit that explains it, if any."""

    times: float
    unit: str = ""

    @property
    def words(self) -> str:
        """The end of a sentence about the run."""
        gear = "the command were that of a motor before its gear" if self.times < 1 else ""
        explained = f", as if {self.unit or gear}" if self.unit or gear else ""
        return f"moves as if its wheels turned {self.times:.3g} times as fast as commanded{explained}"


def speed_factors(data: Sequence[RunData], robots: Sequence[Robot]) -> list[Factor | None]:
    """For every run, the factor of its speed if a unit of its own, or a factor common to most runs, explains it.

    The speed of the middle of the marks along the robot, over that of a simulation. Turns nearly on the spot do not
    show it, and have the factor of the others.
    """
    shown = _all_shown(data, robots)
    asked = [k for k, value in enumerate(shown) if is_far(float(value))]
    shown[asked] /= _slipped([driven(data[k], float(shown[k])) for k in asked], [robots[k] for k in asked])
    common = _common(shown)
    found: list[Factor | None] = []
    for value, robot in zip(shown, robots, strict=True):
        if common and not abs(value / common - 1) >= COMMON_SHARE:
            named = _named(common, robot, of_all=True)
            found.append(named or (Factor(common) if is_far(common, MOST_OF_EFFECTS) else None))
        else:
            found.append(_named(float(value), robot, of_all=False) if is_far(float(value)) else None)
    return found


def share_a_factor(data: Sequence[RunData], robots: Sequence[Robot]) -> bool:
    """Whether most runs are faster or slower than commanded by one factor that no physics causes."""
    return _common(_all_shown(data, robots)) > 0


def driven(run: RunData, times: float, *, exchanged: bool = False) -> RunData:
    """The run with its command times a factor, left and right exchanged or not."""
    left, right = (times * run.left_rpm, times * run.right_rpm)[:: -1 if exchanged else 1]
    log = None if run.log is None else with_wheels(run.log, times, exchanged=exchanged)
    return replace(run, left_rpm=left, right_rpm=right, log=log)


def with_wheels(log: RunCommand, times: float, *, exchanged: bool = False) -> RunCommand:
    """A log with its speeds times a factor, left and right exchanged or not."""
    sides = (times * log.command.left_rpm, times * log.command.right_rpm)[:: -1 if exchanged else 1]
    return replace(log, command=Command(log.command.time_s, *sides))


def _slipped(data: Sequence[RunData], robots: Sequence[Robot]) -> Floats:
    """Speeds (n,) of simulated runs over those of their wheels; 1 where the simulation does not show it."""
    if not data:
        return np.ones(0)
    marks = Simulated(robots, data, {}).marks([Task(k, (0.0,) * PER_RUN) for k in range(len(data))])
    simulated = [replace(run, marks_mm=seen) for run, seen in zip(data, marks, strict=True)]
    found = _all_shown(simulated, robots)
    return np.where(np.isfinite(found) & (found > 0), found, 1.0)


def speeds_over_simulated(data: Sequence[RunData], robots: Sequence[Robot]) -> Floats:
    """Measured over simulated speed (n,) of the middle of the marks along the robot; NaN if no phase shows it."""
    return _all_shown(data, robots) / _slipped(data, robots)


def _all_shown(data: Sequence[RunData], robots: Sequence[Robot]) -> Floats:
    return np.array([_shown(run, robot) for run, robot in zip(data, robots, strict=True)])


def _common(shown: Floats) -> float:
    """The factor that most runs share, 0 if there is none or slip may cause it."""
    seen = shown[np.isfinite(shown)]
    common = float(np.median(seen)) if len(seen) > 2 else np.nan
    alike = np.abs(seen - common) < COMMON_SHARE * common
    return common if is_far(common) and alike.sum() >= MOST * len(seen) else 0.0


def _named(times: float, robot: Robot, *, of_all: bool) -> Factor | None:
    """The factor of the unit nearest to a measured one; None if it is not near.

    of_all: whether all runs have it. A single run is not half as fast as the others because of the robot file.
    """
    per_rad_s, radius_mm = RPM_PER_RAD_S, robot.driving_radius_mm
    units = {
        "the command were in rad/s": per_rad_s,
        "the command were in deg/s": 1 / 6,
        "the command were in turns per second": 60.0,
        "the command were the speed of the wheels in mm/s": per_rad_s / radius_mm,
        "the command were the speed of the wheels in m/s": 1000 * per_rad_s / radius_mm,
    }
    if of_all:
        units |= {"the radius of the wheels in the robot file were their diameter": 0.5}
    words, factor = min(units.items(), key=lambda item: abs(np.log(item[1] / times)))
    most = UNIT_SHARE if is_far(times, MOST_OF_EFFECTS * (1 + UNIT_SHARE)) else NEAR_SHARE
    return Factor(factor, words) if abs(times / factor - 1) < most else None


def is_far(times: float, least: float = LEAST_FACTOR) -> bool:
    """Whether a ratio, or its inverse, is larger than the least one; not if it is unknown or not positive."""
    return bool(np.isfinite(times) and times > 0 and abs(np.log(times)) > np.log(least))


def _shown(run: RunData, robot: Robot) -> float:
    """Speed of the middle of the marks along the robot over the mean speed of its wheels; NaN if no phase shows it."""
    found = []
    for phase in phases_of(run):
        mean = (phase.left_rpm + phase.right_rpm) / 2
        if abs(mean) < STRAIGHT_SHARE * max(abs(phase.left_rpm), abs(phase.right_rpm)) or not mean:
            continue
        end = float(phase.time_s[-1]) if phase.stop_s is None else min(phase.stop_s, float(phase.time_s[-1]))
        motion = motion_of(phase, (max(phase.start_s, float(phase.time_s[0])) + SETTLED_S, end))
        if motion is not None:
            rolled = abs(mean) * 2 * np.pi * robot.driving_radius_mm / 60
            found.append(abs(float(np.median(motion.along))) / rolled)
    return float(np.median(found)) if found else np.nan
