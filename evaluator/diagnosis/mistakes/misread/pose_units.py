"""Poses, or the commands beside them, in another unit: a robot drives or turns many times as fast as commanded.

A robot with poses has no distance of marks that would show the unit of its positions. Slip and the lag of the drive
take a share of a motion, and no physics makes it ten times as fast: the ratios of measured and commanded speed and yaw
rate tell which of the three units is wrong, without a simulation, which on open ground no single run follows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.candidates.coordinates import is_full_size
from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.misread.command_unit import STRAIGHT_SHARE, is_far
from evaluator.diagnosis.mistakes.misread.turn_sense import DELAYS_S, FEWEST, FEWEST_FRAMES, SHOWS
from evaluator.diagnosis.mistakes.motion import midpoint_and_heading
from evaluator.diagnosis.mistakes.recognised import MOST, Found, by_recording
from evaluator.interchange.log_offset import averaging_times, correlations
from simulator.command import RPM_PER_RAD_S
from simulator.robot import Robot

Floats = NDArray[np.float64]

# Ratio of speeds, or its inverse, from which a unit may be the cause. Of 30 windows of a Husky on hard ground it is 0.8
# to 2.5; wheels that spin on ice would have to slip by three quarters all the time.
FAR = 4.0
ALIKE = 2.0  # largest ratio of a run's factor to that of all
NEAR = 1.6  # of the factor to that of a unit; neighbouring units are told together
# Yaw rate over speed, each relative to its command: a skid-steered robot turns by 0.07 to 1 of what its track says, a
# heading in another unit (57.3) is beyond ten times of that.
TURNS_BY, OF_HEADING = 0.3, 10.0
RADIAN_DEG = 180.0 / np.pi


@dataclass(frozen=True)
class _Pace:
    """Speed and yaw rate of a run over what its wheels are commanded; NaN where it does not show."""

    speed: float
    yaw: float


def in_another_unit(data: Sequence[RunData], robots: Sequence[Robot]) -> list[Found]:
    """Runs with poses whose positions, headings or commands are in another unit: all, or all parts of a recording."""
    runs = [(run, robot) for run, robot in zip(data, robots, strict=True) if run.from_poses]
    paces = {run.id: _pace(run, robot) for run, robot in runs}
    recordings = by_recording(paces)
    found = []
    for group in [list(paces), *(recordings if len(recordings) > 1 else [])]:
        robot = next((robot for run, robot in runs if run.id in group), None)
        others = [paces[name] for name in paces if name not in group]
        said = robot and _reading([paces[name] for name in group], robot, others)
        found += [Found(name, "wrong-unit", *said) for name in group] if said else []
        if len(found) == len(paces):  # all runs at once
            break
    return found


def _reading(paces: Sequence[_Pace], robot: Robot, others: Sequence[_Pace]) -> tuple[str, str] | None:
    """What runs seem to be in another unit and the remedy; others: of the session that are not."""
    speed, turn = _common_pace(paces)
    if not np.isfinite(speed):
        return None
    times_of_turn, speed_is_far = turn / TURNS_BY, is_far(speed, FAR)
    heading_is_off, only_speed_is_off = (is_far(times, OF_HEADING) for times in (times_of_turn, times_of_turn / speed))
    if not speed_is_far and heading_is_off:
        unit = "degrees" if times_of_turn > 1 else "radians"
        return (
            f"turns {_number(turn)} times as fast as commanded, as if its headings were in {unit}",
            "name their column after their unit, heading_deg or heading_rad",
        )
    if speed_is_far and only_speed_is_off:
        seen = _seen(speed, "positions", {"in mm": 1000.0, "in cm": 100.0, "in m and not in mm": 1e-3})
        return (seen, "name their columns after their unit, x_mm or x_m") if seen else None
    # Of smaller robots a simulation tells more.
    if not speed_is_far or not is_full_size(robot):
        return None
    if others and speed < 1 and not _is_slow_alike(speed, turn, *_common_pace(others)):
        return None
    commands = {
        "in rad/s": RPM_PER_RAD_S,
        "in rpm and not in rad/s": 1 / RPM_PER_RAD_S,
        "those of motors before their gears": 1 / RPM_PER_RAD_S,
        "in deg/s": 1 / 6,
        "in deg/s and not in rad/s": 1 / RADIAN_DEG,
        "in turns per second": 60.0,
        "speeds of the wheels in m/s": 1000 * RPM_PER_RAD_S / robot.driving_radius_mm,
    }
    seen = _seen(speed, "commands", commands)
    remedy = "give the speeds of the wheels in the unit of their column, or correct the robot file"
    return (seen, remedy) if seen else None


def _is_slow_alike(speed: float, turn: float, usual_speed: float, usual_turn: float) -> bool:
    """Whether a single recording drives and turns slower than the others by one factor, and its parts as well.

    A robot that is held or whose wheels spin is slow, too, but not by one factor of all motions.
    """
    slower, slower_turn = speed / usual_speed, turn / usual_turn
    return is_far(slower, FAR) and abs(np.log(slower_turn / slower)) < np.log(NEAR)


def _common_pace(paces: Sequence[_Pace]) -> tuple[float, float]:
    """Speed and yaw rate over what is commanded that most runs share; NaN for what they do not."""
    speed, turn = (_common([getattr(item, name) for item in paces]) for name in ("speed", "yaw"))
    return speed, turn


def _seen(times: float, what: str, units: Mapping[str, float]) -> str:
    """That a robot drives so many times as fast, as if something were in one of the units near to that; "" for none."""
    near = [unit for unit, factor in units.items() if abs(np.log(factor / times)) < np.log(NEAR)]
    seen = f"drives {_number(times)} times as fast as commanded, as if its {what} were {' or '.join(near)}"
    return seen if near else ""


def _number(times: float) -> str:
    return f"{times:.0f}" if times >= 10 else f"{times:.2g}"


def _common(values: Sequence[float]) -> float:
    """The factor that most of the runs that show one share; NaN if there is none."""
    seen = np.array([value for value in values if np.isfinite(value) and value > 0])
    if len(seen) < FEWEST:
        return np.nan
    common = float(np.median(seen))
    return common if np.mean(np.abs(np.log(seen / common)) < np.log(ALIKE)) >= MOST else np.nan


def _pace(run: RunData, robot: Robot) -> _Pace:
    """Speed without its sign, because headings may be wrong, and yaw rate by its correlation with the command."""
    time_s, middle_mm, heading_rad = midpoint_and_heading(run)
    if len(time_s) < FEWEST_FRAMES:
        return _Pace(np.nan, np.nan)
    rolled_mm = 2 * np.pi * robot.driving_radius_mm / 60  # per s and rpm
    sides = run.run_command.command.at
    found, gains = correlations(time_s, np.column_stack([middle_mm, heading_rad]), sides, DELAYS_S)
    best = int(found[1].argmax())
    yaw = float(gains[1, best]) / rolled_mm * robot.track_mm if found[1, best] > SHOWS else np.nan
    times, half = averaging_times(time_s)
    after, before = ([np.interp(times + way * half, time_s, part) for part in middle_mm.T] for way in (1, -1))
    speed = np.hypot(*np.subtract(after, before)) / (2 * half)
    left, right = sides(times)
    straight = np.abs(left + right) / 2 > STRAIGHT_SHARE * np.maximum(np.abs(left), np.abs(right))
    if not straight.any():
        return _Pace(np.nan, yaw)
    return _Pace(float(np.median(speed[straight] / (rolled_mm * np.abs(left + right)[straight] / 2))), yaw)
