"""turnscope demo: the whole pipeline on the shipped sample recordings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from evaluator.cli.options import FOLDER, BatchOptions, quiet_option, workers_option
from evaluator.cli.progress import progress_bar

if TYPE_CHECKING:
    from evaluator.workflow import Analysis


@click.command(epilog="\b\nExamples:\n  turnscope demo\n  turnscope demo -o /tmp/look --workers 1")
@click.option(
    "-o",
    "--out",
    type=FOLDER,
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
    the report. Then it finds the hidden effect in a second set of recordings and writes a report of that, too. The
    page index.html in the folder shows every result as soon as it is known.
    """
    from evaluator.workflow import copy_samples, prepare_processes

    prepare_processes()  # they import while this process does
    recording = copy_samples(out / "samples").parent / "turn-33-5.mp4"
    shown = _Shown(out / "index.html", quiet=quiet)
    shown.say("Samples: rendered recordings of the paper's robot with barrel wheels, and images of a dot gauge;")
    shown.say(f"  for example {recording}")
    shown.recording(recording)
    from evaluator.workflow import prepare_samples

    shown.say("Calibration of the camera …")
    with progress_bar("calibration", quiet=quiet) as progress:
        samples = prepare_samples(out / "samples", progress)
    solved = samples.calibrated.calibration
    residual = f"{len(solved.views)} images, residual {solved.rms_px:.3f} px RMS"
    shown.result("Calibration of the camera", f"{residual}; {samples.calibrated.verdict.summary}", table=False)
    from evaluator.cli.analysis import run_analysis, status_of
    from evaluator.cli.experiment.compare import comparison_text
    from evaluator.workflow import available_cores

    # All recordings are measured before a run is simulated: the first demo compiles the simulator meanwhile, on a core
    # that is left to it because all else then waits for it.
    measuring = max(available_cores() - 1, 1) if samples.compiling and workers is None else workers
    known = BatchOptions(samples.experiment, out / "results", workers, quiet=quiet)
    hidden = BatchOptions(samples.puzzle, out / "puzzle", workers, quiet=quiet)
    shown.say("Runs: tracking, measurement …")
    shown.result("Runs of the experiment", _measured(known, measuring))
    if puzzle:
        shown.say("Puzzle: recordings of a robot with an effect that its model lacks, and with mistakes in the file …")
        shown.result("Runs of the puzzle", _measured(hidden, measuring))
    shown.say("Simulation …")
    reports = [run_analysis(known, simulate=True)]
    shown.result("Measured and simulated", comparison_text(reports[0], verbose=False))
    shown.report("Report of the experiment", reports[0], last=not puzzle)
    if puzzle:
        shown.say("Puzzle: simulation, diagnosis …")
        solution, verdict = _solve(hidden)
        shown.result("Diagnosis of the puzzle", verdict, table=False)
        shown.report("Report of the puzzle", solution, last=True)
        reports.append(solution)
    shown.say("\nOpen in a browser:")
    for each in reports:
        shown.say(f"  {each.outputs.report}")
    shown.say("\nFor your own recordings: turnscope new FOLDER writes the files to fill in and lists the next steps.")
    return max(status_of(each) for each in reports)


class _Shown:
    """What is shown on the terminal, unless it is quiet, and on the page."""

    def __init__(self, page: Path, *, quiet: bool) -> None:
        from evaluator.report.pages.demo import DemoPage

        self._page, self._quiet = DemoPage(page), quiet

    def say(self, text: str) -> None:
        """Print a text."""
        if not self._quiet:
            click.echo(text)

    def recording(self, video: Path) -> None:
        """Show a recording on the page, and say where the page is."""
        self._page.show_recording(video)
        self.say(f"Every result appears at once on a page for a browser: {self._page.path}")

    def result(self, title: str, text: str, *, table: bool = True) -> None:
        """Show a result: a table, or lines of sentences."""
        self.say(_indented(text))
        self._page.show_result(title, text, table=table)

    def report(self, title: str, analysis: Analysis, *, last: bool) -> None:
        """Write a report and link to it."""
        from evaluator.report.build import write_report

        write_report(analysis)
        self._page.show_report(title, analysis.outputs.report, last=last)
        self.say(f"  {analysis.outputs.report}")


def _measured(options: BatchOptions, workers: int | None) -> str:
    """Measure all recordings of an experiment; returns its table."""
    from evaluator.cli.measurement.analyze import turning_text
    from evaluator.workflow import measure

    with progress_bar("runs", quiet=options.quiet) as progress:
        found = measure(options.experiment, options.out, workers=workers, progress=progress)
    return turning_text(found, verbose=False)


def _solve(options: BatchOptions) -> tuple[Analysis, str]:
    """Simulate and diagnose the experiment with a hidden effect; returns the verdict, too."""
    from evaluator.cli.analysis import run_analysis
    from evaluator.report.verdict import verdict_lines
    from evaluator.workflow import diagnose

    measured = run_analysis(options, simulate=True, notes=False)  # the diagnosis reports mistakes
    with progress_bar("diagnosis", quiet=options.quiet) as progress:
        found = diagnose(options.experiment, options.out, workers=options.workers, progress=progress)
    return measured, "\n".join(verdict_lines(found.content))


def _indented(text: str) -> str:
    return "\n".join(f"  {line}" for line in text.splitlines())
