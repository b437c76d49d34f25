"""Single values of gauge.toml and robot.toml for forms; comments are kept."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from evaluator.errors import InputError
from evaluator.files import explain
from evaluator.settings import MeasuredRobot, load_measured
from evaluator.workflow.editing.documents import replace_text, version_of
from evaluator.workflow.editing.robots import robot_file, write_robot
from evaluator.workflow.editing.unfinished import read_unfinished
from simulator.robot import Robot, load_robot, shipped_robot_text

Place = Sequence[str | int]
ELSEWHERE = ("format", "effect")  # not chosen by the user; effects have sliders in the sandbox


@dataclass(frozen=True)
class Values:
    """All values of a file. each: keys and indices of the path to a value, and the value."""

    path: Path
    version: str
    each: tuple[tuple[Place, str | float | bool], ...]


def gauge_values(path: Path) -> Values:
    """Values of a gauge.toml. Raises InputError if it is not TOML."""
    return Values(path, version_of(path), _each(_read(path)))


def set_gauge_value(path: Path, version: str, place: Place, value: object) -> Values:
    """Change a value of a gauge.toml, or remove it or its table (None).

    Raises ChangedMeanwhileError, and InputError for an invalid gauge.
    """
    from calibration.gauge.geometry import Gauge, load_gauge

    text = _with_value(_read(path), place, value)
    _check(text, Gauge.model_validate, load_gauge)
    replace_text(path, version, text)
    return gauge_values(path)


def robot_values(experiment: Path) -> Values:
    """Values of the robot file of an experiment, without its effects. Raises InputError."""
    there = robot_file(experiment)
    return Values(there.path, there.version, _each(_robot_text(experiment)))


def set_robot_value(experiment: Path, version: str, place: Place, value: object) -> Values:
    """Change a value of the robot of an experiment, or remove it or its table (None).

    If the experiment names a shipped robot, it is copied to a file. Raises ChangedMeanwhileError, and InputError for
    an invalid robot.
    """
    text = _with_value(_robot_text(experiment), place, value)
    if "slip" in tomllib.loads(text):
        _check(text, Robot.model_validate, load_robot)
    else:  # enough to measure with
        _check(text, MeasuredRobot.model_validate, load_measured)
    write_robot(experiment, text, version)
    return robot_values(experiment)


def _robot_text(experiment: Path) -> str:
    name = read_unfinished(experiment).robot
    return _read(Path(name)) if name.endswith(".toml") else shipped_robot_text(name)


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path.name}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path.name}: not a text file") from error


def _each(text: str) -> tuple[tuple[Place, str | float | bool], ...]:
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"not valid TOML: {error}; correct it in a text editor") from error
    return tuple(_below((), {key: value for key, value in content.items() if key not in ELSEWHERE}))


def _below(place: tuple[str | int, ...], content: Any) -> Iterator[tuple[Place, str | float | bool]]:
    if isinstance(content, dict | list):
        for key, value in content.items() if isinstance(content, dict) else enumerate(content):
            yield from _below((*place, key), value)
    elif isinstance(content, str | bool | int | float):
        yield place, content


def _with_value(text: str, place: Place, value: object) -> str:
    import tomlkit

    document: Any = tomlkit.parse(text)
    *way, last = place
    table = document
    try:
        for key in way:
            table = table[key]
        if value is None:
            del table[last]
        else:
            # A whole number stays an integer only if the file has one: 2.0 mm may become 2.5, 17 dots never 17.5.
            table[last] = float(value) if isinstance(table[last], float) and isinstance(value, int) else value
    except (LookupError, TypeError) as error:
        raise InputError("this value is no longer in the file; see the newer version") from error
    return tomlkit.dumps(document)


def _check(text: str, validated: Callable[[Any], object], load: Callable[[Path], object]) -> None:
    try:
        validated(tomllib.loads(text))
    except ValidationError as error:
        raise InputError(explain(error, load)) from error
