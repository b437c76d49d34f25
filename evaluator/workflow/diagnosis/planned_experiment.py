"""A planned experiment as files: experiment.toml without recordings yet, and the command file of each run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from evaluator.errors import InputError
from evaluator.files import named_from, write_text
from simulator.robot import shipped_robots

START_S = 0.5  # motors on in the time of the recording: frames at rest determine the start pose
COMMANDS = "commands"  # folder of the command files, beside experiment.toml


class PlannedRun(Protocol):
    """A planned run."""

    @property
    def left_rpm(self) -> float:
        """Of the left driving wheel."""

    @property
    def right_rpm(self) -> float:
        """Of the right driving wheel."""

    @property
    def duration_s(self) -> float:
        """Time for which the motors are on."""


def planned_files(output: Path | str, runs: int) -> list[Path]:
    """Paths of an experiment.toml and of the command files r01.csv and so on of its runs.

    Raises InputError if one exists already, so that this is reported before a plan is computed.
    """
    output = Path(output)
    paths = [output, *(output.parent / COMMANDS / f"r{number:02d}.csv" for number in range(1, runs + 1))]
    for path in paths:
        if path.exists():
            raise InputError(f"{path} exists already; give another name or folder, or remove it")
    return paths


def write_planned(
    runs: Sequence[PlannedRun],
    name: str,
    robot: str,
    output: Path | str,
    starts_mm_deg: Sequence[tuple[float, float, float]] = (),
) -> list[Path]:
    """Write an experiment.toml and a command file for each of its runs; return the paths, that of the experiment first.

    robot: a shipped name, or a file. starts_mm_deg: start pose of every run, or none: x and y of the robot's centre on
    the plate, and heading. Raises InputError if one of the files exists already; then none is written.
    """
    output, *logs = planned_files(output, len(runs))
    if robot not in shipped_robots():
        robot = named_from(output.parent, Path(robot))
    lines = [
        f"# {COMMANDS}/r01.csv and so on: each command for the program that drives the robot, time_s from its start.",
        *("format = 1", f'name = "{name}"', f'robot = "{robot}"', 'camera = "camera.json"'),
    ]
    for number, (run, log) in enumerate(zip(runs, logs, strict=True)):
        lines += ["", "[[run]]", f'id = "{log.stem}"']
        if starts_mm_deg:
            x, y, heading = starts_mm_deg[number]
            lines.append(f"# Put the robot's centre at x = {x:z.1f} mm, y = {y:z.1f} mm, heading {heading:g} degrees.")
        lines += [
            *(f"left_rpm = {run.left_rpm:g}", f"right_rpm = {run.right_rpm:g}"),
            *(f"start_s = {START_S:g}", f"stop_s = {START_S + run.duration_s:g}", f'video = "{log.stem}.mp4"'),
        ]
        rows = [(0.0, run.left_rpm, run.right_rpm), (run.duration_s, 0.0, 0.0)]
        table = [f"{time:g},{left:g},{right:g}" for time, left, right in rows]
        write_text(log, "\n".join(["time_s,left_rpm,right_rpm", *table]) + "\n")
    write_text(output, "\n".join(lines) + "\n")
    return [output, *logs]
