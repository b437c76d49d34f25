"""turnscope export-robot: a robot file for other simulators, and what is lost by it."""

from __future__ import annotations

from pathlib import Path

import click

from evaluator.cli.options import PATH, quiet_option


@click.command(
    epilog="\b\nExample:\n  turnscope export-robot barrel --left 33.3 --right 14.4 -o barrel.xml\n"
    "  python -m mujoco.viewer --mjcf=barrel.xml"
)
@click.argument("robot", metavar="NAME|ROBOT.toml")
@click.option("--format", "kind", type=click.Choice(["mjcf"]), default="mjcf", show_default=True, help="MuJoCo.")
@click.option("--left", "left_rpm", type=float, default=33.3, show_default=True, help="Command of the turn, rpm.")
@click.option("--right", "right_rpm", type=float, default=14.4, show_default=True, help="Command of the turn, rpm.")
@click.option("-o", "--out", "output", type=PATH, required=True, metavar="FILE", help="File to write.")
@quiet_option
def export_robot(robot: str, kind: str, left_rpm: float, right_rpm: float, output: Path, quiet: bool) -> None:
    """Write a robot as another simulator reads it, and say what was lost.

    Contacts of other simulators know no slip curve. Theirs are matched at one steady turn (--left, --right), whose
    radius they reproduce.
    """
    from evaluator.workflow import export_robot as export

    del kind  # there is one so far
    lost = export(robot, output, left_rpm, right_rpm)
    if not quiet:
        click.echo(f"{output}\n\nWhat was lost:\n" + "\n".join(f"- {sentence}" for sentence in lost))
