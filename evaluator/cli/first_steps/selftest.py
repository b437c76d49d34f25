"""turnscope selftest: the accuracy claims of this version, checked on the user's machine."""

from __future__ import annotations

from pathlib import Path

import click

from evaluator.cli.options import FOLDER, quiet_option, seed_option


@click.command(epilog="\b\nExamples:\n  turnscope selftest\n  turnscope selftest -o /tmp/look --seed 7")
@click.option(
    "-o",
    "--out",
    type=FOLDER,
    default=Path("turnscope-selftest"),
    show_default=True,
    metavar="DIR",
    help="Folder to work in.",
)
@seed_option(1, "Seed of all random numbers.")
@quiet_option
def selftest(out: Path, seed: int, quiet: bool) -> int:
    """Check the accuracy claims of this version on this machine.

    Renders gauge images and a turn, calibrates the camera, tracks, fits and simulates. Then it diagnoses runs with a
    hidden effect, a late start and one run with left and right exchanged. Compares each figure with its claimed limit
    and writes a page that you can send to a maintainer. Exit status 1 if a claim does not hold.
    """
    from evaluator.cli.progress import progress_bar
    from evaluator.cli.tables import text_table
    from evaluator.files.writing import require_room_for
    from evaluator.report.pages.selftest import HEAD, outcome_rows, sentence_of, write_selftest
    from evaluator.workflow import self_test

    page = out / "selftest.html"
    require_room_for(page)
    with progress_bar("self-test", quiet=quiet) as progress:
        found = self_test(out, seed=seed, progress=progress)
    write_selftest(found, page)
    if not quiet:
        click.echo(text_table(HEAD, outcome_rows(found)))
        click.echo(f"\n{sentence_of(found)}\n{page}")
    return int(not found.holds)
