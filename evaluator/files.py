"""Files at the edge: whole or not at all, and read with one clear sentence where they are wrong."""

from __future__ import annotations

import difflib
import os
import tempfile
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from evaluator.errors import InputError

if TYPE_CHECKING:  # pandas takes long to import, and reading a TOML file does not need it
    import pandas as pd

Value = TypeVar("Value")


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Give a temporary name beside path and rename it to path when the block ends without an error.

    The suffix is kept, so that encoders choose their format by it. What stood at path stays until the rename.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{path.stem}.", suffix=path.suffix, dir=path.parent)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)  # mkstemp makes private files; a result is as readable as any other file
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a text file whole or not at all."""
    with written_whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_table(table: pd.DataFrame, path: Path) -> None:
    """Write a table as CSV, whole or not at all: nine significant digits, NaN as an empty cell."""
    with written_whole(path) as temporary:
        table.to_csv(temporary, index=False, float_format="%.9g")


def read_with(load: Callable[[Path], Value], path: Path) -> Value:
    """Load a file and turn every way it can be wrong into an InputError that names file, place and remedy."""
    try:
        return load(path)
    except FileNotFoundError as error:
        raise InputError(f"{error.filename or path}: no such file") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a text file (byte {error.start} is not UTF-8)") from error
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not valid TOML: {error}") from error
    except ValidationError as error:
        raise InputError(f"{path}: {explain(error, load)}") from error


def explain(error: ValidationError, load: Callable[[Path], object]) -> str:
    """Say all faults of a file in one sentence, with the nearest valid key for an unknown one.

    load: the function that raised; its return annotation names the model whose keys are valid.
    """
    model = load.__annotations__.get("return")
    if isinstance(model, str):
        model = getattr(load, "__globals__", {}).get(model)
    faults = [_fault(item["loc"], item["type"], item["msg"], item.get("input"), model) for item in error.errors()]
    return "; ".join(fault for fault in faults if fault)


def _fault(place: tuple[int | str, ...], kind: str, message: str, found: object, model: object) -> str:
    dotted = "".join(f"[{part + 1}]" if isinstance(part, int) else f".{part}" for part in place).lstrip(".")
    if kind == "extra_forbidden":
        near = difflib.get_close_matches(str(place[-1]), _keys_at(model, place[:-1]), n=1, cutoff=0.5)
        return f"unknown key {dotted}" + (f"; did you mean {near[0]}?" if near else "")
    if kind == "missing":
        return f"{dotted} is missing"
    if kind == "too_short" and found:
        return ""  # entries that failed are counted out of their list; their own faults are said already
    text = (message[0].lower() + message[1:]).removeprefix("value error, ")
    return text if isinstance(found, dict) or not dotted else f"{dotted} = {found!r}: {text}"


def _keys_at(model: object, place: tuple[int | str, ...]) -> list[str]:
    """Valid keys of the table at a place of a model."""
    for part in place:
        if isinstance(part, str) and isinstance(model, type) and issubclass(model, BaseModel):
            if part not in model.model_fields:
                return []
            model = next(_models_in(model.model_fields[part].annotation), None)
    if isinstance(model, type) and issubclass(model, BaseModel):
        return [field.alias or name for name, field in model.model_fields.items()]
    return []


def _models_in(annotation: object) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _models_in(argument)
