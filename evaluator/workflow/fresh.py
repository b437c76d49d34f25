"""Commented templates of the files of a new experiment."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from evaluator.errors import InputError
from evaluator.files import write_text
from simulator.robot import shipped_robot_text

TEMPLATES = ("experiment.toml", "gauge.toml", "tracking.toml")


def new_experiment(folder: Path | str, robot: str = "barrel") -> list[Path]:
    """Write experiment.toml, gauge.toml, tracking.toml and robot.toml into a folder; return their paths.

    robot: name of a shipped robot. Raises InputError if one of the files exists already, SimulationError for a robot
    that is not shipped.
    """
    folder = Path(folder)
    contents = {name: (files("evaluator.templates") / name).read_text(encoding="utf-8") for name in TEMPLATES}
    contents["robot.toml"] = shipped_robot_text(robot)
    there = sorted(name for name in contents if (folder / name).exists())
    if there:
        raise InputError(f"{folder}: {', '.join(there)} exist already; give another folder")
    for name, text in contents.items():
        write_text(folder / name, text)
    return [folder / name for name in contents]
