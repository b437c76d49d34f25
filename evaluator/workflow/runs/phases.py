"""The phases of a run: intervals of constant command, or the whole run if the command is constant."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluator.interchange.commands import RunCommand
from evaluator.interchange.log_offset import LogOffset, log_offset
from evaluator.pose import Poses
from evaluator.settings import Run
from evaluator.turning import RobotShape, Turning, measure_turning
from evaluator.turning.clock import MOST_LATE_S, CommandDelay, command_delay, most_late_s

# Shorter intervals are not phases, because a joystick passes through many intermediate values.
FEWEST_FRAMES = 12
# Times of a log in another time zone than those of the recording; by chance they are so near once in thirty.
HALF_HOUR_S, NEAR_ZONE_S = 1800.0, 30.0


@dataclass(frozen=True)
class Phase:
    """A part of a run that is measured separately.

    head: columns of its row of turning.csv other than the turning. frames: its frames among the poses of the run.
    start_s, stop_s: motors on and off, if the measurement needs them.
    """

    frames: slice
    left_rpm: float | None
    right_rpm: float | None
    start_s: float | None = None
    stop_s: float | None = None
    head: dict[str, Any] = field(default_factory=dict)

    def of(self, poses: Poses) -> Poses:
        """The poses that belong to the phase."""
        if self.frames == slice(None):
            return poses
        part = {
            name: value[self.frames]
            for name in ("time_s", "x_mm", "y_mm", "heading_rad", "covariance", "status", "spacing_mm", "systematic")
            if (value := getattr(poses, name)) is not None and len(value) == len(poses.time_s)
        }
        return replace(poses, **part)

    def measured(self, poses: Poses, shape: RobotShape | None) -> Turning:
        """The turning of the phase in the poses of a run."""
        return measure_turning(
            self.of(poses),
            start_s=self.start_s,
            stop_s=self.stop_s,
            shape=shape,
            left_rpm=self.left_rpm,
            right_rpm=self.right_rpm,
        )


def phases_of(run_command: RunCommand, poses: Poses, shape: RobotShape | None = None) -> tuple[Phase, ...]:
    """The phases of a run in order of time; of a run with a log, long enough intervals with a motor on.

    Phases are delayed like the motion relative to the log, because of different clocks or a dead time. Frames that may
    belong to a change of command, or in which the robot accelerates, are in no phase.
    """
    first, last = float(poses.time_s[0]), float(poses.time_s[-1])
    if not run_command.logged:
        left, right = run_command.main(first, last)
        start_s = run_command.start_s if run_command.starts_at_rest else None
        return (Phase(slice(None), left, right, start_s, run_command.stop_s),)
    late = command_delay_of(run_command, poses, shape)
    return tuple(_stretches(run_command, poses.time_s, late))


def command_delay_of(run_command: RunCommand, poses: Poses, shape: RobotShape | None = None) -> CommandDelay:
    """Delay of a run's motion after its command log.

    It is searched by the moments of the changes near the log, or near the offset of the whole motion if that is farther
    than these can show. Where the log changes again before the motion has followed, it is that offset.
    """
    there = poses.measured
    if there.sum() < FEWEST_FRAMES:
        return CommandDelay()
    time_s, pose = poses.time_s[there], np.column_stack([poses.x_mm, poses.y_mm, poses.heading_rad])[there]
    reach_mm = math.inf if shape is None else float(np.hypot(*np.transpose(shape.wheel_positions_mm)).max())
    offset = _offset(run_command, time_s, pose, MOST_LATE_S)
    begun = [item.begin_s for item in run_command.command.stretches() if math.isfinite(item.begin_s)]
    for apart_s in (0.0,) if offset is None else (0.0, offset.value_s):
        changes = [apart_s + change for change in begun if time_s[0] < apart_s + change < time_s[-1]]
        if offset is not None and abs(offset.value_s - apart_s) > most_late_s(time_s, changes):
            continue
        found = command_delay(time_s, pose, changes, reach_mm)
        if offset is None or np.isfinite(found.value_s):
            limits = {name: getattr(found, name) + apart_s for name in ("value_s", "low_s", "high_s")}
            return replace(found, **limits)
    return CommandDelay() if offset is None else CommandDelay(offset.value_s, offset.low_s, offset.high_s)


def _offset(
    run_command: RunCommand, time_s: NDArray[np.float64], pose: NDArray[np.float64], near_s: float
) -> LogOffset | None:
    command = run_command.command
    return log_offset(time_s, pose, command.at, (float(command.time_s[0]), float(command.time_s[-1])), near_s)


def start_by_motion(run: Run, run_command: RunCommand, poses: Poses) -> str:
    """The start_s at which the motion follows the log of a run, as the end of a sentence; empty if it does not show."""
    there = poses.measured
    if not run_command.logged or there.sum() < FEWEST_FRAMES:
        return ""
    pose = np.column_stack([poses.x_mm, poses.y_mm, poses.heading_rad])[there]
    offset = _offset(run_command, poses.time_s[there], pose, 0.0)
    if offset is None:
        return ""
    hours = round(offset.value_s / HALF_HOUR_S) / 2  # the least difference of two time zones in one place
    zone = abs(offset.value_s - 3600 * hours) < NEAR_ZONE_S and hours
    of_zone = f"; {abs(hours):g} h, as of two time zones or of summer time" if zone else ""
    found_s = run.start_s + offset.value_s
    return f"; the motion follows the log with start_s = {found_s:.2f} (delay of the motors included{of_zone})"


def _stretches(run_command: RunCommand, time_s: NDArray[np.float64], late: CommandDelay) -> Iterator[Phase]:
    low, high = (late.low_s, late.settled_s) if late.is_known else (0.0, 0.0)
    number = 0
    for item in run_command.driven:
        begin, end = item.begin_s + high, item.end_s + low
        frames = slice(int(np.searchsorted(time_s, begin)), int(np.searchsorted(time_s, end, side="right")))
        if frames.stop - frames.start < FEWEST_FRAMES:
            continue
        number += 1
        head = {
            "phase": number,
            "left_rpm": item.left_rpm,
            "right_rpm": item.right_rpm,
            "phase_start_s": float(time_s[frames.start]),
            "phase_stop_s": float(time_s[frames.stop - 1]),
            "late_s": late.value_s,
            "late_low_s": late.low_s,
            "late_high_s": late.high_s,
            "rise_s": late.rise_s,
            "hidden_rise_s": late.hidden_rise_s,
        }
        yield Phase(frames, item.left_rpm, item.right_rpm, head=head)


def rows_of(phases: Sequence[Phase], poses: Poses, shape: RobotShape | None) -> list[dict[str, Any]]:
    """A row of turning.csv for every phase; for a log without phases one row with the reason."""
    if not phases:
        kept, there = "its log of commands holds nothing with a motor on for", int(poses.measured.sum())
        reason = f"{kept} {FEWEST_FRAMES} frames of the recording, which has {there} with a pose"
        return [Turning(radius_status=reason).to_row()]
    return [{**phase.head, **phase.measured(poses, shape).to_row()} for phase in phases]
