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
    from evaluator.workflow import copy_samples, prepare_processes

    def say(text: str = "") -> None:
        if not quiet:
            click.echo(text)

    prepare_processes()  # they import while this process does
    recording = copy_samples(out / "samples").parent / "turn-33-5.mp4"
    say("Samples: rendered recordings of the paper's robot with barrel wheels, and images of a dot gauge;")
    say(f"  for example {recording}")
    say("Calibration of the camera …")
    from evaluator.workflow import prepare_samples

    with progress_bar("calibration", quiet=quiet) as progress:
        samples = prepare_samples(out / "samples", progress)
    solved = samples.calibrated.calibration
    residual = f"{len(solved.views)} images, residual {solved.rms_px:.3f} px RMS"
    say(f"  {residual}; {samples.calibrated.verdict.summary}")
    from evaluator.cli.analysis import run_analysis, status_of
    from evaluator.cli.experiment.compare import comparison_text
    from evaluator.cli.measurement.analyze import turning_text
    from evaluator.report.build import write_report
    from evaluator.workflow import available_cores, measure

    # All recordings are measured before a run is simulated: the first demo compiles the simulator meanwhile, on a core
    # that is left to it because all else then waits for it.
    measuring = max(available_cores() - 1, 1) if samples.compiling and workers is None else workers
    known = BatchOptions(samples.experiment, out / "results", workers, quiet=quiet)
    hidden = BatchOptions(samples.puzzle, out / "puzzle", workers, quiet=quiet)
    say("Runs: tracking, measurement …")
    with progress_bar("runs", quiet=quiet) as progress:
        found = measure(known.experiment, known.out, workers=measuring, progress=progress)
    say(_indented(turning_text(found, verbose=False)))
    if puzzle:
        say("Puzzle: recordings of a robot with an effect that its model lacks, and with mistakes in the file …")
        with progress_bar("runs", quiet=quiet) as progress:
            measure(hidden.experiment, hidden.out, workers=measuring, progress=progress)
    say("Simulation …")
    measured = run_analysis(known, simulate=True)
    say(_indented(comparison_text(measured, verbose=False)))
    write_report(measured)
    say(f"  {measured.outputs.report}")
    reports = [measured]
    if puzzle:
        say("Puzzle: simulation, diagnosis …")
        reports.append(_solve(hidden))
        write_report(reports[-1])
    say("\nOpen in a browser:")
    for each in reports:
        say(f"  {each.outputs.report}")
    say("\nFor your own recordings: turnscope new FOLDER writes the files to fill in and lists the next steps.")
    return max(status_of(each) for each in reports)


def _solve(options: BatchOptions) -> Analysis:
    """Simulate and diagnose the experiment with a hidden effect, and print the verdict."""
    from evaluator.cli.analysis import run_analysis
    from evaluator.report.verdict import verdict_lines
    from evaluator.workflow import diagnose

    measured = run_analysis(options, simulate=True, notes=False)  # the diagnosis reports mistakes
    with progress_bar("diagnosis", quiet=options.quiet) as progress:
        found = diagnose(options.experiment, options.out, workers=options.workers, progress=progress)
    if not options.quiet:
        click.echo(_indented("\n".join(verdict_lines(found.content))))
    return measured


def _indented(text: str) -> str:
    return "\n".join(f"  {line}" for line in text.splitlines())
