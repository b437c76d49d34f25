"""What every command checks before it begins: its numbers, and that it replaces nothing that it reads."""

from __future__ import annotations

import math
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


UNLIMITED = ("seconds",)  # parameters that may be infinite


def checked(command: click.Command) -> click.Command:
    """The command, which refuses NaN, infinity, and output files that replace what it reads: a recording, a robot."""
    callback = command.callback
    if callback is None or hasattr(callback, "__is_checked__"):
        return command

    @wraps(callback)
    def safely(*args: Any, **given: Any) -> Any:
        _refuse_no_number(click.get_current_context())
        _refuse_overwriting(click.get_current_context())
        return callback(*args, **given)

    safely.__dict__["__is_checked__"] = True
    command.callback = safely
    return command


def _refuse_no_number(context: click.Context) -> None:
    """Raise BadParameter for an option that is NaN, which every comparison lets pass, or infinite, but for a limit."""
    for item in context.command.params:
        given = context.params.get(str(item.name))
        values = given if isinstance(given, tuple) else (given,)
        for value in (value for value in values if isinstance(value, float) and not math.isfinite(value)):
            if math.isnan(value) or item.name not in UNLIMITED:
                raise click.BadParameter(f"{value} is no number.", context, item)


def _refuse_overwriting(context: click.Context) -> None:
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
