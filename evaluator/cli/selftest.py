"""turnscope selftest: what this version claims, tried on the user's own machine."""

from __future__ import annotations

from pathlib import Path

import click

from evaluator.cli.options import PATH, quiet_option


@click.command(epilog="\b\nExample:\n  turnscope selftest\n  turnscope selftest -o /tmp/look --seed 7")
@click.option(
    "-o",
    "--out",
    type=PATH,
    default=Path("turnscope-selftest"),
    show_default=True,
    metavar="DIR",
    help="Folder to work in.",
)
@click.option(
    "--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Of all noise: another one, another draw."
)
@quiet_option
def selftest(out: Path, seed: int, quiet: bool) -> int:
    """Try on this machine what this version claims.

    Renders gauge images and a turn, solves the camera, tracks, fits, simulates, and has a hidden effect named in runs
    that start late and of which one has its sides exchanged. Compares each figure with what this version claims, and
    writes one page to send to a maintainer. Exit status 1 where a claim does not hold.
    """
    from evaluator.cli.progress import progress_bar
    from evaluator.cli.tables import text_table
    from evaluator.report.pages.selftest import HEAD, outcome_rows, sentence_of, write_selftest
    from evaluator.workflow import self_test

    with progress_bar("self-test", quiet=quiet) as progress:
        found = self_test(out, seed=seed, progress=progress)
    page = out / "selftest.html"
    write_selftest(found, page)
    if not quiet:
        click.echo(text_table(HEAD, outcome_rows(found)))
        click.echo(f"\n{sentence_of(found)}\n{page}")
    return int(not found.holds)
