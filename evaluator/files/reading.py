"""Reading files, with one sentence for all faults of a file."""

from __future__ import annotations

import codecs
import difflib
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from stat import S_ISCHR, S_ISFIFO
from typing import Any, TypeVar, get_args, get_origin

from pydantic import BaseModel, ValidationError

from evaluator.errors import InputError

Value = TypeVar("Value")


def read_with(load: Callable[[Path], Value], path: Path) -> Value:
    """Load a file and convert every error into an InputError with file, place and remedy."""
    try:
        refuse_stream(path)
        return load(path)
    except FileNotFoundError as error:
        raise InputError(f"{error.filename or path}: no such file") from error
    except OSError as error:
        reason = _of_folder(path) if path.is_dir() else f"cannot be read ({error.strerror})"
        raise InputError(f"{path}: {reason}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: {_of_bytes(error)}") from error
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not valid TOML: {toml_fault(error, _text_of(path))}") from error
    except ValidationError as error:
        raise InputError(f"{path}: {explain(error, load)}") from error
    except RecursionError as error:
        raise InputError(f"{path}: its lists or tables are nested too deeply") from error
    except ValueError as error:
        if "embedded null" not in str(error):
            raise
        raise InputError(f"{str(path)!r}: no file can have this name, because of U+0000 in it") from error


def _of_bytes(error: UnicodeDecodeError) -> str:
    """Why bytes are no text in UTF-8, with the remedy."""
    if error.object.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "is text in UTF-16, which some editors call Unicode; save it as UTF-8"
    if b"\0" in error.object:
        return "is no text but a picture, a recording or another binary file; give a text file"
    return f"not a text file (byte {error.start} is not UTF-8); save it as UTF-8"


def refuse_stream(path: Path) -> None:
    """Refuse a named pipe, which would be waited for without end, or a device. Raises InputError.

    Tables and settings are read more than once (their format, their content, their hash); recordings can be streams.
    """
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):  # what opens it says why it cannot
        return
    if S_ISFIFO(mode) or S_ISCHR(mode):
        raise InputError(f"{path}: is a pipe or a device, which can be read only once; save its content as a file")


def _of_folder(path: Path) -> str:
    """Why a folder is refused where a file is expected, with a settings file that it holds."""
    inside = next((f", such as {file}" for file in sorted(path.glob("*.toml"))), "")
    return f"is a folder; give the name of a file{inside}"


def _text_of(path: Path) -> str:
    """A text that could be read just now; empty if it has changed meanwhile or is a shipped file."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return ""


TABLE_HEAD = re.compile(r"[\w\" ]+([,;\t][\w\" ]+)+\r?\n")  # names of columns: no line of TOML is like it


def toml_fault(error: tomllib.TOMLDecodeError, text: str) -> str:
    """Why a text is not TOML, with the remedy for what editors and locales do to numbers and to the first character."""
    if text.startswith("\ufeff"):
        return "it begins with a byte order mark; save it as UTF-8 without BOM"
    if TABLE_HEAD.match(text):
        return "it is a table; give a file of settings, such as experiment.toml"
    place = re.search(r"line (\d+), column (\d+)", str(error))
    if place is None:
        return str(error)
    line, column = text.split("\n")[int(place[1]) - 1 :][:1], int(place[2])
    comma = line and re.match(r"\d,\d", line[0][max(column - 2, 0) :])
    return f"{error}; numbers have a decimal point, not a comma" if comma else str(error)


ENTRY = re.compile(r"\[\d+\]")  # number of an entry of a list
UNITS = ("m", "cm", "kg", "N", "rad_s", "deg_s", "rad", "ms")  # of the same quantities as those of keys, but others
MOST_READ = 1000  # faults of a file that are put into words
MOST_FAULTS = 50  # told of a file: more than anybody mends at once
MOST_SHOWN = 200  # characters of a value: more than a line of a file
# Values of the wrong kind in words of the files; pydantic's are those of Python.
TYPES = "_parsing", "_type", "_from_float"
KINDS = {
    "float": "should be a number",
    "int": "should be a whole number",
    "string": "should be text",
    "bool": "should be true or false",
    "path": "should be the path of a file",
    "tuple": "should be a list",
    "list": "should be a list",
    "model": "should be a table",
}


def quoted(value: object) -> str:
    """A value of a file as it is told, shortened: a cell may hold megabytes."""
    shown = repr(value)
    return shown if len(shown) <= MOST_SHOWN else f"{shown[:MOST_SHOWN]}…"


def in_words(kind: str, message: str) -> str:
    """What is wrong with a value, from the type and the message of an error of pydantic."""
    of_kind = KINDS.get(kind.partition("_")[0]) if kind.endswith(TYPES) else None
    said = (message[0].lower() + message[1:]).removeprefix("value error, ").removeprefix("input ")
    return of_kind or said.removeprefix("tuple ").replace(" after validation,", ",")  # of a list that is too short


def explain(error: ValidationError, load: Callable[[Path], object]) -> str:
    """All faults of a file in one sentence, with the nearest valid key for each unknown one.

    load: the function that raised; its return annotation names the model whose keys are valid, or several of which the
    error names one.
    """
    model = load.__annotations__.get("return")
    if isinstance(model, str):
        names = model.split(" | ")
        model = getattr(load, "__globals__", {}).get(error.title if error.title in names else names[0])
    items = error.errors()
    if other := _of_another_kind(items, error.title):
        return other
    reported = [item for item in items if item["type"] != "too_short" or not _inner_fault(item["loc"], items)]
    faults = [_fault(item["loc"], item["type"], item["msg"], item.get("input"), model) for item in reported[:MOST_READ]]
    told = _once(faults)
    more = len(reported) - len(faults) + max(len(told) - MOST_FAULTS, 0)
    return "; ".join([*told[:MOST_FAULTS], *([f"{more} more faults"] if more else [])])


def _once(faults: Sequence[str]) -> list[str]:
    """Faults of which those that many entries of a list have are told of the first, with the number of others."""
    kinds: dict[str, list[str]] = {}
    for fault in faults:
        kinds.setdefault(ENTRY.sub("[]", fault, count=1), []).append(fault)
    told = []
    for same in kinds.values():
        told += [f"{same[0]} ({len(same) - 1} other entries alike)"] if len(same) > 2 else same
    return told


def _unit_of(key: str, meant: str) -> str:
    """The unit of a key, as a sentence, where the key that was meant ends in another one; else empty."""
    stem, _, unit = key.rpartition("_")
    return f" It is in {unit}" if stem and meant.removeprefix(f"{stem}_") in UNITS else ""


# Keys that tell a kind of settings file, and what the models of that kind have in their names.
KEYS_OF_FILES = {
    "a robot file": ("Robot", {"body", "wheels", "wheel", "magnetic_attraction", "slip", "marks"}),
    "an experiment file": ("Experiment", {"robot", "run", "known_to", "relevant"}),
    "a gauge file": ("Gauge", {"dots", "fiducial"}),
}


def _of_another_kind(items: Sequence[Mapping[str, Any]], title: str) -> str:
    """That a file is of another kind than the one asked for, by two keys or more; empty if none is told by them."""
    unknown = [item["loc"][0] for item in items if item["type"] == "extra_forbidden" and len(item["loc"]) == 1]
    asked = next((kind for kind, (name, _) in KEYS_OF_FILES.items() if name in title), "another file")
    for kind, (_, keys) in KEYS_OF_FILES.items():
        shown = [key for key in unknown if key in keys]
        if kind != asked and len(shown) > 1:
            return f"is {kind}, by its keys {', '.join(shown)}; give {asked}"
    return ""


def _cut(text: str) -> str:
    """The text with every word of more than MOST_SHOWN characters cut: a name that nobody knows may have any length."""
    return re.sub(rf"(\S{{{MOST_SHOWN}}})\S+", r"\1…", text)


def _inner_fault(place: tuple[int | str, ...], items: Sequence[Mapping[str, Any]]) -> bool:
    """Whether entries of a list are faulty; pydantic then reports the list as too short as well, which adds nothing."""
    return any(item["loc"] != place and item["loc"][: len(place)] == place for item in items)


def _fault(place: tuple[int | str, ...], kind: str, message: str, found: object, model: object) -> str:
    keys, models = _resolved(model, place[:-1])
    keys += tuple(part for part in place[-1:] if part not in [each.__name__ for each in models])
    dotted = _cut("".join(f"[{part + 1}]" if isinstance(part, int) else f".{part}" for part in keys).lstrip("."))
    if kind == "extra_forbidden":
        near = difflib.get_close_matches(str(place[-1]), _keys_of(models), n=1, cutoff=0.5)
        return f"unknown key {dotted}" + (
            f"; did you mean {near[0]}?{_unit_of(near[0], str(place[-1]))}" if near else ""
        )
    if kind == "missing":
        return f"{dotted} is missing"
    text = _cut(in_words(kind, message))
    return text if isinstance(found, dict) or not dotted else f"{dotted} = {quoted(found)}: {text}"


def _resolved(model: object, place: tuple[int | str, ...]) -> tuple[tuple[int | str, ...], list[type[BaseModel]]]:
    """Keys of a place as in the file, and the models that it may hold.

    A place within one of several models names which one it is, by a tag that is no key of the file, or by its class: it
    is left out. Keys of a table without a model of its own may have any name.
    """
    keys: tuple[int | str, ...] = ()
    models = [model] if isinstance(model, type) and issubclass(model, BaseModel) else []
    free = False
    for part in place:
        tagged = [each for each in models if part == each.__name__ or (len(models) > 1 and _has_tag(each, part))]
        if tagged and not free:
            models = tagged[:1]
            continue
        keys += (part,)
        if free:
            free = False
        elif isinstance(part, str):
            fields = [each.model_fields[part].annotation for each in models if part in each.model_fields]
            models = [inner for annotation in fields for inner in _models_in(annotation)]
            free = any(get_origin(annotation) is dict for annotation in fields)
    return keys, models


def _has_tag(model: type[BaseModel], part: int | str) -> bool:
    return any(part in get_args(field.annotation) for field in model.model_fields.values())


def _keys_of(models: Sequence[type[BaseModel]]) -> list[str]:
    """Valid keys of a table with one of several models."""
    return [field.alias or name for model in models for name, field in model.model_fields.items()]


def _models_in(annotation: object) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _models_in(argument)
