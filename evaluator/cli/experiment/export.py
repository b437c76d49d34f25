"""turnscope export: results for other programs."""

from __future__ import annotations

from pathlib import Path

import click

from evaluator.cli.analysis import STATUS_NOTE, print_plan, run_analysis, status_of
from evaluator.cli.options import (
    BatchOptions,
    dry_run_option,
    experiment_argument,
    out_option,
    quiet_option,
    workers_option,
)


@click.command(epilog=f"{STATUS_NOTE}\n\n\b\nExample:\n  turnscope export experiment.toml -o out/")
@experiment_argument
@out_option
@workers_option
@quiet_option
@dry_run_option
def export(experiment: Path, out: Path, workers: int | None, quiet: bool, dry_run: bool) -> int:
    """Write the results as JSON and netCDF, with their provenance.

    results.json holds all results of every run; netcdf/RUN.nc holds marks and poses in the layout of the movement
    toolbox. Results that are missing or out of date are computed first.
    """
    if dry_run:
        return print_plan(BatchOptions(experiment, out), simulate=True)
    found = run_analysis(BatchOptions(experiment, out, workers, quiet=quiet), simulate=True)
    from evaluator.workflow import export as write_all

    for path in write_all(found):
        if not quiet:
            click.echo(path)
    return status_of(found)
