"""Candidate runs: commands, and start poses from which they stay on the plate."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluator.robot_geometry import reference_places
from simulator.command import Command
from simulator.errors import SimulationError
from simulator.observation import seen_of_run, view_of
from simulator.robot import Robot
from simulator.simulation import simulate

Floats = NDArray[np.float64]

DURATION_S = 8.0  # of driving, where the plate is long enough
SHORTEST_S = 2.0  # four times what a turn takes to settle (relevance.SETTLED_S)
STEPS_PER_S = 10  # of the path, to test whether it stays on the plate
REST_S = 0.5  # before the motors start: ten frames of next_runs.RATE_HZ show where the robot stands
HEADINGS_DEG = tuple(range(0, 360, 45))  # distinguish waves of one and of two periods over the heading
MOST_LEVELS = 8  # one more than the speeds of the paper's straight runs
SHARES = (1.0, 0.7, 0.4)  # of the faster wheel's speed: straight, a wide turn, a tight turn
PIVOTS = (0.0, -1.0)  # of the faster wheel's speed: a turn about the resting wheel, and on the spot
# Positions of a run in the room: middle and corners, as shares of the half widths that its path leaves free.
MIDDLE = (0.0, 0.0)
CORNERS = ((0.9, 0.9), (-0.9, -0.9), (0.9, -0.9), (-0.9, 0.9))


@dataclass(frozen=True)
class CandidateRun:
    """A possible run: command, start pose of the robot's centre, and duration."""

    left_rpm: float
    right_rpm: float
    heading_deg: float
    x_mm: float = 0.0
    y_mm: float = 0.0
    duration_s: float = DURATION_S

    @property
    def command(self) -> tuple[float, float]:
        """Left and right rpm."""
        return self.left_rpm, self.right_rpm


@dataclass(frozen=True)
class Room:
    """The part of the plate available to the marks: its middle and half widths, plate frame, mm."""

    middle_mm: tuple[float, float]
    half_mm: tuple[float, float]

    @staticmethod
    def of_plate(size_mm: tuple[float, float], margin_mm: float) -> Room:
        """A plate of this size about the origin, without a margin on each side."""
        x, y = (max(size / 2 - margin_mm, 0.0) for size in size_mm)
        return Room((0.0, 0.0), (x, y))

    @staticmethod
    def of_marks(marks_mm: Sequence[Floats]) -> Room:
        """The area covered by the marks (n, 4) of runs."""
        points = np.concatenate([item.reshape(-1, 2) for item in marks_mm])
        low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
        middle, half = (low + high) / 2, (high - low) / 2
        return Room((float(middle[0]), float(middle[1])), (float(half[0]), float(half[1])))


def commands_at(levels_rpm: Sequence[float], *, pivots: bool = False) -> list[tuple[float, float]]:
    """Straight runs and turns to both sides, forward and backward, at these levels, the highest and half of it.

    Of many levels (a log in which commands hardly repeat), MOST_LEVELS are used. pivots: also turns in which one wheel
    stands still or turns backward, for robots whose sides are driven independently.
    """
    top = max(levels_rpm)
    shares = SHARES + PIVOTS if pivots else SHARES
    levels = sorted({round(level, 3) for level in (*levels_rpm, top, top / 2) if level > 0})
    if len(levels) > MOST_LEVELS:
        levels = [levels[k] for k in np.unique(np.linspace(0, len(levels) - 1, MOST_LEVELS).round().astype(int))]
    forward = {
        pair for level in levels for share in shares for pair in ((level, level * share), (level * share, level))
    }
    return sorted(forward | {(0.0 - left, 0.0 - right) for left, right in forward})  # no -0


def placed(
    robot: Robot,
    command: tuple[float, float],
    headings_deg: Sequence[float],
    room: Room,
    places: Sequence[tuple[float, float]],
) -> Iterator[CandidateRun]:
    """Runs at every start heading and position, shortened if the room is too small.

    places: of the middle of the path, as shares of the half widths that the path leaves free. Headings at which not
    even SHORTEST_S of driving fit are omitted, and so are commands at which chance decides how the robot turns, or
    whose motion cannot be followed.
    """
    half, path = np.array(room.half_mm), _path(robot, command)
    if path is None:
        return
    for heading in headings_deg:
        for seconds in np.arange(DURATION_S, SHORTEST_S - 0.5, -1.0):
            low, high = _reach(path, heading, float(seconds))
            free = half - (high - low) / 2
            if (free >= 0).all():
                for place in places:
                    x, y = np.array(room.middle_mm) + np.array(place) * free - (low + high) / 2
                    yield CandidateRun(
                        *command, heading, round(float(x), 1) + 0.0, round(float(y), 1) + 0.0, float(seconds)
                    )
                break


def _reach(path: Floats, heading_deg: float, seconds: float) -> tuple[Floats, Floats]:
    """Smallest and largest x, y (2,) of the marks on a path from the origin at a heading."""
    points = path[: int(seconds * STEPS_PER_S) + 1].reshape(-1, 2)
    angle = np.radians(heading_deg)
    turned = points @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return turned.min(axis=0), turned.max(axis=0)


def _path(robot: Robot, command: tuple[float, float]) -> Floats | None:
    """Marks (n, 4) of a run from the origin at heading 0; None if a small disturbance ends or decides its motion."""
    times = np.arange(DURATION_S * STEPS_PER_S + 1) / STEPS_PER_S
    try:
        run = simulate(robot, Command.constant(*command, 0.0), times)
    except SimulationError:
        return None
    if run.is_by_chance:
        return None
    return np.concatenate(seen_of_run(view_of(robot, reference_places(robot)), run), axis=1)
