"""Reading an incomplete experiment file, so that recordings can be viewed before their commands are entered."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

from evaluator.errors import InputError
from evaluator.files import read_with


@dataclass(frozen=True)
class UnfinishedRun:
    """Properties needed to show the recording of a run; missing or invalid ones are None. Paths are absolute.

    robot: the name of a shipped one, or an absolute path.
    """

    id: str
    robot: str
    camera: Path | None
    video: Path | None
    corrections: Path | None
    rate_hz: float | None


@dataclass(frozen=True)
class Unfinished:
    """Properties of an experiment; runs with an id that cannot be a file name are omitted."""

    name: str
    robot: str
    tracking: Path | None
    runs: tuple[UnfinishedRun, ...]


def read_unfinished(experiment: Path) -> Unfinished:
    """Read an experiment.toml that need not be valid. Raises InputError if it is not TOML or names no robot."""
    return read_with(_load, experiment)


def run_of(experiment: Path, run_id: str) -> UnfinishedRun:
    """A run of an experiment.toml that need not be valid. Raises InputError if there is none of that id."""
    found = next((run for run in read_unfinished(experiment).runs if run.id == run_id), None)
    if found is None:
        raise InputError(f"there is no run {run_id} in this experiment")
    return found


def _load(path: Path) -> Unfinished:
    content, folder = tomllib.loads(path.read_text(encoding="utf-8")), path.resolve().parent
    robot, runs = _robot(folder, content.get("robot")), content.get("run")
    if robot is None:
        raise InputError(f"{path.name}: robot is missing; give a shipped robot or a robot.toml")
    rows = [row for row in runs if isinstance(row, dict)] if isinstance(runs, list) else []
    return Unfinished(
        str(content.get("name", path.stem)),
        robot,
        tracking=_path(folder, content.get("tracking")),
        runs=tuple(
            UnfinishedRun(
                id=str(row["id"]),
                robot=_robot(folder, row.get("robot")) or robot,
                camera=_path(folder, row.get("camera") or content.get("camera")),
                video=_path(folder, row.get("video")),
                corrections=_path(folder, row.get("corrections")),
                rate_hz=rate if isinstance(rate := row.get("rate_hz"), float | int) and rate > 0 else None,
            )
            for row in rows
            if Path(str(row.get("id", ""))).name == row.get("id")
        ),
    )


def _robot(folder: Path, name: object) -> str | None:
    if not isinstance(name, str):
        return None
    return str(folder / name) if name.endswith(".toml") else name


def _path(folder: Path, name: object) -> Path | None:
    return folder / name if isinstance(name, str) and name else None
