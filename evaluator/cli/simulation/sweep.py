"""turnscope sweep: grids and random samples of runs, on all cores or on a Dask cluster, resumable."""

from __future__ import annotations

from pathlib import Path

import click

from evaluator.cli.options import PATH, dask_option, quiet_option, workers_option

EXAMPLE = """\b
A SWEEP.toml:
  format = 1
  name = "friction and tilt"
  robot = "barrel"
  duration_s = 10.0
  samples = 100
  [fixed]
  left_rpm = 33.3
  right_rpm = 14.4
  [grid]
  "slip.lateral_friction" = { low = 0.2, high = 0.4, count = 5 }
  [random]
  "effect.plate-tilt.angle_deg" = { low = 0.0, high = 3.0 }
  "start.heading_deg" = { low = -180, high = 180 }

\b
Example:
  turnscope sweep friction.toml -o friction.csv"""


@click.command(epilog=EXAMPLE)
@click.argument("sweep_file", metavar="SWEEP.toml", type=PATH)
@click.option("-o", "--out", "output", required=True, type=PATH, metavar="CSV", help="Table to write, a row per run.")
@workers_option
@dask_option
@quiet_option
def sweep(sweep_file: Path, output: Path, workers: int | None, dask: str | None, quiet: bool) -> None:
    """Simulate every combination of a parameter grid, with random samples of each.

    SWEEP.toml names a robot, a duration and the keys to vary: commands, start pose, dotted keys of robot.toml, and
    effect.ID.PARAMETER. Repeat the command to continue an interrupted sweep.
    """
    from evaluator.cli.progress import progress_bar
    from evaluator.files import refuse_to_lose
    from evaluator.wording import counted
    from evaluator.workflow import run_sweep

    refuse_to_lose(output, ("run", "yaw_rate_deg_s", "status"))
    with progress_bar("sweep", quiet=quiet) as progress:
        done = run_sweep(sweep_file, output, workers=workers, dask=dask, progress=progress)
    if not quiet:
        if done.reused:
            click.echo(f"{done.reused} of {done.parts} parts reused from before", err=True)
        click.echo(f"{done.output}: {counted(done.runs, 'run')}")
