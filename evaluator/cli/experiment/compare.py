"""turnscope compare: an experiment in, a table of measured and simulated runs out."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import click

from evaluator.cli.analysis import (
    DASH,
    STATUS_NOTE,
    TOO_LITTLE,
    length_unit,
    name_of,
    named_after,
    print_json,
    print_plan,
    radius,
    run_analysis,
    status_of,
    without_places,
)
from evaluator.cli.options import BatchOptions, batch_options
from evaluator.turning import only_mark

if TYPE_CHECKING:
    from evaluator.workflow import Analysis


@click.command(epilog=f"{STATUS_NOTE}\n\n\b\nExample:\n  turnscope compare experiment.toml -o out/")
@batch_options
def compare(options: BatchOptions) -> int:
    """Compare every run with its simulation.

    Writes comparison.csv (a row per run) and simulated/RUN.csv, in addition to the files of turnscope analyze. The
    simulation has the same command, starts at the measured pose, and its marks pass through the same estimator.
    """
    if options.dry_run:
        return print_plan(options, simulate=True)
    found = run_analysis(options, simulate=True)
    assert found.comparison is not None
    if options.as_json:
        print_json(found.comparison)
    elif not options.quiet:
        click.echo(comparison_text(found, verbose=options.verbose))
        click.echo(f"\n{found.outputs.comparison}")
    return status_of(found)


def comparison_text(found: Analysis, *, verbose: bool) -> str:
    """Text table of measured and simulated runs."""
    from evaluator.cli.tables import text_table
    from evaluator.report.numbers import UNKNOWN, command_text, number

    assert found.comparison is not None
    unit, rows = length_unit(found), []
    for row, measured in zip(found.comparison.to_dict("records"), found.turning.to_dict("records"), strict=True):
        if row["run"] in found.faults:
            continue
        command = command_text(row["left_rpm"], row["right_rpm"])
        simulated = row[f"simulated_{named_after(only_mark(measured), 'radius_mm')}"]
        seen = radius(measured, unit)
        known_way = seen[0] not in (TOO_LITTLE, DASH) or row["left_rpm"] == row["right_rpm"]
        nothing = "straight" if math.isfinite(row["left_rpm"]) and known_way else UNKNOWN
        known = f"{simulated / unit.mm:.3f}" if math.isfinite(simulated) else nothing
        cells = [name_of(row, found.excluded_runs), command, *seen, known, f"{row['gap_rms_mm'] / unit.mm:.3f}"]
        rows.append([*cells, number(row["heading_gap_end_deg"], 2)] if verbose else cells)
    lengths = f"radius, {unit.name}", "95 %", f"simulated, {unit.name}", f"path gap, {unit.name}"
    head = ["run", "rpm left / right", *lengths]
    return "\n".join([text_table([*head, "heading gap, deg"] if verbose else head, rows), *without_places(found)])
