"""Every key of every file that users write or read, as a page: made from the models that check these files.

    python -m evaluator.templates.formats        writes evaluator/formats.md

What a table is for is the docstring of its model; a note on a key is the comment beside the field, or its description.
"""

from __future__ import annotations

import ast
import dataclasses
import inspect
import io
import textwrap
import tokenize
import types
from collections.abc import Iterator
from enum import Enum
from fractions import Fraction
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import annotated_types
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from evaluator.files import write_text

PAGE = Path(__file__).parents[1] / "formats.md"
COMMAND = "python -m evaluator.templates.formats"
HEAD = f"""# File formats

Every key of the files that you write and of camera.json and turning.csv, made by `{COMMAND}` from the models that check
these files. `turnscope new` writes commented templates. Required keys must be given. A key that is not listed is an
error that names the nearest one. A table that several files share is listed where it comes first. Paths are relative to
the file in which they stand. Lengths are in mm on the plate unless a key ends in another unit;
[model and axes](../simulator/README.md), [words](README.md#words).
"""
PLAIN = {float: "number", int: "whole number", str: "text", bool: "true or false", Path: "path", Fraction: "number"}


def page() -> str:
    """The whole page."""
    from calibration.gauge.geometry import Gauge
    from calibration.store import CameraFile
    from evaluator.settings import Experiment
    from evaluator.tracking.settings import TrackingSettings
    from simulator.rendering.scene import GaugeScene, Scene
    from simulator.robot import Robot
    from simulator.sweep import Sweep

    files: list[tuple[str, str, list[type[BaseModel]]]] = [
        ("experiment.toml", "Which robot, which camera, which runs.", [Experiment]),
        ("robot.toml", "The robot; for measuring alone, marks are enough.", [Robot]),
        ("gauge.toml", "The dot gauge of a calibration.", [Gauge]),
        ("tracking.toml", "What to say about the marks where a recording does not show it.", [TrackingSettings]),
        ("scene.toml", "What `turnscope render` draws: a run, or a gauge.", [Scene, GaugeScene]),
        ("sweep.toml", "What `turnscope sweep` simulates.", [Sweep]),
        ("camera.json", "What `turnscope calibrate` writes.", [CameraFile]),
    ]
    parts, met = [HEAD], set[type[BaseModel]]()
    for name, purpose, models in files:
        parts += [f"## {name}", purpose]
        for root, table in [pair for model in models for pair in _tables(model, _place_of(model), met)]:
            parts += [_table(root, table)]
        parts += [_effects()] if name == "robot.toml" else []
    return "\n\n".join([*(part.strip() for part in parts), _turning()]) + "\n"


def _place_of(model: type[BaseModel]) -> str:
    """Where a model stands in its file: "" for the whole file."""
    places: dict[str, str] = {"GaugeScene": 'kind = "gauge"', "Scene": 'kind = "run"'}
    return places.get(model.__name__, "")


def _tables(model: type[BaseModel], place: str, met: set[type[BaseModel]]) -> Iterator[tuple[str, type[BaseModel]]]:
    """A model and all models below it with their places, without those met before."""
    ahead = [(place, model)]
    while ahead:
        where, table = ahead.pop(0)
        if table in met:
            continue
        met.add(table)
        yield where, table
        for name, item in table.model_fields.items():
            within = where.strip("[]") + "." if where.startswith("[") else ""
            for below, many in _models_of(item.annotation):
                key = f"{within}{name}"
                ahead.append((f"[[{key}]]" if many == "list" else f"[{key}{'.NAME' if many == 'dict' else ''}]", below))


def _models_of(annotation: Any, many: str = "") -> Iterator[tuple[type[BaseModel], str]]:
    """Models that a type holds, and whether as a "list", a "dict" or by themselves."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation, many
        return
    origin, parts = get_origin(annotation), get_args(annotation)
    kinds: dict[Any, str] = {tuple: "list", list: "list", dict: "dict"}
    inside = kinds.get(origin, many)
    for item in parts if origin is not Literal else ():
        yield from _models_of(item, inside)


def _table(place: str, model: type[BaseModel]) -> str:
    """One table of a file: what it is for, and a row per key."""
    title = f"### `{place}`\n\n" if place else ""
    notes = notes_of(model)
    rows = "".join(
        f"| `{name}` | {_type(item.annotation, item.metadata)} | {_default(item)} | "
        f"{item.description or notes.get(name, '')} |\n"
        for name, item in model.model_fields.items()
    )
    return f"{title}{_prose(model)}\n\n| key | value | default | |\n|---|---|---|---|\n{rows}"


def _prose(model: type) -> str:
    """Docstring as one paragraph for each of its own."""
    return "\n\n".join(" ".join(part.split()) for part in (inspect.getdoc(model) or "").split("\n\n"))


def notes_of(model: type) -> dict[str, str]:
    """Comments beside the fields of a class and of those that it inherits from, by field."""
    found: dict[str, str] = {}
    for owner in reversed(model.__mro__):
        if owner.__module__.split(".")[0] not in ("calibration", "simulator", "evaluator"):
            continue
        source = textwrap.dedent(inspect.getsource(owner))
        comments = {
            token.start[0]: token.string.lstrip("# ")
            for token in tokenize.generate_tokens(io.StringIO(source).readline)
            if token.type == tokenize.COMMENT
        }
        (tree,) = ast.parse(source).body
        for item in tree.body if isinstance(tree, ast.ClassDef) else ():
            if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name) and item.lineno in comments:
                found[item.target.id] = comments[item.lineno]
    return found


def _type(annotation: Any, metadata: list[Any]) -> str:  # noqa: PLR0911  # one return a kind of type
    """A type in words: number > 0, text, one of some words, [number, number]."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        held = [item for part in parts[1:] for item in (part.metadata if isinstance(part, FieldInfo) else [part])]
        return _type(parts[0], [*held, *metadata])
    if origin in (Union, types.UnionType):
        return " or ".join(_type(part, metadata) for part in parts if part is not type(None))
    if origin is Literal:
        return ", ".join(f"`{_toml(part)}`" for part in parts)
    if origin is tuple and parts[-1] is not Ellipsis:
        return f"[{', '.join(_type(part, []) for part in parts)}]"
    if origin in (tuple, list):
        models = list(_models_of(parts[0]))
        return "tables" if models else f"list of {_type(parts[0], [])}"
    if origin is dict:
        return "tables by name" if list(_models_of(parts[1])) else f"{_type(parts[1], [])} by name"
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return "table"
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        return ", ".join(f"`{_toml(item.value)}`" for item in annotation)
    word = PLAIN.get(annotation, getattr(annotation, "__name__", "value"))
    return " ".join([word, *_bounds(metadata)])


def _bounds(metadata: list[Any]) -> list[str]:
    """Bounds of a number in signs."""
    signs = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}
    limits = (annotated_types.Gt, annotated_types.Ge, annotated_types.Lt, annotated_types.Le)
    return [
        f"{sign} {getattr(item, name):g}"
        for name, sign in signs.items()
        for item in metadata
        if isinstance(item, limits) and hasattr(item, name)
    ]


def _default(item: FieldInfo) -> str:
    """Default of a field as it would be written; "" where a file may leave it out and nothing is then said."""
    if item.is_required():
        return "required"
    value = item.get_default(call_default_factory=True, validated_data={})
    if value is None or value in ((), {}) or isinstance(value, BaseModel):
        return ""
    if isinstance(value, dict) and all(isinstance(below, BaseModel) for below in value.values()):
        return ", ".join(value)
    return f"`{_toml(value)}`"


def _toml(value: Any) -> str:
    """A plain value as TOML writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (str, Path)):
        return f'"{value}"'
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return f"{float(value):g}" if isinstance(value, (float, Fraction)) else str(value)


def _effects() -> str:
    """Ids and parameters of [[effect]]."""
    from simulator.effects.catalogue import BUILT_IN

    rows = [
        f"| `{effect.id}` | {', '.join(f'`{item.name}` ({item.absent:g})' for item in effect.parameters)} |"
        for effect in BUILT_IN.values()
    ]
    head = "### Ids of `[[effect]]`\n\nIn brackets: the value at which an effect vanishes, and the default."
    return f"{head} `turnscope effects` draws each.\n\n| id | parameters |\n|---|---|\n" + "\n".join(rows)


def _turning() -> str:
    """Columns of turning.csv."""
    from evaluator.turning import Turning

    elsewhere = "phases", "other_wheels"  # a table of its own, columns by the names of the wheels
    names = [item.name for item in dataclasses.fields(Turning) if item.name not in elsewhere]
    columns = ", ".join(f"`{name}`" for name in names)
    return f"## turning.csv\n\nA row per run. {_prose(Turning)}\n\nColumns: `run`, `left_rpm`, `right_rpm`, {columns}."


if __name__ == "__main__":
    write_text(PAGE, page())
