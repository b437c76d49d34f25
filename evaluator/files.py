"""Writing files atomically, and reading them with one sentence per error."""

from __future__ import annotations

import difflib
import errno
import math
import os
import tempfile
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from evaluator.errors import InputError, UnwritableError

if TYPE_CHECKING:  # they take long to import, and reading a TOML file does not need them
    import numpy as np
    import pandas as pd
    from numpy.typing import NDArray

Value = TypeVar("Value")
NO_ROOM = (errno.ENOSPC, errno.EFBIG, errno.EDQUOT)
IMAGES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp")


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Give a temporary name beside path and rename it to path when the block ends without an error.

    The suffix is kept, so that encoders choose their format by it. What stood at path stays until the rename. Raises
    UnwritableError where it is the writing that fails.
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
    except OSError as error:  # others are of what the block reads
        if error.errno not in NO_ROOM and str(error.filename) != str(temporary):
            raise
        reason = str(error.strerror).lower()
        raise UnwritableError(
            f"{path}: cannot be written ({reason}); free space or write elsewhere, and run the command again"
        ) from error
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a text file whole or not at all."""
    with written_whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file whole or not at all."""
    with written_whole(path) as temporary:
        temporary.write_bytes(content)


def write_table(table: pd.DataFrame, path: Path) -> None:
    """Write a table as CSV, whole or not at all: nine significant digits, NaN as an empty cell."""
    with written_whole(path) as temporary:
        from evaluator.interchange.csv_text import csv_text

        with temporary.open("w", encoding="utf-8", newline="") as file:
            file.writelines(csv_text(table))


class Dialect(TypedDict):
    """How the cells of a CSV file are parted, and how its numbers are written."""

    sep: str
    decimal: str


def csv_dialect(path: Path) -> Dialect:
    """The dialect of a table by its first line: semicolons come with decimal commas. Raises OSError."""
    with path.open(encoding="utf-8", errors="replace") as lines:
        first = lines.readline(4096)
    return {"sep": ";", "decimal": ","} if first.count(";") > first.count(",") else {"sep": ",", "decimal": "."}


def write_image(image: NDArray[np.generic], path: Path) -> None:
    """Write an image (h, w) or (h, w, 3) RGB whole or not at all, in the format of its ending. Raises InputError."""
    import cv2
    import numpy as np

    if path.suffix.lower() not in IMAGES:
        raise InputError(f"{path}: an image is written as {', '.join(IMAGES)}")
    stored = image[..., ::-1] if image.ndim == 3 else image  # OpenCV writes blue, green, red
    with written_whole(path) as temporary:
        if not cv2.imwrite(str(temporary), np.ascontiguousarray(stored)):  # it does not say why
            raise OSError(errno.EIO, os.strerror(errno.EIO), str(temporary))


def plain(value: Any) -> Any:
    """A value that strict JSON can hold: what is not a finite number becomes null."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if value is None or isinstance(value, str | bool | int | float):
        return value
    return str(value)


def read_with(load: Callable[[Path], Value], path: Path) -> Value:
    """Load a file and convert every error into an InputError with file, place and remedy."""
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
    items = error.errors()
    told = [item for item in items if item["type"] != "too_short" or not _inner_fault(item["loc"], items)]
    return "; ".join(_fault(item["loc"], item["type"], item["msg"], item.get("input"), model) for item in told)


def _inner_fault(place: tuple[int | str, ...], items: Sequence[Mapping[str, Any]]) -> bool:
    """Tell whether entries of a list have faults of their own: they are then counted out of it, which is no news."""
    return any(item["loc"] != place and item["loc"][: len(place)] == place for item in items)


def _fault(place: tuple[int | str, ...], kind: str, message: str, found: object, model: object) -> str:
    keys, models = _resolved(model, place[:-1])
    keys += place[-1:]
    dotted = "".join(f"[{part + 1}]" if isinstance(part, int) else f".{part}" for part in keys).lstrip(".")
    if kind == "extra_forbidden":
        near = difflib.get_close_matches(str(place[-1]), _keys_of(models), n=1, cutoff=0.5)
        return f"unknown key {dotted}" + (f"; did you mean {near[0]}?" if near else "")
    if kind == "missing":
        return f"{dotted} is missing"
    text = (message[0].lower() + message[1:]).removeprefix("value error, ")
    return text if isinstance(found, dict) or not dotted else f"{dotted} = {found!r}: {text}"


def _resolved(model: object, place: tuple[int | str, ...]) -> tuple[tuple[int | str, ...], list[type[BaseModel]]]:
    """Keys of a place as the file has them, and the models that may stand there.

    A place within one of several models names which one it is, by a tag that is no key of the file: it is left out.
    """
    keys: tuple[int | str, ...] = ()
    models = [model] if isinstance(model, type) and issubclass(model, BaseModel) else []
    for part in place:
        tagged = [each for each in models if _has_tag(each, part)] if len(models) > 1 else []
        if tagged:
            models = tagged[:1]
            continue
        keys += (part,)
        if isinstance(part, str):
            fields = [each.model_fields[part].annotation for each in models if part in each.model_fields]
            models = [inner for annotation in fields for inner in _models_in(annotation)]
    return keys, models


def _has_tag(model: type[BaseModel], part: int | str) -> bool:
    return any(part in get_args(field.annotation) for field in model.model_fields.values())


def _keys_of(models: Sequence[type[BaseModel]]) -> list[str]:
    """Valid keys of a table that one of some models describes."""
    return [field.alias or name for model in models for name, field in model.model_fields.items()]


def _models_in(annotation: object) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _models_in(argument)
