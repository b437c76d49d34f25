"""Refusal of results that would replace what they are made from."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from evaluator.errors import InputError
from evaluator.files.reading import quoted
from evaluator.files.writing import require_room_for

LONGEST_HEAD = 100_000  # characters of the line of names of a table


def refuse_to_replace(inputs: Iterable[Path], outputs: Iterable[Path]) -> None:
    """Raise InputError if an output is the same file as an input, by whatever name or link."""
    read = {identity: path for path in inputs if (identity := identity_of(path))}
    for output in outputs:
        if (identity := identity_of(output)) in read:
            raise InputError(
                f"{read[identity]}: is read, and {output} would replace it; write the results to another folder (-o)"
            )


def refuse_to_lose(output: Path, columns: Iterable[str]) -> None:
    """Raise InputError if an output exists and is no table of its own kind, which has these columns.

    A result that is computed again replaces the one before; a recording or notes of the same name are not lost to it.
    Raises UnwritableError if no file can be made there, before work of minutes is lost.
    """
    require_room_for(output)
    try:
        if not output.is_file():  # not there, or a device
            return
        with output.open(encoding="utf-8", errors="replace") as file:
            first = file.readline(LONGEST_HEAD)
            empty = not (first + file.read(1)).strip()
    except (OSError, ValueError):  # as unfit for writing
        return
    if not empty and not set(columns) <= set(first.strip().split(",")):
        raise InputError(
            f"{output}: exists, and is no table that this command writes (it begins {quoted(first.strip())}); give "
            "another name, or remove it"
        )


def identity_of(path: Path) -> tuple[int, int] | None:
    """What all names of one file share; None for what is no file."""
    try:
        found = path.stat() if path.is_file() else None
    except (OSError, ValueError):  # no name of a file, such as the address of a stream
        return None
    return (found.st_dev, found.st_ino) if found else None
