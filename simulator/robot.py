"""The robot of robot.toml: the nominal robot and the effects added to it."""

from __future__ import annotations

import difflib
import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Any, Self

from pydantic import field_validator, model_validator

from simulator.effects.catalogue import EFFECTS, faults_of_effects
from simulator.effects.entry import EffectEntry
from simulator.errors import SimulationError
from simulator.nominal_robot import NominalRobot
from simulator.own_effects.files import load_beside, load_installed, load_named
from simulator.units import in_standard_units

UNITS_BY_SUFFIX = ("mm", "mN", "rpm")  # units of parameters that may be given in another of their kind


class Robot(NominalRobot):
    """A robot with its effects."""

    effect: tuple[EffectEntry, ...] = ()  # added physical effects

    @field_validator("effect", mode="before")
    @classmethod
    def _in_units_of_the_catalogue(cls, entries: Any) -> Any:
        return [_entry_in_standard_units(item) for item in entries] if isinstance(entries, list | tuple) else entries

    def __repr__(self) -> str:
        """One line: the name, the wheels, the marks and the effects."""
        effects = ", ".join(entry.id for entry in self.effect) or "none"
        return (
            f"Robot({self.name}: {len(self.all_wheels)} wheels, marks {', '.join(mark.name for mark in self.layout)}, "
            f"effects {effects})"
        )

    __str__ = __repr__

    @model_validator(mode="after")
    def _known_effects(self) -> Self:
        if faults := faults_of_effects(self.effect):
            raise ValueError("; ".join(faults))
        return self


def _entry_in_standard_units(entry: Any) -> Any:
    """An [[effect]] of a file with its parameters converted to the units of the catalogue."""
    effect = EFFECTS.get(str(entry.get("id"))) if isinstance(entry, dict) else None
    if effect is None:
        return entry
    names = [parameter.name for parameter in effect.parameters if parameter.unit in UNITS_BY_SUFFIX]
    return in_standard_units(entry, names)


def shipped_robots() -> tuple[str, ...]:
    """Names of the robots that come with turnscope."""
    return tuple(sorted(path.name.removesuffix(".toml") for path in _folder().iterdir() if path.name.endswith(".toml")))


def load_robot(name_or_path: str | Path) -> Robot:
    """Read a shipped robot by name or any robot.toml by path.

    Also loads the user's effects: in the folder `effects` beside the file, named in TURNSCOPE_EFFECTS, and of installed
    packages if the robot has an effect that is not known otherwise. Raises SimulationError for an unknown name
    and for a faulty effect, else OSError, tomllib.TOMLDecodeError, pydantic.ValidationError.
    """
    text = str(name_or_path)
    if text not in shipped_robots() and (text.endswith(".toml") or Path(text).exists()):
        content = Path(text).read_text(encoding="utf-8")
        load_beside(Path(text).parent)
    else:
        content = shipped_robot_text(text)
    load_named()
    table = tomllib.loads(content)
    if _ids(table) - EFFECTS.keys():
        load_installed()
    return Robot.model_validate(table)


def _ids(table: dict[str, Any]) -> set[str]:
    """Ids of the [[effect]] of a robot file."""
    entries = table.get("effect")
    listed = entries if isinstance(entries, list) else []
    return {str(entry.get("id")) for entry in listed if isinstance(entry, dict)}


def shipped_robot_text(name: str) -> str:
    """The robot.toml of a shipped robot, with its comments. Raises SimulationError for an unknown name."""
    if name not in shipped_robots():
        near = difflib.get_close_matches(name, shipped_robots(), n=1)
        hint = f"did you mean {near[0]}? " if near else ""
        raise SimulationError(
            f"{name}: no such robot; {hint}shipped are {', '.join(shipped_robots())}, or give a .toml file"
        )
    return (_folder() / f"{name}.toml").read_text(encoding="utf-8")


def _folder() -> Path:
    return Path(str(files("simulator") / "robots"))
