"""turnscope trends: several sessions of one robot on one page."""

from __future__ import annotations

from pathlib import Path

import click

from evaluator.cli.options import PATH, json_option, quiet_option


@click.command(epilog="\b\nExample:\n  turnscope trends out/monday out/tuesday out/friday -o trends.html")
@click.argument("folders", type=PATH, nargs=-1, required=True, metavar="FOLDER...")
@click.option(
    "-o", "--out", type=PATH, default=Path("trends.html"), show_default=True, metavar="FILE.html", help="The page."
)
@json_option
@quiet_option
def trends(folders: tuple[Path, ...], out: Path, as_json: bool, quiet: bool) -> None:
    """Compare several sessions of one robot: what changed, when, and by how much.

    FOLDERs are output folders of turnscope analyze or report. If they hold a diagnosis, the sizes of its effects are
    included. Sessions are ordered by date = 2026-03-12 in their experiment.toml, or without dates as given. Writes an
    HTML page and its numbers as CSV.
    """
    from evaluator.report.pages.trends import change_sentences, write_trends
    from evaluator.trends.trends import compare_sessions

    found = compare_sessions(folders)
    table = write_trends(found, out)
    if as_json:
        click.echo(table.to_json(orient="records", indent=1, date_format="iso"))
    elif not quiet:
        for sentence in change_sentences(found):
            click.echo(sentence)
        click.echo(f"\n{out}")
