"""turnscope export-robot: a robot file for other simulators, and what is lost in it."""

from __future__ import annotations

from pathlib import Path

import click

from evaluator.cli.options import PATH, quiet_option

KINDS = {".xml": "mjcf", ".mjcf": "mjcf", ".sdf": "sdf"}  # formats by the ending of a file


@click.command(
    epilog="\b\nExample:\n  turnscope export-robot barrel --left 33.3 --right 14.4 -o barrel.xml\n"
    "  python -m mujoco.viewer --mjcf=barrel.xml"
)
@click.argument("robot", metavar="NAME|ROBOT.toml")
@click.option(
    "--format",
    "kind",
    type=click.Choice(["mjcf", "sdf"]),
    help="mjcf for MuJoCo, sdf for Gazebo. [default: by the ending of FILE, .xml or .sdf]",
)
@click.option("--left", "left_rpm", type=float, default=33.3, show_default=True, help="Command of the turn, rpm.")
@click.option("--right", "right_rpm", type=float, default=14.4, show_default=True, help="Command of the turn, rpm.")
@click.option("-o", "--out", "output", type=PATH, required=True, metavar="FILE", help="File to write.")
@quiet_option
def export_robot(robot: str, kind: str | None, left_rpm: float, right_rpm: float, output: Path, quiet: bool) -> None:
    """Export a robot to MuJoCo or Gazebo, and list what is lost.

    Other simulators have no slip curve. Their contact parameters are matched to the slip law at one steady turn
    (--left, --right), whose radius they reproduce.
    """
    from evaluator.workflow import export_robot as export

    ending = output.suffix.lower()
    if kind is None and ending not in KINDS:
        raise click.BadParameter(f"{output} ends neither in .xml nor in .sdf: give --format.", param_hint="--out")
    lost = export(robot, output, left_rpm, right_rpm, kind or KINDS[ending])
    if not quiet:
        click.echo(f"{output}\n\nWhat was lost:\n" + "\n".join(f"- {sentence}" for sentence in lost))
