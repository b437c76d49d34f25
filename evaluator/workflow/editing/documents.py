"""Edits of single values of a TOML file; comments and order are kept, and a concurrent change is never lost."""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Callable
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any

from evaluator.errors import InputError
from evaluator.files import toml_fault, write_text

if TYPE_CHECKING:
    from tomlkit import TOMLDocument

Load = Callable[[Path], Any]
_WRITING = Lock()  # in this process, nobody else writes between reading a version and writing the next


class ChangedMeanwhileError(InputError):
    """A file is no longer the version that a change was made for."""


def version_of(path: Path) -> str:
    """The version of a file: a hash of its content; "" if there is no file."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()[:20]
    except FileNotFoundError:
        return ""


def read_document(path: Path) -> tuple[TOMLDocument, str]:
    """The content of a TOML file with its comments, and its version. Raises InputError."""
    import tomlkit
    from tomlkit.exceptions import ParseError

    try:
        content = path.read_bytes()
        text = content.decode("utf-8")
        tomllib.loads(text)  # for the same error messages as in other commands
        return tomlkit.parse(text), hashlib.sha256(content).hexdigest()[:20]
    except FileNotFoundError as error:
        raise InputError(f"{path.name}: no such file") from error
    except tomllib.TOMLDecodeError as error:
        raise InputError(
            f"{path.name}: not valid TOML: {toml_fault(error, text)}; correct it in a text editor"
        ) from error
    except (UnicodeDecodeError, ParseError) as error:
        raise InputError(f"{path.name}: not valid TOML: {error}; correct it in a text editor") from error


def change_document(path: Path, version: str, change: Callable[[TOMLDocument], None]) -> str:
    """Change a TOML file of a known version; return its new version.

    Raises ChangedMeanwhileError if the file has changed, and InputError if it cannot be read.
    """
    import tomlkit

    with _WRITING:
        _, current = read_document(path)
        _refuse_other(path, version, current)
        # Comments at the end of the file belong to no table, and must be kept if the last table is removed.
        text, ending = _without_ending(path.read_text(encoding="utf-8"))
        document = tomlkit.parse(text)
        change(document)
        write_text(path, tomlkit.dumps(document).rstrip("\n") + "\n" + ending)
        return version_of(path)


def replace_text(path: Path, version: str, text: str) -> str:
    """Replace a text file of a known version ("" for a new one); return its new version."""
    with _WRITING:
        _refuse_other(path, version, version_of(path))
        write_text(path, text)
        return version_of(path)


def _without_ending(text: str) -> tuple[str, str]:
    """The text of a file, and the blank lines and comments at its end."""
    lines = text.splitlines(keepends=True)
    count = len(lines)
    while count and (not lines[count - 1].strip() or lines[count - 1].lstrip().startswith("#")):
        count -= 1
    return "".join(lines[:count]), "".join(lines[count:])


def _refuse_other(path: Path, version: str, current: str) -> None:
    if version != current:
        raise ChangedMeanwhileError(
            f"{path.name} was changed meanwhile, in another tab or by another program; "
            "what is shown now is the newer version: make your change again"
        )
