"""turnscope report: from an experiment to one page."""

from __future__ import annotations

import json

import click

from evaluator.cli.analysis import STATUS_NOTE, print_plan, run_analysis, status_of
from evaluator.cli.experiment.compare import comparison_text
from evaluator.cli.options import BatchOptions, batch_options


@click.command(epilog=f"{STATUS_NOTE}\n\n\b\nExample:\n  turnscope report experiment.toml -o out/")
@batch_options
def report(options: BatchOptions) -> int:
    """Write the HTML report of an experiment.

    Results that are missing or out of date are computed first (see turnscope compare). The report is a single file that
    can be mailed, printed and read on a phone.
    """
    if options.dry_run:
        return print_plan(options, simulate=True)
    found = run_analysis(options, simulate=True)
    from evaluator.report.build import write_report
    from evaluator.report.diagnosis.view import OUTDATED

    diagnosis = write_report(found)
    if diagnosis and diagnosis.outdated and not options.quiet:
        click.echo(f"note: {OUTDATED}", err=True)
    if options.as_json:
        click.echo(json.dumps({"report": str(found.outputs.report), "faults": found.faults}, indent=1))
    elif not options.quiet:
        if options.verbose:
            click.echo(comparison_text(found, verbose=True))
        click.echo(f"{found.outputs.report}")
    return status_of(found)
