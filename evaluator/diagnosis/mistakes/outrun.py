"""Runs that get farther for a moment than their wheels roll: pushed, pulled, or displaced with the camera."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.motion import LEAST_LEAP_MM, WINDOW_S, midpoint_and_heading
from evaluator.diagnosis.mistakes.recognised import Found
from evaluator.interchange.commands import unsigned_rpm
from evaluator.robot_geometry import reference_places
from simulator.command import Stretch
from simulator.robot import Robot

Floats = NDArray[np.float64]

PUSHED_SHARE = 1.6  # of the usual speed of the run, or of its wheels: physical effects cause no such brief changes
BRIEF_S = 0.5  # a robot moves by one or two millimetres meanwhile: too little for a force that varies over the plate
STEADIED = 7  # frames of a median, which three wrong ones do not move


def rolls_mm_s(left_rpm: float, right_rpm: float, robot: Robot) -> float:
    """Speed of the rims of the faster side at a command, mm/s, never negative."""
    return unsigned_rpm(left_rpm, right_rpm)[1] * _mm_s_per_rpm(robot)


def _mm_s_per_rpm(robot: Robot) -> float:
    return 2 * np.pi * robot.driving_radius_mm / 60


def carries_mm_s(driven: Sequence[Stretch], robot: Robot) -> float:
    """Highest speed of the middle of the marks at any of some commands without a push, mm/s.

    That of the rims, or of a turn about the axle farthest from the marks, across which the others slide: where magnets
    hold the front wheels, a robot turns on the spot about these, and what is behind them is faster than their rims.
    """
    left, right = np.array([(item.left_rpm, item.right_rpm) for item in driven]).T * _mm_s_per_rpm(robot)
    x, y = np.mean(reference_places(robot), axis=0)
    yaw, arm = np.abs(right - left) / robot.track_mm, np.abs(robot.wheel_positions_mm()[:, 0] - x).max()
    turned = np.hypot(np.abs(left + right) / 2 + yaw * abs(y), yaw * arm)
    return float(np.max([np.abs(left), np.abs(right), turned]))


def outruns_its_wheels(run: RunData, robot: Robot) -> Found | None:
    """A brief time in which a robot gets much farther than its wheels carry it, also soon after its start.

    No effect drives it faster than these, except a pull that captures it. The fastest command of a log counts, as
    motors may follow late. A run that outruns its wheels for longer, or over half of its time, has wrong wheel speeds
    or times. Given poses are not judged: many are held, and then jump.
    """
    driven = run.run_command.driven
    if run.from_poses or not driven:
        return None
    rims_mm_s = max(rolls_mm_s(item.left_rpm, item.right_rpm, robot) for item in driven)
    time, middle, _ = midpoint_and_heading(run)
    inside = (time >= driven[0].begin_s) & (time <= driven[-1].end_s)
    time, middle = time[inside], middle[inside]
    if len(time) < 2 * STEADIED or not rims_mm_s:
        return None
    first_s, later_s, moved = _ways(time, middle)
    if not (moved > PUSHED_SHARE * rims_mm_s * (later_s - first_s) + LEAST_LEAP_MM).any():  # nearly all runs
        return None
    carried = carries_mm_s(driven, robot) * (later_s - first_s)
    outrun = moved > PUSHED_SHARE * carried + LEAST_LEAP_MM
    # Of slow wheels, most windows are shorter than a leap: a run that is faster than these all the time is not pushed.
    always = np.mean(moved > PUSHED_SHARE * carried) > 0.5
    if not outrun.any() or always or np.ptp(first_s[outrun]) > BRIEF_S:
        return None
    most = int(np.argmax(moved - carried))
    begin, stop = first_s[most], later_s[most]
    seen = (
        f"moves by {moved[most]:.2g} mm from {begin:.2f} to {stop:.2f} s, while its wheels carry it by "
        f"{carried[most]:.2g} mm at most"
    )
    remedy = "inspect the recording: was the robot pushed or pulled?"
    if time[-1] - later_s[outrun][-1] < WINDOW_S:  # to the end
        before_s = np.floor(100 * first_s[outrun][0]) / 100
        remedy = f"if a hand takes the robot away, give a time before as the end of the run (stop_s = {before_s:.2f})"
    return Found(run.id, "pushed", seen, remedy, ("camera-moved",))


def taken_away_s(run: RunData, stop_s: float) -> float:
    """Time, s, from which a robot gets farther after its stop than it did before: a hand takes it; else infinity."""
    time, middle, _ = midpoint_and_heading(run)
    if len(time) < 2 * STEADIED:
        return np.inf
    first_s, later_s, moved = _ways(time, middle)
    driven = (later_s <= stop_s) & (later_s > stop_s - 2 * WINDOW_S)
    if not driven.any():
        return np.inf
    most_mm = PUSHED_SHARE * float(np.median(moved[driven])) + LEAST_LEAP_MM
    taken = (first_s >= stop_s - WINDOW_S) & (later_s > stop_s) & (moved > most_mm)
    return max(float(first_s[taken][0]), stop_s) if taken.any() else np.inf


def _ways(time_s: Floats, middle_mm: Floats) -> tuple[Floats, Floats, Floats]:
    """Begin and end, s, of windows of WINDOW_S, one for each frame, and how far, mm, the robot gets in each (m,)."""
    middle = np.median(np.lib.stride_tricks.sliding_window_view(middle_mm, STEADIED, axis=0), axis=2)
    time = time_s[STEADIED // 2 : -(STEADIED // 2)]
    later = np.searchsorted(time, time + WINDOW_S)
    first = np.flatnonzero(later < len(time))
    later = later[first]
    return time[first], time[later], np.hypot(*(middle[later] - middle[first]).T)
