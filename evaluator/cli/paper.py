"""turnscope paper: every published figure and number, recomputed."""

from __future__ import annotations

from pathlib import Path

import click

from evaluator.cli.options import out_option, quiet_option


@click.command(epilog="\b\nExample:\n  turnscope paper -o paper/")
@out_option
@quiet_option
def paper(out: Path, quiet: bool) -> None:
    """Recompute every published figure and number.

    Prints published values beside ours, and writes index.html with all figures, each figure as SVG and its data as CSV,
    numbers.csv and readings.csv (the ways to read the paper's equations, and the radii each gives).
    """
    from evaluator.cli.progress import progress_bar
    from evaluator.cli.tables import text_table
    from evaluator.report.pages.paper import check_table, recompute, write_paper

    with progress_bar("recomputing", quiet=quiet) as progress:
        found = recompute(progress)
    page = write_paper(found, out)
    if not quiet:
        table = check_table(found.checks)
        click.echo(text_table(list(table.columns), table.to_numpy().tolist()))
        click.echo(f"\n{page}")
