"""Refusal of output files that a command reads as well, or that it would write twice."""

from __future__ import annotations

from collections.abc import Iterator
from functools import wraps
from pathlib import Path
from typing import Any

import click

# Parameters that name files to write, of all commands; the others name what is read.
WRITTEN = (
    *("out", "output", "overlay", "sheet", "explain", "annotate"),
    *("phases", "truth", "html", "watch_image", "write_effect"),
)


def without_overwriting(command: click.Command) -> click.Command:
    """The command, which refuses output files that replace what it reads: a recording, a robot file, a gauge file."""
    callback = command.callback
    if callback is None or hasattr(callback, "__wrapped_for_safety__"):
        return command

    @wraps(callback)
    def safely(*args: Any, **given: Any) -> Any:
        _refuse(click.get_current_context())
        return callback(*args, **given)

    safely.__dict__["__wrapped_for_safety__"] = True
    command.callback = safely
    return command


def _refuse(context: click.Context) -> None:
    """Raise InputError if an output is an input, by whatever name, or the same as another output."""
    named = {item.name: item for item in context.command.params if context.params.get(str(item.name))}
    outputs = {name: Path(context.params[name]) for name in WRITTEN if name in named}
    if not outputs:
        return
    from evaluator.errors import InputError
    from evaluator.files.overwriting import identity_of

    read = {identity_of(path): path for name in named if name not in WRITTEN for path in _paths(context.params[name])}
    written: dict[Path, str] = {}
    for name, path in outputs.items():
        option = named[name].opts[0]
        if (identity := identity_of(path)) and identity in read:
            raise InputError(f"{read[identity]}: is read, and {option} {path} would replace it; give another name")
        if (place := path.absolute()) in written:
            raise InputError(f"{path}: is named by {written[place]} and {option}; give each a name of its own")
        written[place] = option


def _paths(value: Any) -> Iterator[Path]:
    """All texts and paths among the values of a parameter, as paths."""
    if isinstance(value, str | Path):
        yield Path(value)
    elif isinstance(value, tuple):
        for item in value:
            yield from _paths(item)
