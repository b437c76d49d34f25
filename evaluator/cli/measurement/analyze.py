"""turnscope analyze: an experiment in, a table of measured runs out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from evaluator.cli.analysis import (
    STATUS_NOTE,
    length_unit,
    name_of,
    named_after,
    print_json,
    print_plan,
    radius,
    reasons_of_dashes,
    run_analysis,
    status_of,
    without_places,
)
from evaluator.cli.options import BatchOptions, batch_options
from evaluator.turning import only_mark

if TYPE_CHECKING:
    from evaluator.workflow import Analysis


@click.command(epilog=f"{STATUS_NOTE}\n\n\b\nExample:\n  turnscope analyze experiment.toml -o out/")
@batch_options
def analyze(options: BatchOptions) -> int:
    """Track every run of an experiment, reconstruct its poses and measure its turning radius.

    Writes turning.csv (a row per run), pooled.csv (repetitions of a command pooled), directions.csv (backward against
    forward), marks/RUN.csv and poses/RUN.csv. Results that are up to date are reused, so an interrupted command
    continues where it stopped.

    A run may have marks = "r01.csv" instead of video: a table with time_s and, for every mark of the robot, NAME_x_mm
    and NAME_y_mm on the plane of the marks, with empty cells for a missing mark. Files of OSP Tracker, DeepLabCut,
    SLEAP and movement are read as well; [tracks] of experiment.toml gives their mark names, unit and frame rate.
    """
    if options.dry_run:
        return print_plan(options, simulate=False)
    found = run_analysis(options, simulate=False)
    if options.as_json:
        print_json(found.turning)
    elif not options.quiet:
        click.echo(turning_text(found, verbose=options.verbose))
        click.echo(f"\n{found.outputs.turning}")
    return status_of(found)


def turning_text(found: Analysis, *, verbose: bool) -> str:
    """Text table of the measured runs."""
    from evaluator.cli.tables import text_table
    from evaluator.report.numbers import command_text, number, true_minus

    unit, rows = length_unit(found), []
    measured = [row for row in found.turning.to_dict("records") if row["run"] not in found.faults]
    for row in measured:
        cells = [
            name_of(row, found.excluded_runs),
            command_text(row["left_rpm"], row["right_rpm"]),
            *radius(row, unit),
            number(row[named_after(only_mark(row), "speed_mm_s")] / unit.mm, 3),
        ]
        rows.append([*cells, true_minus(str(row["radius_status"]))] if verbose else cells)
    head = ["run", "rpm left / right", f"radius, {unit.name}", "95 %", f"speed, {unit.name}/s"]
    dashes = [] if verbose else reasons_of_dashes(measured, unit)
    return "\n".join([text_table([*head, "remark"] if verbose else head, rows), *dashes, *without_places(found)])
