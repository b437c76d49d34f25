"""turnscope paper: every published figure and number, recomputed."""

from __future__ import annotations

from pathlib import Path

import click

from evaluator.cli.options import out_option, quiet_option

ORDER = ["source", "standing", "verdict", "quantity", "published", "ours", "difference"]  # standing of a row first


@click.command(epilog="\b\nExample:\n  turnscope paper -o paper/")
@out_option
@quiet_option
def paper(out: Path, quiet: bool) -> None:
    """Recompute every published figure and number.

    Prints published and recomputed values, with the standing of each row: computed, fitted to this figure, conjecture,
    not reproduced, or out of scope. Writes index.html with all figures, each figure as SVG and its data as CSV,
    numbers.csv, and readings.csv (possible readings of the paper's equations and the radii that each gives).
    """
    from evaluator.cli.progress import progress_bar
    from evaluator.cli.tables import text_table
    from evaluator.files.writing import require_room_for
    from evaluator.report.numbers import true_minus
    from evaluator.report.pages.paper import check_table, recompute, summary_lines, write_paper

    require_room_for(out / "index.html")
    with progress_bar("recomputing", quiet=quiet) as progress:
        found = recompute(progress)
    page = write_paper(found, out)
    if not quiet:
        table = check_table(found.checks)[ORDER]
        click.echo(true_minus(text_table(list(table.columns), table.to_numpy().tolist())))
        click.echo("\n" + "\n".join(summary_lines(found.checks)))
        click.echo(f"\n{page}")
