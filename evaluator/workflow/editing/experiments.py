"""experiment.toml as a table of runs: contents, errors per cell, and changes to cells and rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import ValidationError

from evaluator.errors import InputError
from evaluator.files import in_words
from evaluator.settings import Experiment, Run
from evaluator.workflow.editing.documents import change_document, read_document

Value = str | float | bool | None
NEW_START_S = 0.5  # of the template: half a second of rest before the motors start
PLACES = ("video", "marks", "poses", "commands", "corrections", "camera")  # keys of a run that name files


@dataclass(frozen=True)
class Fault:
    """An error of a cell: row of the table (None: the file itself), key ("": the row), one sentence."""

    row: int | None
    key: str
    sentence: str


@dataclass(frozen=True)
class ExperimentTable:
    """The content of an experiment.toml: the entries above the runs, a row per run, and all faults."""

    version: str
    head: dict[str, Any]
    rows: tuple[dict[str, Any], ...]
    faults: tuple[Fault, ...]


@dataclass(frozen=True)
class Edit:
    """One change: "set" a key of a row (None removes it), "add" a row (after row, by default last), "remove" a row.

    A row of None means the head of the file.
    """

    kind: Literal["set", "add", "remove"]
    row: int | None = None
    key: str = ""
    value: Value = None
    values: Mapping[str, Value] | None = None


def read_experiment(path: Path) -> ExperimentTable:
    """The table of an experiment.toml, which may be invalid. Raises InputError if it is not TOML."""
    document, version = read_document(path)
    content: dict[str, Any] = document.unwrap()
    runs = content.get("run", [])
    rows = tuple(dict(row) for row in runs) if _are_tables(runs) else ()
    head = {key: value for key, value in content.items() if key != "run"}
    return ExperimentTable(version, head, rows, tuple(_faults(path, content)))


def edit_experiment(path: Path, version: str, edits: Sequence[Edit]) -> ExperimentTable:
    """Change an experiment.toml of a known version; comments and order are kept.

    Faults of the result are reported but do not prevent the change, because a table is filled in cell by cell. Raises
    ChangedMeanwhileError, InputError for a row or key that cannot exist.
    """
    for edit in edits:
        _check(edit)

    def change(document: Any) -> None:
        for edit in edits:
            _apply(document, edit)

    change_document(path, version, change)
    return read_experiment(path)


def _check(edit: Edit) -> None:
    known = (
        set(Run.model_fields) if edit.row is not None or edit.kind == "add" else {"name", "robot", "notes", "camera"}
    )
    for key in edit.values or ({edit.key: None} if edit.kind == "set" else {}):
        if key not in known:
            raise InputError(f"{key}: no such column of experiment.toml")


def _apply(document: Any, edit: Edit) -> None:
    import tomlkit

    if edit.row is None and edit.kind == "set":
        _set(document, edit.key, edit.value)
        return
    if "run" not in document:
        document.append("run", tomlkit.aot())
    runs = document["run"]
    if edit.kind == "add":
        table = tomlkit.table()
        for key, value in (edit.values or {}).items():
            _set(table, key, value)
        runs.append(table) if edit.row is None or edit.row + 1 >= len(runs) else runs.insert(edit.row + 1, table)
        return
    if edit.row is None or not 0 <= edit.row < len(runs):
        raise InputError("this run is no longer in the file")
    if edit.kind == "remove":
        del runs[edit.row]
        if not len(runs):
            del document["run"]
    else:
        _set(runs[edit.row], edit.key, edit.value)


def _set(table: Any, key: str, value: Value) -> None:
    if value is None or value == "":
        if key in table:
            del table[key]
    else:
        table[key] = value


def _faults(path: Path, content: Mapping[str, Any]) -> list[Fault]:
    """Validation errors, each with its cell, and named files that do not exist."""
    try:
        Experiment.model_validate(content)
        found: list[Fault] = []
    except ValidationError as error:
        found = [_fault(item) for item in error.errors()]
    folder = path.resolve().parent
    runs = content.get("run", [])
    for row, run in enumerate(runs if _are_tables(runs) else []):
        for key in PLACES:
            name = run.get(key)
            if isinstance(name, str) and not (folder / name).exists():
                found.append(Fault(row, key, f"{name} does not exist"))
        if _missing_robot(folder, run.get("robot")):
            found.append(Fault(row, "robot", f"{run['robot']} does not exist"))
    camera = content.get("camera")
    if isinstance(camera, str) and not (folder / camera).exists():
        found.append(Fault(None, "camera", f"{camera} does not exist yet: calibrate the camera first"))
    if _missing_robot(folder, content.get("robot")):
        found.append(
            Fault(None, "robot", f"{content['robot']} does not exist: robot = must be a file or a shipped robot")
        )
    return found


def _missing_robot(folder: Path, robot: object) -> bool:
    """Whether a robot is a file that does not exist; a name without suffix is that of a shipped robot."""
    return isinstance(robot, str) and robot.endswith(".toml") and not (folder / robot).exists()


def _fault(item: Any) -> Fault:
    """A validation error with its cell; errors of a whole row are reported at its id."""
    place = item["loc"]
    row = place[1] if len(place) > 1 and place[0] == "run" else None
    key = str(place[2]) if row is not None and len(place) > 2 else str(place[0]) if place and row is None else ""
    if item["type"] == "missing":
        return Fault(row, key, f"{place[-1]} is missing")
    return Fault(row, key, in_words(item["type"], str(item["msg"])))


def _are_tables(runs: Any) -> bool:
    return isinstance(runs, list) and all(isinstance(run, dict) for run in runs)


def new_table(path: Path, name: str, robot: str, recordings: Sequence[str]) -> None:
    """Write a name and a row per recording into a new experiment.toml; the user fills in the commands.

    The explanations of the template about the keys of a run are kept as comments.
    """
    import tomlkit

    def change(document: Any) -> None:
        document["name"] = name
        document["robot"] = robot
        hints = [line for line in document["run"][0].as_string().splitlines() if line.strip()]
        runs = tomlkit.aot()
        for recording in recordings:
            row = tomlkit.table()
            row["id"] = run_id(recording, [str(other["id"]) for other in runs])
            row["start_s"] = NEW_START_S
            row["video"] = recording
            runs.append(row)
        del document["run"]
        for line in hints:
            text = line if line.startswith("#") else "# " + line.replace("  #", "#", 1)  # its comment where it was
            document.add(tomlkit.comment(text.removeprefix("# ")))
        if len(runs):
            document["run"] = runs

    _, version = read_document(path)
    change_document(path, version, change)


def run_id(recording: str, taken: Sequence[str]) -> str:
    """An id for the run of a recording: its name without characters that are invalid in ids."""
    stem = "".join(
        letter if letter.isascii() and (letter.isalnum() or letter in "._-") else "-" for letter in Path(recording).stem
    )
    stem = stem.lstrip("._-") or "run"
    number = 2
    found = stem
    while found in taken:
        found, number = f"{stem}-{number}", number + 1
    return found
