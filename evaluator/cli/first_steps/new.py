"""turnscope new: templates for an experiment."""

from __future__ import annotations

from pathlib import Path

import click

from evaluator.cli.options import PATH


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
