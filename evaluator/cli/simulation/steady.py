"""turnscope steady: turning radii over speeds and ratios of the wheels, without simulating a run."""

from __future__ import annotations

from pathlib import Path

import click

from evaluator.cli.options import PATH, quiet_option


@click.command(
    epilog="\b\nExamples:\n  turnscope steady --robot barrel --left 33.3 -o turns.csv\n"
    "  turnscope steady --robot robot.toml --left 20 --left 50 --ratios 1 -0.9 39 -o turns.csv"
)
@click.option("--robot", default="barrel", show_default=True, metavar="NAME|FILE", help="Shipped robot or robot.toml.")
@click.option(
    "--left",
    "left_rpm",
    type=float,
    multiple=True,
    required=True,
    metavar="RPM",
    help="Speed of the left wheel; may be repeated.",
)
@click.option(
    "--ratios",
    type=(float, float, click.IntRange(min=1, max=100_000)),
    default=(0.9, 0.0, 19),
    show_default=True,
    metavar="FIRST LAST COUNT",
    help="Right over left speed; negative: opposite directions.",
)
@click.option("-o", "--out", "output", type=PATH, required=True, metavar="CSV", help="Table to write, a row per turn.")
@quiet_option
def steady(
    robot: str, left_rpm: tuple[float, ...], ratios: tuple[float, float, int], output: Path, quiet: bool
) -> None:
    """Tabulate the steady turns of a robot over speeds of the left wheel and speed ratios right/left.

    Columns: left_rpm, right_rpm, ratio, radius_mm (positive: to the left), speed_mm_s, yaw_rate_deg_s; cells are empty
    if there is no steady turn. Forces that vary with place or heading are evaluated at the origin of the plate.
    """
    import numpy as np

    from evaluator.files import refuse_to_lose
    from evaluator.files.csv_tables import write_table
    from evaluator.wording import counted
    from evaluator.workflow import steady_turns

    refuse_to_lose(output, ("left_rpm", "ratio", "radius_mm"))
    table = steady_turns(robot, left_rpm, np.linspace(*ratios).tolist())
    write_table(table, output)
    if not quiet:
        click.echo(f"{output}: {counted(len(table), 'turn')}")
