"""Refusal of results that would replace what they are made from."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from evaluator.errors import InputError


def refuse_to_replace(inputs: Iterable[Path], outputs: Iterable[Path]) -> None:
    """Raise InputError if an output is the same file as an input, by whatever name or link."""
    read = {identity: path for path in inputs if (identity := identity_of(path))}
    for output in outputs:
        if (identity := identity_of(output)) in read:
            raise InputError(
                f"{read[identity]}: is read, and {output} would replace it; write the results to another folder (-o)"
            )


def identity_of(path: Path) -> tuple[int, int] | None:
    """What all names of one file share; None for what is no file."""
    try:
        found = path.stat() if path.is_file() else None
    except (OSError, ValueError):  # no name of a file, such as the address of a stream
        return None
    return (found.st_dev, found.st_ino) if found else None
