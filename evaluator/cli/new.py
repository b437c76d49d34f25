"""turnscope new, turnscope check: templates for an experiment, and validation of its files."""

from __future__ import annotations

import json
from pathlib import Path

import click

from evaluator.cli.guard import BAD_INPUT
from evaluator.cli.options import PATH, experiment_argument, json_option, quiet_option, say_mended, write_mended_option
from evaluator.wording import counted


@click.command(epilog="\b\nExamples:\n  turnscope new monday\n  turnscope new monday --robot column")
@click.argument("folder", type=PATH, metavar="DIR")
@click.option("--robot", default="barrel", show_default=True, metavar="NAME", help="Shipped robot to start from.")
def new(folder: Path, robot: str) -> None:
    """Write commented templates of all files of a new experiment to DIR.

    Existing files are never overwritten.
    """
    from evaluator.workflow import new_experiment

    written = new_experiment(folder, robot)
    click.echo(f"{folder}: {', '.join(path.name for path in written)}")
    click.echo(f"""
Next:
  1. describe your robot in robot.toml and your gauge in gauge.toml (print it: turnscope gauge {folder / "gauge.toml"})
  2. turnscope calibrate IMAGES… --gauge {folder / "gauge.toml"} -o {folder / "camera.json"}
  3. record runs and list them in {folder / "experiment.toml"} (turnscope plan proposes which)
  4. turnscope check {folder / "experiment.toml"}
  5. turnscope report {folder / "experiment.toml"} -o {folder / "out"}""")


@click.command(epilog="\b\nExamples:\n  turnscope check experiment.toml\n  turnscope check experiment.toml --json")
@experiment_argument
@write_mended_option
@json_option
@quiet_option
def check(experiment: Path, mend: bool, as_json: bool, quiet: bool) -> int:
    """Validate all files of an experiment and report all errors together.

    Exit status: 0, no error; 2, errors or probable mistakes.
    """
    from evaluator.workflow import check_experiment

    found = check_experiment(experiment)
    if as_json:
        content = {"faults": found.faults, "mistakes": found.mistakes, "runs": found.runs, "videos": found.videos}
        click.echo(json.dumps(content, indent=1, ensure_ascii=False))
    else:
        for fault in found.faults:
            click.echo(f"error: {fault}", err=True)
        for mistake in found.mistakes:
            click.echo(f"mistake? {mistake}", err=True)
        if not found.faults and not found.mistakes and not quiet:
            click.echo(f"{experiment}: no errors; {counted(found.runs, 'run')}, {found.videos} from video")
    if mend and not found.faults:
        say_mended(experiment)
    return BAD_INPUT if found.faults or found.mistakes else 0
