"""All effects by id: every module of this folder that declares an EFFECT, and user-defined ones.

A new effect of the catalogue is its file and nothing else.
"""

from __future__ import annotations

import difflib
import math
import pkgutil
from collections import ChainMap
from collections.abc import Iterator, Mapping, Sequence
from importlib import import_module
from types import MappingProxyType

import simulator.effects
from simulator.effects import free_form
from simulator.effects.definition import Effect
from simulator.effects.entry import EffectEntry


def _declared() -> Iterator[Effect]:
    package = simulator.effects
    for module in pkgutil.iter_modules(package.__path__, f"{package.__name__}."):
        effect = getattr(import_module(module.name), "EFFECT", None)
        if effect is not None:
            yield effect


BUILT_IN: Mapping[str, Effect] = MappingProxyType({effect.id: effect for effect in _declared()})
OWN: dict[str, Effect] = {}  # the user's, read from files or installed packages: simulator.own_effects
EFFECTS: Mapping[str, Effect] = ChainMap(OWN, dict(BUILT_IN))


def effect_values(entry: EffectEntry) -> dict[str, float]:
    """All parameters of one valid [[effect]]; those not given have the value at which the effect vanishes."""
    return EFFECTS[entry.id].absent() | {name: float(value) for name, value in entry.given.items()}


def faults_of_effects(entries: Sequence[EffectEntry]) -> list[str]:
    """Errors in the [[effect]] entries of a robot, one phrase each."""
    faults = [fault for entry in entries for fault in _faults(entry)]
    ids = [entry.id for entry in entries if entry.id != free_form.ID]
    return faults + [f"effect {id_} is defined twice" for id_ in sorted(set(ids)) if ids.count(id_) > 1]


def nearest_effect(id_: str) -> str | None:
    """The valid effect id that is most similar to a misspelt one; None if none is similar."""
    return next(iter(difflib.get_close_matches(id_, [*EFFECTS, free_form.ID], n=1, cutoff=0.4)), None)


def _faults(entry: EffectEntry) -> Iterator[str]:
    given = entry.given
    if entry.id == free_form.ID:
        yield from free_form.faults(given)
        return
    if entry.id not in EFFECTS:
        near = nearest_effect(entry.id)
        own = (
            f"a user-defined effect is read from effects/{entry.id}.toml beside the robot file, or from a Python file "
            "that the environment variable TURNSCOPE_EFFECTS names"
        )
        yield f"unknown effect {entry.id}; " + (f"did you mean {near}? " if near else "") + own
        return
    parameters = {parameter.name: parameter for parameter in EFFECTS[entry.id].parameters}
    if not given:
        yield f"effect {entry.id} has no parameters; it takes {', '.join(parameters)}"
    for name, value in given.items():
        if name not in parameters:
            near = next(iter(difflib.get_close_matches(name, parameters, n=1, cutoff=0.4)), None)
            hint = f"; did you mean {near}?" if near else f"; it takes {', '.join(parameters)}"
            yield f"effect {entry.id} has no parameter {name}{hint}"
        elif isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            yield f"effect {entry.id}: {name} = {value!r} is not a finite number"
        elif value < parameters[name].at_least:
            yield f"effect {entry.id}: {name} = {value:g} must be at least {parameters[name].at_least:g}"
