"""turnscope sweep: grids and random samples of runs, on all cores or on a Dask cluster, resumable."""

from __future__ import annotations

from pathlib import Path

import click

RUNS_A_PART = 500  # a part takes about a second: seldom lost, seldom waited for


@click.command(
    epilog="Example: turnscope sweep friction.toml -o friction.csv; an interrupted sweep goes on where it was.",
)
@click.argument("sweep_file", metavar="SWEEP.toml", type=click.Path(path_type=Path))
@click.option(
    "-o", "--out", "output", required=True, type=click.Path(path_type=Path), help="CSV to write, a row per run."
)
@click.option("--dask", metavar="ADDRESS", help="Scheduler of a running Dask cluster, as tcp://host:8786.")
@click.option(
    "--workers", type=click.IntRange(min=1), metavar="N", help="Processes on this machine; default: all cores."
)
def sweep(sweep_file: Path, output: Path, dask: str | None, workers: int | None) -> None:
    r"""Simulate every combination of a grid, with random samples of each.

    SWEEP.toml names a robot, a duration and the keys to vary: commands, start pose, dotted keys of robot.toml, and
    effect.ID.PARAMETER.

    \b
    format = 1
    name = "friction and tilt"
    robot = "barrel"
    duration_s = 10.0
    samples = 100
    fixed = { left_rpm = 33.3, right_rpm = 14.4 }
    grid."slip.lateral_friction" = { low = 0.2, high = 0.4, count = 5 }
    random."effect.plate-tilt.angle_deg" = { low = 0.0, high = 3.0 }
    random."start.heading_deg" = { low = -180, high = 180 }
    """
    import hashlib

    import pandas as pd

    from evaluator.cli.progress import progress_bar
    from evaluator.files import read_with, written_whole
    from evaluator.workflow.execution.scale_out import results_of
    from simulator.sweep import load_sweep, robot_of_sweep, run_part

    described = read_with(load_sweep, sweep_file)
    robot = read_with(lambda _: robot_of_sweep(described), Path(described.robot))
    total = len(described)
    parts = [(start, min(start + RUNS_A_PART, total)) for start in range(0, total, RUNS_A_PART)]
    # What was done for another sweep file or another robot must not be taken for this one's.
    meaning = f"{described.model_dump_json()}\n{robot.model_dump_json()}\n{RUNS_A_PART}"
    folder = output.with_name(f"{output.name}.parts-{hashlib.sha256(meaning.encode()).hexdigest()[:12]}")
    folder.mkdir(parents=True, exist_ok=True)
    missing = [part for part in parts if not _part_file(folder, part).exists()]
    done = len(parts) - len(missing)
    if done:
        click.echo(f"{done} of {len(parts)} parts were done before", err=True)
    with progress_bar("simulating") as report:
        report(done, len(parts))
        jobs = [(described, robot, *part) for part in missing]
        if missing:
            with results_of(run_part, jobs, dask, workers) as results:
                for number, table in results:
                    with written_whole(_part_file(folder, missing[number])) as temporary:
                        table.to_csv(temporary, index=False, float_format="%.9g")
                    done += 1
                    report(done, len(parts))
    with written_whole(output) as temporary:
        for number, part in enumerate(parts):
            table = pd.read_csv(_part_file(folder, part), keep_default_na=True)
            table.to_csv(temporary, mode="a", header=number == 0, index=False, float_format="%.9g")
    for part in parts:
        _part_file(folder, part).unlink()
    folder.rmdir()
    click.echo(f"{output}: {total} runs")


def _part_file(folder: Path, part: tuple[int, int]) -> Path:
    return folder / f"{part[0]:09d}-{part[1]:09d}.csv"
