"""turnscope demo: the whole pipeline on the shipped sample recordings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from evaluator.cli.options import PATH, quiet_option, workers_option
from evaluator.cli.progress import progress_bar

if TYPE_CHECKING:
    from evaluator.workflow import Analysis


@click.command(epilog="\b\nExample:\n  turnscope demo\n  turnscope demo -o /tmp/look --workers 1")
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
    help="Also find what a second set of clips hides.",
)
@workers_option
@quiet_option
def demo(out: Path, puzzle: bool, workers: int | None, quiet: bool) -> int:
    """Run the whole pipeline on the shipped sample videos.

    Copies the samples, calibrates the camera from the gauge pictures, tracks and measures every run, simulates its
    counterpart and writes the report. Then it finds the effect that is hidden in a second set of recordings, and
    reports that too; --no-puzzle leaves this out.
    """
    from evaluator.cli.analyze import comparison_text, run_analysis, status_of
    from evaluator.report.build import write_report
    from evaluator.workflow.execution.precompile import compile_ahead
    from evaluator.workflow.samples import copy_samples

    def say(text: str = "") -> None:
        if not quiet:
            click.echo(text)

    say("Samples: rendered recordings of the paper's robot with barrel wheels, and pictures of a dot gauge.")
    experiment = copy_samples(out / "samples")
    compile_ahead(experiment.parent / "turn-33-5.mp4")
    say("Calibration: where every pixel lies on the plane of the marks …")
    say(f"  {calibrate_samples(experiment.parent)}")
    say("Runs: tracked, fitted, simulated …")
    found = run_analysis(experiment, out / "results", simulate=True, workers=workers, quiet=quiet)
    say(_indented(comparison_text(found, verbose=False)))
    write_report(found)
    reports = [found]
    if puzzle:
        say()
        reports.append(
            _solve_puzzle(experiment.parent / "puzzle" / "experiment.toml", out / "puzzle", workers, quiet=quiet)
        )
    say("\nOpen in a browser:")
    for each in reports:
        say(f"  {each.outputs.report}")
    return max(status_of(each) for each in reports)


def _solve_puzzle(experiment: Path, out: Path, workers: int | None, *, quiet: bool) -> Analysis:
    """Measure the experiment with a hidden effect, have the effect named, and report before and after."""
    from evaluator.cli.analyze import run_analysis
    from evaluator.cli.diagnose import summary
    from evaluator.report.build import write_report
    from evaluator.workflow.diagnosis import diagnose_experiment

    if not quiet:
        click.echo("Puzzle: recordings of a robot with something that its model does not know.")
    found = run_analysis(experiment, out, simulate=True, workers=workers, quiet=quiet)
    with progress_bar("diagnosis", quiet=quiet) as bar:
        _, content = diagnose_experiment(experiment, out, lambda _, share: bar(round(100 * share), 100))
    if not quiet:
        click.echo(_indented("\n".join(summary(content))))
    write_report(found)
    return found


def calibrate_samples(folder: Path) -> str:
    """Write camera.json from the gauge pictures; returns the verdict in words."""
    from calibration.assessment.quality import assess
    from calibration.detection.image import read_image
    from calibration.estimation.calibrate import calibrate
    from calibration.gauge.geometry import load_gauge
    from calibration.store import camera_to_json
    from evaluator.files import read_with, write_text

    pictures = sorted(folder.glob("gauge-*.png"))
    gauge = read_with(load_gauge, folder / "gauge.toml")
    found = calibrate([read_image(path) for path in pictures], gauge, names=[path.name for path in pictures])
    verdict = assess(found)
    write_text(folder / "camera.json", camera_to_json(found, verdict))
    return f"{len(pictures)} pictures, residual {found.rms_px:.3f} px RMS; {verdict.summary}"


def _indented(text: str) -> str:
    return "\n".join(f"  {line}" for line in text.splitlines())
