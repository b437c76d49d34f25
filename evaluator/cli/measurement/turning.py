"""`turnscope turning`: tables of marks or poses → turning radius, without an experiment file."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from evaluator.cli.guard import BAD_INPUT
from evaluator.cli.options import PATH

if TYPE_CHECKING:
    from evaluator.interchange.tracks import Tracks
    from evaluator.workflow.turning_tables import MeasuredTable


class WithMarkNames(click.Command):
    """A command that takes an unknown option with a value as the name of a mark: --front "mass A"."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Take --MARK NAME for --name MARK=NAME, unless the option looks like a misspelt one."""
        known = [name for item in self.params for name in item.opts] + ["--help"]
        parsed, rest = list[str](), iter(args)
        for item in rest:
            mark = item.removeprefix("--").partition("=")[0]
            strange = item.startswith("--") and mark.isidentifier() and f"--{mark}" not in known
            if strange and not _misspelt(f"--{mark}", value := item.partition("=")[2] or next(rest, ""), known):
                parsed += ["--name", f"{mark}={value}"]
            else:
                parsed += [item, value] if strange and "=" not in item else [item]
        return super().parse_args(ctx, parsed)


def _misspelt(option: str, value: str, known: Sequence[str]) -> bool:
    """Whether an option with a value resembles a known one; --left with a name is a mark, with a number --left-rpm."""
    near = difflib.get_close_matches(option, known, n=1, cutoff=0.75)
    named = not re.fullmatch(r"[-+.\d]*", value)
    return bool(near) and not (named and near[0].startswith(f"{option}-"))


@click.command(
    cls=WithMarkNames,
    epilog="""\b
Examples:
  turnscope turning r01.csv --robot barrel
  turnscope turning forward_*.csv --robot robot.toml --camera camera.json --start-s 0.5 -o turning.csv
  turnscope turning tracker.trk --robot robot.toml --left "mass A" --right "mass B"
  turnscope turning one_mark.csv
  turnscope turning frame_x_y.csv --rate-hz 60 --unit px
  turnscope turning px.csv --scale-px 102 40 902 44 --length-mm 50

A marks CSV has the columns time_s and NAME_x_mm, NAME_y_mm (or _px) of every mark. Tables of t, x, y or frame, x, y,
files of OSP Tracker, TrackMate, trackpy, DeepLabCut, SLEAP and movement, and poses (time_s, x_mm, y_mm, heading_deg, or
a TUM trajectory) are read as well. robot.toml needs only [marks].

Exit status: 0, all tables were measured; 2, at least one could not be measured.""",
)
@click.argument("marks", nargs=-1, required=True, type=PATH)
@click.option("--robot", help="Shipped robot or robot.toml with the marks. [default: measure the path of each mark]")
@click.option("--camera", type=PATH, help="camera.json: adds its uncertainty, and converts marks in px.")
@click.option("--scale-px", nargs=4, type=float, metavar="X1 Y1 X2 Y2", help="Ends of a ruler in the image, px.")
@click.option("--length-mm", type=float, help="Length of that ruler.")
@click.option("--unit", type=click.Choice(["um", "mm", "cm", "m", "inch", "px"]), help="Unit of lengths in the tables.")
@click.option(
    "--name",
    "names",
    multiple=True,
    metavar="MARK=NAME",
    help="Name of a mark in tables of another program; --MARK NAME does the same.",
)
@click.option("--rate-hz", type=click.FloatRange(min=0, min_open=True), help="Frame rate of tables without times.")
@click.option("--start-s", type=float, help="Time at which the motors start. [default: found in the data]")
@click.option("--stop-s", type=float, help="Time at which the motors stop.")
@click.option("--left-rpm", type=float, help="Commanded speed, for the slip ratio.")
@click.option("--right-rpm", type=float, help="Commanded speed, for the slip ratio.")
@click.option("--phases", type=PATH, help="CSV to write, with all phases: rest, straight, turn, spot, transient.")
@click.option("-o", "--out", "output", type=PATH, help="CSV to write, like turning.csv, with a row per table.")
def turning(
    marks: tuple[Path, ...],
    robot: str | None,
    camera: Path | None,
    scale_px: tuple[float, float, float, float] | None,
    length_mm: float | None,
    unit: str | None,
    names: tuple[str, ...],
    rate_hz: float | None,
    start_s: float | None,
    stop_s: float | None,
    left_rpm: float | None,
    right_rpm: float | None,
    phases: Path | None,
    output: Path | None,
) -> int:
    """Measure the turning radius from MARKS, tables of tracked marks or poses.

    The radius is the smallest one of the robot's centre that is sustained for a quarter turn, with its 95 % interval.
    """
    from evaluator.errors import InputError
    from evaluator.files import refuse_to_lose
    from evaluator.report.numbers import true_minus
    from evaluator.workflow.turning_tables import Request, Ruler, measure_table, together

    if (scale_px is None) != (length_mm is None):
        raise InputError("--scale-px and --length-mm belong together: the ends of a ruler and its length")
    request = Request(
        robot=_robot(robot),
        tracks=_tracks(names, unit, rate_hz),
        camera=_camera(camera),
        ruler=Ruler(scale_px, length_mm) if scale_px is not None and length_mm is not None else None,
        start_s=start_s,
        stop_s=stop_s,
        left_rpm=left_rpm,
        right_rpm=right_rpm,
    )
    for path, columns in ((output, ("run", "radius_status")), (phases, ("run", "start_s", "kind"))):
        if path is not None:
            refuse_to_lose(path, columns)
    found, faults = [], 0
    for path in marks:
        try:
            found.append(measure_table(path, request))
        except InputError as error:
            faults += 1
            click.echo(f"error: {error}", err=True)
            continue
        _say(path, found[-1])
    if len(found) > 1 and (said := together([one.row for one in found])):
        click.echo(true_minus(said))
    if output is not None and found:
        _write(output, [one.row for one in found])
    rows = [row for one in found for row in one.phases]
    if phases is not None and rows:
        _write(phases, rows)
    elif phases is not None and found:
        click.echo(f"{phases} is not written: phases need a heading, which takes two marks and --robot")
    return BAD_INPUT if faults else 0


def _say(path: Path, found: MeasuredTable) -> None:
    from evaluator.report.numbers import true_minus

    for number, line in enumerate(found.lines):
        click.echo(f"{path}: {true_minus(line)}" if number == 0 else f"  {true_minus(line)}")


def _write(output: Path, rows: Sequence[dict[str, Any]]) -> None:
    import pandas as pd

    from evaluator.files.csv_tables import write_table

    write_table(pd.DataFrame(rows), output)


def _robot(name: str | None) -> Any:
    from evaluator.robot_geometry import read_geometry

    return None if name is None else read_geometry(Path(name))


def _tracks(names: tuple[str, ...], unit: str | None, rate_hz: float | None) -> Tracks:
    from evaluator.errors import InputError
    from evaluator.interchange.tracks import Tracks
    from simulator.mark_layout import is_mark_name

    said = dict(item.partition("=")[::2] for item in names)
    for mark, name in said.items():
        if not (is_mark_name(mark) and name) or mark in Tracks.model_fields:
            raise InputError(
                f"--name {mark}={name}: expected MARK=NAME, the mark of robot.toml and its name in the table"
            )
    return Tracks.model_validate({**said, "unit": unit, "rate_hz": rate_hz})


def _camera(path: Path | None) -> Any:
    from calibration.store import load_camera
    from evaluator.files import read_with

    return None if path is None else read_with(load_camera, path)
