"""Runs of a robot by its poses, without a simulation."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.interchange.commands import RunCommand
from evaluator.robot_geometry import stated_distances_mm
from simulator.command import Command
from simulator.robot import Robot, load_robot

HUSKY = load_robot(Path(__file__).parents[2] / "driven_robot" / "husky.toml")
COMMANDS = [(40.0, 60.0), (60.0, 40.0), (-40.0, -55.0), (50.0, 50.0), (30.0, -30.0), (-50.0, -35.0)]
TIME = np.arange(60) / 10  # of a lidar


def poses(
    number: int, *, speed: float = 0.9, turn: float = 0.3, positions: float = 1.0, headings: float = 1.0,
    robot: Robot = HUSKY,
) -> RunData:  # fmt: skip
    """A run that drives and turns by so much of its command, with positions and headings times a factor."""
    left, right = COMMANDS[number % len(COMMANDS)]
    rolled = 2 * np.pi * robot.driving_radius_mm / 60
    yaw = turn * rolled * (right - left) / robot.track_mm
    heading = 0.3 * number + yaw * TIME
    step = speed * rolled * (left + right) / 2 * 0.1
    way = np.cumsum(step * np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)
    rng = np.random.default_rng(number)
    middle = positions * (way + rng.normal(0.0, 0.002 * robot.track_mm, way.shape))
    angle = headings * (heading + rng.normal(0.0, 0.005, len(TIME)))
    half = stated_distances_mm([robot])[0] / 2 * np.column_stack([-np.sin(angle), np.cos(angle)])
    marks = np.concatenate([middle + half, middle - half], axis=1)
    return RunData(f"r{number}", left, right, 0.0, None, TIME, marks, number, from_poses=True)


def driven(seed: int, late_s: float, *, both_ways: bool = False) -> RunData:
    """A robot half a metre wide that follows a log of changes every 1.5 s, late; both_ways: backward as well."""
    rng = np.random.default_rng(seed)
    command = Command.steps([(1.5 * k, *rng.uniform(-40 if both_ways else 5, 40, 2)) for k in range(20)])
    time = np.arange(0, 30, 0.05)
    left, right = command.at(time - 0.05 - late_s)  # sums are of what was before
    heading = np.cumsum(0.03 * (right - left)) * 0.05
    way = np.cumsum(10.0 * (left + right) * np.exp(1j * heading)) * 0.05
    off = 100j * np.exp(1j * heading)
    marks = np.column_stack([(way + off).real, (way + off).imag, (way - off).real, (way - off).imag])
    marks += rng.normal(size=marks.shape)
    log = RunCommand(command, logged=True)
    return RunData(f"r{seed}", 30.0, 20.0, 0.0, None, time, marks, seed, log=log, from_poses=True)
