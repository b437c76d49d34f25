"""Adding effects to the robot file of an experiment, from a diagnosis or from the user."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from evaluator.errors import InputError
from evaluator.files import named_from, read_with, write_text
from evaluator.workflow.editing.documents import change_document, replace_text, version_of
from evaluator.workflow.editing.unfinished import read_unfinished
from simulator.effects.catalogue import faults_of_effects
from simulator.effects.entry import EffectEntry
from simulator.own_effects.files import FOLDER, file_of
from simulator.robot import load_robot, shipped_robot_text

OWN = "robot.toml"


@dataclass(frozen=True)
class RobotFile:
    """The robot file of an experiment, its version, and whether the experiment names it, not a shipped robot."""

    path: Path
    version: str
    named: bool


def robot_file(experiment: Path) -> RobotFile:
    """The file of the robot of an experiment, which need not exist. Raises InputError."""
    name = read_unfinished(experiment).robot
    if name.endswith(".toml"):
        return RobotFile(Path(name), version_of(Path(name)), named=True)
    path = experiment.resolve().parent / OWN
    if path.exists():
        path = path.with_name(f"robot-{experiment.stem}.toml")
    return RobotFile(path, version_of(path), named=False)


def write_robot(experiment: Path, text: str, version: str) -> RobotFile:
    """Write the robot of an experiment, and name the file in the experiment.

    version: of the robot file on which the text is based, "" if there is none. Raises ChangedMeanwhileError.
    """
    there = robot_file(experiment)
    beside = own_effects_for(there.path, text)
    replace_text(there.path, version, text)
    for path, content in beside.items():
        write_text(path, content)
    if not there.named:
        name = named_from(experiment.resolve().parent, there.path)

        def change(document: Any) -> None:
            document["robot"] = name

        change_document(experiment, version_of(experiment), change)
    return robot_file(experiment)


def own_effects_for(robot: Path, text: str) -> dict[Path, str]:
    """Missing files beside a robot's file for the user-defined effects in its text, with their contents.

    Other commands use a robot without an experiment, so its effects must be beside its file. Raises InputError if
    another effect of the same id exists there already.
    """
    found: dict[Path, str] = {}
    for effect in tomllib.loads(text).get("effect", []):
        source = file_of(str(effect.get("id")))
        target = robot.resolve().parent / FOLDER / f"{effect.get('id')}.toml"
        if source is None or source.suffix != ".toml" or source.resolve() == target:
            continue
        content = source.read_text(encoding="utf-8")
        if not target.exists():
            found[target] = content
        elif target.read_text(encoding="utf-8") != content:
            raise InputError(
                f"{FOLDER}/{target.name} beside {robot.name} is another effect than the one beside the experiment; "
                "choose another id for one of them, or take one away"
            )
    return found


def with_effects(experiment: Path, effects: Mapping[str, Mapping[str, Any]]) -> str:
    """The text of an experiment's robot with effects, which replace those of the same id; comments are kept.

    Raises InputError for invalid effects.
    """
    import tomlkit

    entries = [EffectEntry.model_validate({"id": id_, **values}) for id_, values in effects.items()]
    if faults := faults_of_effects(entries):
        raise InputError("; ".join(faults))
    name = read_unfinished(experiment).robot
    text = Path(name).read_text(encoding="utf-8") if name.endswith(".toml") else shipped_robot_text(name)
    document = tomlkit.parse(text)
    if "effect" not in document:
        document.append("effect", tomlkit.aot())
    tables: Any = document["effect"]
    for id_, values in effects.items():
        for table in [one for one in tables if one.get("id") == id_ and id_ != "free-form"]:
            tables.remove(table)
        added = tomlkit.table()
        for key, value in {"id": id_, **values}.items():
            added[key] = value
        tables.append(added)
    return tomlkit.dumps(document)


def effects_of(experiment: Path) -> list[dict[str, Any]]:
    """The [[effect]] entries of an experiment's robot."""
    robot = read_with(load_robot, Path(read_unfinished(experiment).robot))
    return [{"id": entry.id, **entry.given} for entry in robot.effect]
