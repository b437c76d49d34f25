"""Pose of the robot at any time: simulated, read from a CSV, or in closed form. Plate frame, mm, rad."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from calibration.tables import numbers_of
from simulator.errors import SimulationError
from simulator.rendering.tables import Circle, Given, Line, Motion, Simulated
from simulator.robot import Robot
from simulator.units import read_table

Array = NDArray[np.float64]
COLUMNS = ("time_s", "x_mm", "y_mm", "heading_deg")


def poses_at(motion: Motion, robot: Robot, times_s: Array) -> Array:
    """Pose of the robot's centre at times in any order: (n, 3) of x_mm, y_mm, heading_rad (unwrapped).

    Raises SimulationError for an invalid pose file, OSError if it cannot be read.
    """
    if isinstance(motion, Simulated):
        return _simulated(motion, robot, times_s)
    if isinstance(motion, Given):
        return _given(motion, times_s)
    stop_s = np.inf if motion.stop_s is None else motion.stop_s
    way_mm = motion.speed_mm_s * (np.clip(times_s, motion.start_s, max(stop_s, motion.start_s)) - motion.start_s)
    start = (motion.x_mm, motion.y_mm, np.radians(motion.heading_deg))
    return _line(way_mm, start) if isinstance(motion, Line) else _circle(motion, way_mm, start)


def _line(way_mm: Array, start: tuple[float, float, float]) -> Array:
    x, y, heading = start
    return np.stack(
        [x + way_mm * np.cos(heading), y + way_mm * np.sin(heading), np.full_like(way_mm, heading)], axis=-1
    )


def _circle(motion: Circle, way_mm: Array, start: tuple[float, float, float]) -> Array:
    x, y, heading = start
    radius = motion.radius_mm if motion.side == "left" else -motion.radius_mm
    turned = heading + way_mm / radius
    return np.stack(
        [x + radius * (np.sin(turned) - np.sin(heading)), y - radius * (np.cos(turned) - np.cos(heading)), turned],
        axis=-1,
    )


def _simulated(motion: Simulated, robot: Robot, times_s: Array) -> Array:
    from simulator.command import Command
    from simulator.run import State
    from simulator.simulation import simulate

    times, places = np.unique(np.concatenate([[0.0], np.maximum(times_s, 0.0)]), return_inverse=True)
    stop = [] if motion.stop_s is None else [(motion.stop_s, 0.0, 0.0)]
    command = Command.steps([(motion.start_s, motion.left_rpm, motion.right_rpm), *motion.steps, *stop])
    start = State(motion.x_mm, motion.y_mm, float(np.radians(motion.heading_deg)))
    run = simulate(robot, command, times, start=start, run_index=motion.run_index)
    return np.stack([run.x_mm, run.y_mm, run.heading_rad], axis=-1)[places[1:]]


def _given(motion: Given, times_s: Array) -> Array:
    table = read_table(motion.file)
    missing = [name for name in COLUMNS if name not in table]
    if missing:
        raise SimulationError(f"{motion.file}: lacks {', '.join(missing)}; poses need {', '.join(COLUMNS)}")
    values = table[list(COLUMNS)].apply(numbers_of).to_numpy(dtype=float)
    if len(values) < 2 or not np.isfinite(values).all() or not (np.diff(values[:, 0]) > 0).all():
        raise SimulationError(f"{motion.file}: poses need two rows or more, numbers only, and time_s that increases")
    path = values[:, 1:].copy()
    path[:, 2] = np.unwrap(np.radians(path[:, 2]))
    inside = np.clip(times_s, values[0, 0], values[-1, 0])  # at rest before the first row and after the last
    return np.asarray(PchipInterpolator(values[:, 0], path, axis=0)(inside))
