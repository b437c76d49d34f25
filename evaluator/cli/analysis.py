"""An analysis run by a command: progress bar, notes, exit status, and the cells of a run in a table of the terminal."""

from __future__ import annotations

import json
import math
import re
import sys
from collections.abc import Collection, Hashable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import click

from evaluator.cli.options import BatchOptions
from evaluator.cli.progress import progress_bar
from evaluator.turning import only_mark

if TYPE_CHECKING:
    import pandas as pd

    from evaluator.report.numbers import LengthUnit
    from evaluator.workflow import Analysis
    from simulator.robot import Robot

MOST_NAMED = 6  # runs that are named in a note common to many
DASH = "–"
TOO_LITTLE = "turns < 1°"  # in place of a radius: turning.status.LEAST_TURN_DEG
# A number, with its sign, that is not part of the name of a file or run.
WHOLE_NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?!\.?\w)")
SOME_FAILED = 1  # exit status: results for some runs, reasons for the others

STATUS_NOTE = """Exit status: 0, all runs were analysed; 1, some runs could not be analysed (reasons on standard error,
results for the others); 2, the input cannot be used."""


def run_analysis(options: BatchOptions, *, simulate: bool, notes: bool = True) -> Analysis:
    """Analyse with a progress bar, and print to standard error why runs are missing, and the notes of the others."""
    from evaluator.workflow import analyze as analyze_experiment

    with progress_bar("runs", quiet=options.quiet) as progress:
        found = analyze_experiment(
            options.experiment,
            options.out,
            simulate=simulate,
            workers=options.workers,
            dask=options.dask,
            progress=progress,
            command_line=sys.argv[1:],
        )
    for run, fault in found.faults.items():
        click.echo(f"{run}: {fault}", err=True)
    if found.changed:
        named = ", ".join(str(path) for path in found.changed[:MOST_NAMED])
        click.echo(
            f"{named} changed during the analysis; the results are of the earlier content: run the command again",
            err=True,
        )
    if notes and not options.quiet:
        for note, runs in runs_by_note(found.notes).items():
            click.echo(f"note: {named_runs(runs)}: {note}", err=True)
    return found


def named_runs(runs: Sequence[str]) -> str:
    """The first of some runs, and how many there are."""
    return ", ".join(runs[:MOST_NAMED]) + (f", … ({len(runs)} runs)" if len(runs) > MOST_NAMED else "")


def reasons_of_dashes(rows: Sequence[Mapping[Hashable, Any]], unit: LengthUnit) -> list[str]:
    """A line for every reason why rows of turning.csv have a dash in place of a radius."""
    statuses = {name_of(row): (str(row["radius_status"]),) for row in rows if radius(row, unit)[0] == DASH}
    return [f"{DASH} in {named_runs(runs)}: {status}" for status, runs in runs_by_note(statuses).items()]


def runs_by_note(notes: Mapping[str, Sequence[str]]) -> dict[str, list[str]]:
    """Runs with each note, in the order of their first runs.

    Notes of more than MOST_NAMED runs that differ in their numbers only are combined into one with the ranges of the
    numbers.
    """
    kinds: dict[str, list[tuple[str, str]]] = {}
    for run, said in notes.items():
        for note in said:
            kinds.setdefault(WHOLE_NUMBER.sub("#", note), []).append((run, note))
    found: dict[str, list[str]] = {}
    for same in kinds.values():
        many = len({note for _, note in same}) > MOST_NAMED
        shared = _with_ranges([note for _, note in same]) if many else ""
        for run, note in same:
            found.setdefault(shared or note, []).append(run)
    return found


def _with_ranges(notes: Sequence[str]) -> str:
    """Notes that differ in their numbers only, as one note."""
    numbers = zip(*(WHOLE_NUMBER.findall(note) for note in notes), strict=True)
    ends = [(min(item, key=float), max(item, key=float)) for item in numbers]
    ranges = iter([low if low == high else f"{low} to {high}" for low, high in ends])
    return WHOLE_NUMBER.sub(lambda _: next(ranges), notes[0])


def status_of(found: Analysis) -> int:
    """Exit status of an analysis."""
    return SOME_FAILED if found.faults else 0


def print_plan(options: BatchOptions, *, simulate: bool) -> int:
    """Print what an analysis would compute."""
    from evaluator.wording import counted
    from evaluator.workflow import pending

    steps = pending(options.experiment, options.out, simulate=simulate)
    for run, stages in steps.items():
        click.echo(f"{run}: {', '.join(stages) if stages else 'up to date'}")
    count = sum(1 for stages in steps.values() if stages)
    click.echo(f"{count} of {counted(len(steps), 'run')} to compute, nothing was done (--dry-run)")
    return 0


def print_json(table: pd.DataFrame) -> None:
    """Print a table of runs as a list of objects; unknown values are null."""
    from evaluator.workflow.exporting import records

    click.echo(json.dumps(records(table), indent=1))


def name_of(row: Mapping[Hashable, Any], left_out: Collection[str] = ()) -> str:
    """The run of a row, with the number of its phase if it has several; of one with a mistake, that it is left out."""
    phase = row.get("phase", math.nan)
    name = f"{row['run']} ({phase:.0f})" if math.isfinite(phase) else str(row["run"])
    return f"{name} (left out)" if row["run"] in left_out else name


def named_after(mark: str, column: str) -> str:
    """A column of the robot's centre, or of its only mark."""
    return f"{mark}_{column}" if mark else column


def robot_of(found: Analysis) -> Robot:
    """The robot of the experiment."""
    from simulator.robot import load_robot

    return load_robot(found.experiment.robot)


def length_unit(found: Analysis) -> LengthUnit:
    """The unit of lengths for the robot of the experiment."""
    from evaluator.report.numbers import unit_for

    return unit_for(robot_of(found).body.length_mm)


def without_places(found: Analysis) -> list[str]:
    """A line on what the places of the marks add to the intervals, if that is not little."""
    from evaluator.report.runs import views_of
    from evaluator.report.summary import places_sentence

    said = places_sentence([run for run in views_of(found, robot_of(found)) if run.run not in found.excluded_runs])
    return [said] if said else []


def radius(row: Mapping[Hashable, Any], unit: LengthUnit) -> tuple[str, str]:
    """Radius of a row of turning.csv and its interval; a word if it has none. A single mark is named."""
    mark = only_mark(row)
    value, low, high, turned, status = (
        row[named_after(mark, name)]
        for name in ("radius_mm", "radius_low_mm", "radius_high_mm", "turned_deg", "radius_status")
    )
    if math.isfinite(value) and abs(turned) > 1:
        shown = f"{value / unit.mm:.3f}"
        return f"{shown} ({mark})" if mark else shown, f"{low / unit.mm:.3f} to {high / unit.mm:.3f}"
    little = math.isfinite(value) or str(status).startswith("turns too little")
    unproven = little or str(status).startswith("straight or")  # turning.status.UNCERTAIN
    if row["left_rpm"] == row["right_rpm"] if unproven else str(status).startswith("straight"):
        return "straight", ""
    return TOO_LITTLE if little else DASH, ""
