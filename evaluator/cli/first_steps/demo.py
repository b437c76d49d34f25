"""turnscope demo: the whole pipeline on the shipped sample recordings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from evaluator.cli.options import PATH, BatchOptions, quiet_option, workers_option
from evaluator.cli.progress import progress_bar

if TYPE_CHECKING:
    from evaluator.workflow import Analysis


@click.command(epilog="\b\nExamples:\n  turnscope demo\n  turnscope demo -o /tmp/look --workers 1")
@click.option(
    "-o",
    "--out",
    type=PATH,
    default=Path("turnscope-demo"),
    show_default=True,
    metavar="DIR",
    help="Folder to work in.",
)
@click.option(
    "--puzzle/--no-puzzle",
    default=True,
    show_default=True,
    help="Also find the hidden effect in a second set of recordings.",
)
@workers_option
@quiet_option
def demo(out: Path, puzzle: bool, workers: int | None, quiet: bool) -> int:
    """Run the whole pipeline on the shipped sample videos.

    Copies the samples, calibrates the camera from gauge images, tracks, measures and simulates every run, and writes
    the report. Then it finds the hidden effect in a second set of recordings and writes a report of that, too.
    """
    from evaluator.cli.analysis import run_analysis, status_of
    from evaluator.cli.experiment.compare import comparison_text
    from evaluator.report.build import write_report
    from evaluator.workflow import prepare_samples

    def say(text: str = "") -> None:
        if not quiet:
            click.echo(text)

    say("Samples: rendered recordings of the paper's robot with barrel wheels, and images of a dot gauge.")
    say("Calibration of the camera …")
    with progress_bar("calibration", quiet=quiet) as progress:
        samples = prepare_samples(out / "samples", progress)
    found = samples.calibrated.calibration
    residual = f"{len(found.views)} images, residual {found.rms_px:.3f} px RMS"
    say(f"  {residual}; {samples.calibrated.verdict.summary}")
    say("Runs: tracking, measurement, simulation …")
    measured = run_analysis(BatchOptions(samples.experiment, out / "results", workers, quiet=quiet), simulate=True)
    say(_indented(comparison_text(measured, verbose=False)))
    write_report(measured)
    reports = [measured]
    if puzzle:
        say()
        reports.append(_solve_puzzle(samples.puzzle, out / "puzzle", workers, quiet=quiet))
    say("\nOpen in a browser:")
    for each in reports:
        say(f"  {each.outputs.report}")
    say("\nFor your own recordings: turnscope new FOLDER writes the files to fill in and lists the next steps.")
    return max(status_of(each) for each in reports)


def _solve_puzzle(experiment: Path, out: Path, workers: int | None, *, quiet: bool) -> Analysis:
    """Measure and diagnose the experiment with a hidden effect, and write its report."""
    from evaluator.cli.analysis import run_analysis
    from evaluator.report.build import write_report
    from evaluator.report.verdict import verdict_lines
    from evaluator.workflow import diagnose

    if not quiet:
        click.echo("Puzzle: recordings of a robot with an effect that its model lacks, and with mistakes in the file.")
    options = BatchOptions(experiment, out, workers, quiet=quiet)
    measured = run_analysis(options, simulate=True, notes=False)  # the diagnosis reports mistakes
    with progress_bar("diagnosis", quiet=quiet) as progress:
        found = diagnose(experiment, out, workers=workers, progress=progress)
    if not quiet:
        click.echo(_indented("\n".join(verdict_lines(found.content))))
    write_report(measured)
    return measured


def _indented(text: str) -> str:
    return "\n".join(f"  {line}" for line in text.splitlines())
