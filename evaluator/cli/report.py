"""turnscope report: from an experiment to one page."""

from __future__ import annotations

import json
from pathlib import Path

import click

from evaluator.cli.analyze import STATUS_NOTE, comparison_text, print_plan, run_analysis, status_of
from evaluator.cli.options import batch_options


@click.command(epilog=f"{STATUS_NOTE}\n\n\b\nExample:\n  turnscope report experiment.toml -o out/")
@batch_options
def report(
    experiment: Path,
    out: Path,
    workers: int | None,
    dask: str | None,
    as_json: bool,
    quiet: bool,
    verbose: bool,
    dry_run: bool,
) -> int:
    """Make the report of an experiment, computing what it needs.

    Everything is computed that is not up to date (see `turnscope compare`); the report is one HTML file that can be
    mailed, printed and read on a phone.
    """
    if dry_run:
        return print_plan(experiment, out, simulate=True)
    found = run_analysis(experiment, out, simulate=True, workers=workers, dask=dask, quiet=quiet)
    from evaluator.report.build import write_report

    write_report(found)
    if as_json:
        click.echo(json.dumps({"report": str(found.outputs.report), "faults": found.faults}, indent=1))
    elif not quiet:
        if verbose:
            click.echo(comparison_text(found, verbose=True))
        click.echo(f"{found.outputs.report}")
    return status_of(found)
