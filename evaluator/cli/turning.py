"""`turnscope turning`: marks CSVs → turning radius, straight from the tables."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    import pandas as pd


@click.command(
    epilog="""\b
Example:
  turnscope turning r01.csv --robot barrel
  turnscope turning forward_*.csv --robot robot.toml --camera camera.json --start-s 0.5 -o turning.csv"""
)
@click.argument("marks", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--robot", required=True, help="Shipped robot or robot.toml: where its marks and wheels are.")
@click.option("--camera", type=click.Path(path_type=Path), help="camera.json: adds what its uncertainty does.")
@click.option("--start-s", type=float, help="When the motors were commanded on; found without it too.")
@click.option("--stop-s", type=float, help="When the motors were commanded off.")
@click.option("--left-rpm", type=float, help="Commanded rotation, for the slip ratio.")
@click.option("--right-rpm", type=float, help="Commanded rotation, for the slip ratio.")
@click.option("-o", "--out", "output", type=click.Path(path_type=Path), help="A turning.csv to write, a row per table.")
def turning(
    marks: tuple[Path, ...],
    robot: str,
    camera: Path | None,
    start_s: float | None,
    stop_s: float | None,
    left_rpm: float | None,
    right_rpm: float | None,
    output: Path | None,
) -> None:
    """Measure how a robot turns from MARKS, tables of its tracked marks.

    The radius is that of the robot's centre, the smallest that is sustained for a quarter turn, with its 95 % interval.
    """
    import pandas as pd

    from evaluator.files import read_with, written_whole
    from evaluator.marks import read_marks
    from evaluator.pose import poses_from_marks
    from evaluator.robot_geometry import mark_geometry, robot_shape
    from evaluator.turning import measure_turning
    from simulator.robot import load_robot

    machine = read_with(load_robot, Path(robot))
    geometry, shape = mark_geometry(machine), robot_shape(machine)
    seen_by = None
    if camera is not None:
        from calibration.store import load_camera

        seen_by = read_with(load_camera, camera)
    rows: list[dict[str, object]] = []
    for path in marks:
        poses = poses_from_marks(read_marks(path), geometry, seen_by)
        found = measure_turning(poses, start_s, stop_s, shape=shape, left_rpm=left_rpm, right_rpm=right_rpm)
        rows.append({"run": path.stem, "left_rpm": left_rpm, "right_rpm": right_rpm, **found.to_row()})
        click.echo(f"{path}: {found.summary()}")
    if len(rows) > 1:
        click.echo(_together(pd.DataFrame(rows)))
    if output is not None:
        with written_whole(output) as temporary:
            pd.DataFrame(rows).to_csv(temporary, index=False)


def _together(rows: pd.DataFrame) -> str:
    """All tables as repetitions of one run."""
    from evaluator.turning.pooling import pooled

    turns = rows[rows["radius_mm"].notna()]
    radius = pooled(turns["radius_mm"].to_numpy(float), turns["radius_random_mm"].to_numpy(float))
    if radius.runs < 2:
        return "repetitions: fewer than two of these turn"
    shared = radius.with_systematic(float(turns["radius_systematic_mm"].mean()))
    return (
        f"{radius.runs} repetitions: radius {radius.mean:.4f} mm, 95 % from {shared.low:.4f} to {shared.high:.4f}; "
        f"scatter from run to run {radius.between:.2g} mm, of a single measurement {radius.within:.2g} mm"
    )
