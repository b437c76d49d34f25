"""turnscope selftest: the accuracy claims of this version, checked on the user's machine."""

from __future__ import annotations

from pathlib import Path

import click

from evaluator.cli.options import PATH, quiet_option


@click.command(epilog="\b\nExamples:\n  turnscope selftest\n  turnscope selftest -o /tmp/look --seed 7")
@click.option(
    "-o",
    "--out",
    type=PATH,
    default=Path("turnscope-selftest"),
    show_default=True,
    metavar="DIR",
    help="Folder to work in.",
)
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Seed of all random numbers.")
@quiet_option
def selftest(out: Path, seed: int, quiet: bool) -> int:
    """Check the accuracy claims of this version on this machine.

    Renders gauge images and a turn, calibrates the camera, tracks, fits and simulates. Then it diagnoses runs with a
    hidden effect, a late start and one run with left and right exchanged. Compares each figure with its claimed limit
    and writes a page that you can send to a maintainer. Exit status 1 if a claim does not hold.
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
