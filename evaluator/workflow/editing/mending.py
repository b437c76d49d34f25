"""The experiment file with its mistakes corrected, as a new file beside the old one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from evaluator.errors import InputError
from evaluator.files import read_with, write_text
from evaluator.files.csv_tables import write_table
from evaluator.marks import read_marks
from evaluator.robot_geometry import reference_pair
from evaluator.settings import load_experiment
from evaluator.workflow.editing.documents import read_document
from evaluator.workflow.results.outputs import Outputs
from evaluator.workflow.runs.given import converted_marks
from evaluator.workflow.runs.mistakes import given_marks, mistakes_of_marks, without_explained
from simulator.robot import load_robot

if TYPE_CHECKING:
    from evaluator.diagnosis.mistakes.recognised import Correction, Mistake
    from evaluator.settings import Run

LEFT_OUT = "is left out: it cannot be corrected in its files"
PART = "stays: the file of a long recording of poses holds for all of it"


@dataclass(frozen=True)
class Mended:
    """The corrected file, or the stated one if nothing in it can be corrected; its changes, a sentence for each run."""

    path: Path
    changes: tuple[str, ...]


def write_mended(path: Path, out: Path | None = None) -> Mended | None:
    """Write NAME-mended.toml beside an experiment.toml, with all mistakes in its runs corrected; None without any.

    Runs that cannot be corrected in their files (held, pushed, unlike the robot) are excluded. Corrected marks are
    written to NAME-mended-RUN.csv; comments of the experiment are kept. out: folder of an analysis with the marks of
    videos, and perhaps of a diagnosis. Raises InputError if such a file exists already or no run would be
    left.
    """
    experiment = read_with(load_experiment, path)
    given = given_marks(experiment)
    tracked = {run.id: Outputs(out).marks(run.id) for run in experiment.run if run.video is not None} if out else {}
    with TemporaryDirectory() as folder:
        marks = {**given, **{run: at for run, at in tracked.items() if at.is_file()}}
        found = mistakes_of_marks(experiment, {**marks, **converted_marks(experiment, given, Path(folder))})
    mistakes = without_explained(found, experiment, Outputs(out)) if out else found
    wrong = {run: item for item in mistakes for run in item.runs}
    if not wrong:
        return None
    target = path.with_name(f"{path.stem}-mended.toml")
    if target.exists():
        raise InputError(f"{target}: exists already; rename or remove it, and write the mended experiment again")
    document, _ = read_document(path)
    rows: Any = document["run"]
    robots = {run.id: Path(run.robot or experiment.robot) for run in experiment.run}
    corrections = {run: item.corrections.get(run) for run, item in wrong.items() if run in robots}
    whole, changes = _of_recordings(experiment.run, wrong)
    corrections |= whole
    files: dict[Path, pd.DataFrame] = {}
    if not corrections:
        return Mended(path, tuple(changes))
    for number in reversed(range(len(rows))):
        run = str(rows[number]["id"])
        if run not in corrections:
            continue
        correction = corrections[run]
        if correction is None or (_of_marks(correction) and run not in given):
            del rows[number]
            changes.append(f"{run} {LEFT_OUT}")
            continue
        table = read_with(read_marks, given[run]) if _of_marks(correction) else None
        pair = reference_pair(load_robot(robots[run])) or ()
        changes.append(f"{run}: {'; '.join(_apply(correction, rows[number], target, files, table, pair))}")
    if not len(rows):
        raise InputError(f"{path}: no run would be left: {wrong[next(iter(wrong))].sentence}")
    for file, content in files.items():
        write_table(content, file)
    write_text(target, document.as_string())
    return Mended(target, tuple(reversed(changes)))


def _of_recordings(runs: Sequence[Run], wrong: Mapping[str, Mistake]) -> tuple[dict[str, Correction | None], list[str]]:
    """Corrections of long recordings of poses, of which every part has one mistake of all runs; what stays of others.

    wrong: mistakes by run, or by part of a recording, which is named after it.
    """
    from evaluator.diagnosis.mistakes.misread.command_unit import with_wheels
    from evaluator.diagnosis.mistakes.recognised import Correction, named

    found: dict[str, Correction | None] = {}
    stays: list[str] = []
    for run in runs:
        parts = {part: item for part, item in wrong.items() if part.startswith(f"{run.id}@")}
        ways = {(it.wheels if it else None) for it in (item.corrections.get(part) for part, item in parts.items())}
        way = ways.pop() if len(ways) == 1 and all(item.everywhere for item in parts.values()) else None
        if way is None:
            stays += [f"{named(list(parts))} {PART}"] if parts else []
            continue
        times, exchanged = way
        found[run.id] = Correction(log=with_wheels(run.run_command(), times, exchanged=exchanged))
    return found, stays


def _of_marks(correction: Correction) -> bool:
    """Whether a correction changes the marks, not the command."""
    changed = correction.marks_exchanged or correction.marks_times != (1.0, 1.0)
    return changed or correction.seconds_times != 1.0 or bool(correction.lost_s)


def _apply(
    correction: Correction,
    row: Any,
    target: Path,
    files: dict[Path, pd.DataFrame],
    table: pd.DataFrame | None,
    pair: tuple[str, ...],
) -> list[str]:
    """Correct a run in its row of the file, and add corrected marks to files; return descriptions of the changes."""
    said = []
    if correction.command is not None:
        row["left_rpm"], row["right_rpm"] = (float(f"{rpm:.6g}") for rpm in correction.command)
        said.append(f"left_rpm = {correction.command[0]:g}, right_rpm = {correction.command[1]:g}")
    if correction.log is not None:
        file = target.with_name(f"{target.stem}-{row['id']}-commands.csv")
        files[file] = pd.DataFrame(correction.log.command.knots, columns=["time_s", "left_rpm", "right_rpm"])
        for key in ("left_rpm", "right_rpm", "stop_s", "start_s"):
            row.pop(key, None)
        row["commands"] = file.name
        said.append(f"commands = {file.name}, in the time of the recording")
    if correction.later_s:
        row["start_s"] = round(float(row.get("start_s", 0.0)) + correction.later_s, 3)
        said.append(f"start_s = {row['start_s']:g}")
    if table is not None:
        file = target.with_name(f"{target.stem}-{row['id']}.csv")
        files[file] = mended_marks(table, correction, pair)
        row["marks"] = file.name
        said.append(f"marks = {file.name}, {_words(correction)}")
    return said


def _words(correction: Correction) -> str:
    """Description of the correction of the marks of a run."""
    if correction.marks_exchanged:
        return "its two marks exchanged"
    if correction.seconds_times != 1.0:
        return f"its seconds times {correction.seconds_times:.4g}"
    if correction.lost_s:
        return f"its times later by {sum(duration for _, duration in correction.lost_s):.3g} s where frames are missing"
    if min(correction.marks_times) < 0:
        return "mirrored in x"
    return f"its lengths times {correction.marks_times[0]:g}"


def mended_marks(table: pd.DataFrame, correction: Correction, pair: tuple[str, ...]) -> pd.DataFrame:
    """A corrected table of marks; pair: names of the two marks that determine the pose."""
    time_s = table["time_s"] * correction.seconds_times
    later_s = sum((table["time_s"] >= at - 1e-9) * duration for at, duration in correction.lost_s)
    changed = table.assign(time_s=time_s + later_s)
    factors: Mapping[str, float] = dict(zip("xy", correction.marks_times, strict=True))
    for name in changed.columns:
        axis = next((axis for axis in "xy" if name.endswith((f"_{axis}_mm", f"_{axis}_sigma_mm"))), None)
        if axis is not None:
            factor = factors[axis]
            changed[name] *= np.abs(factor) if name.endswith("_sigma_mm") else factor
    if correction.marks_exchanged:
        first, second = pair
        other = {f"{a}_": f"{b}_" for a, b in ((first, second), (second, first))}
        names = {
            name: new + name.removeprefix(old)
            for name in changed.columns
            for old, new in other.items()
            if name.startswith(old)
        }
        changed = changed.rename(columns=names)
    return changed
