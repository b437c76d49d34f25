"""Effects of the user: a TOML file of terms, or a Python file that declares an EFFECT like those of simulator.effects.

    format = 1
    id = "mixed-drive"
    name = "the drive mixes the sides"
    sentence = "…"                  # what it does, with its parameters

    [[term]]
    channel = "left_drive"          # where it acts: simulator.dynamics.terms.CHANNELS
    depends_on = "right_command"    # quantity that it is multiplied by: simulator.dynamics.terms.BASES
    pattern = "common"              # of wheel channels: simulator.dynamics.terms.PATTERNS
    coefficient = "right_to_left"   # name of the parameter; terms may share one
    times = 1.0                     # factor of this term
    unit = ""                       # of the parameter, for display
    low = -1.0                      # bounds of a fit
    high = 1.0
    step = 0.01                     # a small change that is visible in the marks
    begin = 0.2                     # additional initial value of a fit, from an earlier fit

Parameters are 0 by default, where the effect vanishes. Entry points of the group turnscope.effects also provide
effects. A Python file is executed only if the user names it: by an option, or in the variable TURNSCOPE_EFFECTS.
"""

from __future__ import annotations

import difflib
import importlib.util
import math
import os
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from simulator.dynamics.terms import BASES, CHANNELS, Term, is_of_plate
from simulator.effects.catalogue import BUILT_IN, OWN
from simulator.effects.definition import Effect, Values
from simulator.effects.draft import Draft
from simulator.effects.free_form import faults as faults_of_term
from simulator.effects.free_form import scale_of_channel
from simulator.effects.parameter import UNITS, Parameter, Unit
from simulator.effects.view import View
from simulator.errors import SimulationError
from simulator.files.named import named_in

FOLDER = "effects"  # beside an experiment or a robot file
NAMED = "TURNSCOPE_EFFECTS"  # environment variable: files of effects, separated as in PATH
GROUP = "turnscope.effects"
ID_FORM = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")
_KEYS = ("format", "id", "name", "sentence", "law", "source", "limits", "term")
_TERM_KEYS = (
    "channel",
    "depends_on",
    "pattern",
    "coefficient",
    "times",
    "unit",
    "low",
    "high",
    "step",
    "shown",
    "begin",
)
_sources: dict[str, Path] = {}


def load_own(path: Path) -> Effect:
    """Read an effect from a TOML or a Python file and register it in this process.

    A Python file is executed: load only files that the user has named. Raises SimulationError and OSError.
    """
    effect = _from_python(path) if path.suffix == ".py" else _from_toml(path)
    if effect.id in BUILT_IN:
        raise SimulationError(f"{path}: id {effect.id} is an effect of the catalogue; choose another id")
    OWN[effect.id] = effect
    _sources[effect.id] = path
    return effect


def load_beside(folder: Path) -> tuple[str, ...]:
    """Load the TOML files in the subfolder `effects` of a folder; returns the ids of their effects."""
    return tuple(load_own(named_in(path, path.name)).id for path in sorted((folder / FOLDER).glob("*.toml")))


def load_named() -> tuple[str, ...]:
    """Load the files that the environment variable TURNSCOPE_EFFECTS names; returns the ids of their effects."""
    return tuple(load_own(Path(name)).id for name in os.environ.get(NAMED, "").split(os.pathsep) if name)


def load_installed() -> tuple[str, ...]:
    """Load effects of installed packages (entry points turnscope.effects); returns ids. Raises SimulationError."""
    found = []
    for point in entry_points(group=GROUP):
        effect = point.load()
        if not isinstance(effect, Effect):
            raise SimulationError(f"entry point {point.name} of {GROUP} is no Effect; it is a {type(effect).__name__}")
        if effect.id in BUILT_IN:
            raise SimulationError(f"entry point {point.name} of {GROUP}: {effect.id} is an effect of the catalogue")
        OWN[effect.id] = effect
        found.append(effect.id)
    return tuple(found)


def forget_own() -> None:
    """Unregister all effects of the user."""
    OWN.clear()
    _sources.clear()


def is_built_in(effect: str) -> bool:
    """Whether an effect belongs to the catalogue."""
    return effect in BUILT_IN


def is_own(effect: str) -> bool:
    """Whether an effect is one of the user that has been loaded."""
    return effect in OWN


def file_of(effect: str) -> Path | None:
    """The file of an effect of the user; None for other effects."""
    return _sources.get(effect)


def text_of(effect: str) -> str:
    """What defines an effect of the user: the content of its file, or its id if an installed package provides it."""
    source = file_of(effect)
    return effect if source is None else source.read_text(encoding="utf-8")


def _from_python(path: Path) -> Effect:
    spec = importlib.util.spec_from_file_location(f"own_effect_{path.stem.replace('-', '_')}", path)
    if spec is None or spec.loader is None or not path.is_file():
        raise SimulationError(f"{path}: no such file")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        raise SimulationError(f"{path}: running it failed ({type(error).__name__}: {error})") from error
    effect = getattr(module, "EFFECT", None)
    if not isinstance(effect, Effect):
        raise SimulationError(f"{path}: no EFFECT = Effect(…) in it; see turnscope effects new ID --python")
    return effect


def _from_toml(path: Path) -> Effect:
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SimulationError(f"{path}: not valid TOML ({error})") from error
    if faults := faults_of_content(content):
        raise SimulationError(f"{path}: {'; '.join(faults)}")
    return effect_of(content)


def faults_of_content(content: Mapping[str, Any]) -> list[str]:
    """Errors in the content of an effect's file, one phrase each."""
    return list(_faults(content))


def effect_of(content: Mapping[str, Any]) -> Effect:
    """The effect of a file's valid content."""
    rows = content["term"]
    first = {row["coefficient"]: row for row in reversed(rows)}  # only the first term needs step and bounds
    drive_or_force = [(row["coefficient"], _term(row)) for row in rows]
    felt = [item for item in drive_or_force if not item[1].is_seen_only]
    seen = [item for item in drive_or_force if item[1].is_seen_only]

    def act(draft: Draft, values: Values) -> None:
        draft.add(*(_sized(term, values[name]) for name, term in felt))

    def view(view: View, values: Values) -> None:
        view.errors += tuple(_sized(term, values[name]) for name, term in seen if values[name])

    return Effect(
        id=content["id"],
        name=content["name"],
        sentence=content.get("sentence", content["name"]),
        law=content.get("law") or "; ".join(map(_law_of, rows)),
        source=content.get("source", "an effect of the user's own"),
        limits=content.get("limits", "as the user's file states"),
        kind="observation" if not felt else "dynamics",
        parameters=tuple(_parameter(first[name]) for name in dict.fromkeys(row["coefficient"] for row in rows)),
        act=act if felt else None,
        view=view if seen else None,
        of_plate=any(is_of_plate(CHANNELS[row["channel"]], BASES[row["depends_on"]]) for row in rows),
        sum_of=tuple(drive_or_force),
    )


def _sized(term: Term, value: float) -> Term:
    return Term(term.channel, term.basis, term.coefficient * value, term.pattern)


def _term(row: Mapping[str, Any]) -> Term:
    """The term with coefficient 1."""
    channel = CHANNELS[row["channel"]]
    size = float(row.get("times", 1.0)) * scale_of_channel(channel)
    return Term(channel, BASES[row["depends_on"]], size, row.get("pattern", "common"))


def _parameter(row: Mapping[str, Any]) -> Parameter:
    UNITS.setdefault(row.get("unit", ""), Unit("", row.get("unit", "")))  # any unit is shown as it is written
    step, low, high = float(row["step"]), float(row.get("low", -math.inf)), float(row.get("high", math.inf))
    return Parameter(
        *(row["coefficient"], row.get("unit", ""), 0.0, step, low, high), shown=row.get("shown"), begin=row.get("begin")
    )


def _law_of(row: Mapping[str, Any]) -> str:
    pattern = f" ({row['pattern']} wheels)" if row.get("pattern", "common") != "common" else ""
    factor = f"{row['times']:g}·" if row.get("times", 1.0) != 1.0 else ""
    return f"{row['channel']}{pattern} += {factor}{row['coefficient']}·{row['depends_on']}"


def _faults(content: Mapping[str, Any]) -> Iterator[str]:
    yield from _unknown(content, _KEYS, "")
    if content.get("format") != 1:
        yield f"format = {content.get('format')!r}; this program reads format = 1"
    id_ = content.get("id")
    if not (isinstance(id_, str) and ID_FORM.fullmatch(id_)):
        yield f"id = {id_!r}; it must be lower-case letters, digits and hyphens, such as mixed-drive"
    for key in ("name", "sentence", "law", "source", "limits"):
        if not isinstance(content.get(key, "" if key != "name" else None), str):
            yield f"{key} = {content.get(key)!r} must be text"
    rows = content.get("term")
    if not isinstance(rows, list) or not rows or not all(isinstance(row, dict) for row in rows):
        yield "it needs at least one [[term]]"
        return
    named: set[str] = set()
    for number, row in enumerate(rows, 1):
        where = f"term {number}: "
        yield from _unknown(row, _TERM_KEYS, where)
        yield from (where + fault for fault in _faults_of_row(row, named))
        named.add(str(row.get("coefficient")))


def _faults_of_row(row: Mapping[str, Any], named: set[str]) -> Iterator[str]:
    given = {"channel": row.get("channel"), "basis": row.get("depends_on"), "pattern": row.get("pattern", "common")}
    for fault in faults_of_term({**given, "coefficient": 1.0}):
        yield fault.removeprefix("effect free-form: ").replace("basis", "depends_on")
    name = row.get("coefficient")
    if not (isinstance(name, str) and re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name)):
        yield f"coefficient = {name!r} must be the name of a parameter"
    if not isinstance(row.get("unit", ""), str):
        yield f"unit = {row['unit']!r} must be text"
    keys = ("times", "low", "high", "step", "shown", "begin")
    numbers = [key for key in keys if key in row and not _is_number(row[key])]
    yield from (f"{key} = {row[key]!r} is not a finite number" for key in numbers)
    if name in named:
        return  # unit, step and bounds of a parameter that terms share stand with the first of them
    if "step" not in row:
        yield "step is missing: the smallest change of the coefficient that is visible in the marks"
    elif not numbers and row["step"] <= 0:
        yield f"step = {row['step']} must be more than 0"
    if not numbers and not row.get("low", -math.inf) <= 0.0 <= row.get("high", math.inf):
        yield "low and high must include 0, where the effect vanishes"
    elif not numbers and not row.get("low", -math.inf) <= row.get("begin", 0.0) <= row.get("high", math.inf):
        yield f"begin = {row['begin']} must lie within low and high"


def _unknown(table: Mapping[str, Any], known: Sequence[str], where: str) -> Iterator[str]:
    for key in table:
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1, cutoff=0.4)
            yield f"{where}unknown key {key}" + (f"; did you mean {near[0]}?" if near else "")


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
