"""`turnscope track`: one recording → marks CSV."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from evaluator.cli.options import PATH

if TYPE_CHECKING:
    import pandas as pd

    from calibration.camera import Camera
    from evaluator.recording import Source
    from evaluator.report.overlay import Drawing


@click.command(
    epilog="""\b
Examples:
  turnscope track r01.mp4 --camera camera.json -o r01.csv
  turnscope track r01.mp4 --settings tracking.toml -o r01.csv --overlay r01-marks.mp4 --sheet doubtful.png
  turnscope track r01.mp4 -o r01.csv --explain search.png
  turnscope track images/ --rate 60 -o r02.csv"""
)
@click.argument("video", type=click.Path())  # text: an address is not a path
@click.option("-o", "--out", "output", required=True, type=PATH, help="The marks CSV to write.")
@click.option("--settings", type=PATH, help="tracking.toml: colors, size, region, masks.")
@click.option("--camera", type=PATH, help="camera.json: places the marks in mm on the plate.")
@click.option("--robot", default="barrel", show_default=True, help="Robot (name or robot.toml): where its marks are.")
@click.option("--height-mm", type=float, help="Height of the marks above the plate; else the robot's.")
@click.option("--rate", type=float, help="Frames a second, where there are no times: a folder of images.")
@click.option(
    "--fields",
    type=click.Choice(["auto", "none", "top", "bottom"]),
    default="auto",
    show_default=True,
    help="Interlaced recordings: which field is first.",
)
@click.option("--corrections", type=PATH, help='CSV of corrections by hand: frame, mark, x, y or "absent".')
@click.option("--overlay", type=PATH, help="Video to write with all that was measured drawn on it.")
@click.option("--sheet", type=PATH, help="PNG to write with the frames to look at twice.")
@click.option(
    "--explain", type=PATH, help="PNG to write with what the search saw: colors, blobs, and why each was refused."
)
@click.option("-q", "--quiet", is_flag=True, help="Print nothing but errors.")
def track(
    video: str,
    output: Path,
    settings: Path | None,
    camera: Path | None,
    robot: str,
    height_mm: float | None,
    rate: float | None,
    fields: str,
    corrections: Path | None,
    overlay: Path | None,
    sheet: Path | None,
    explain: Path | None,
    quiet: bool,
) -> None:
    """Track the marks of VIDEO: their centres with standard uncertainties, frame by frame.

    VIDEO is any file that FFmpeg reads, a folder of images (with --rate), a camera device, an address, or "-" for
    standard input. Without --camera the table is in px; with it, in mm on the plane of the marks as well.
    """
    from evaluator.cli.progress import progress_bar
    from evaluator.errors import InputError
    from evaluator.files import read_with
    from evaluator.marks import write_marks
    from evaluator.recording import open_recording
    from evaluator.tracking import TrackingSettings, correct, load_settings, place_on_plate, read_corrections
    from evaluator.tracking import track as track_recording
    from evaluator.wording import counted

    wanted = read_with(load_settings, settings) if settings else TrackingSettings()
    by_hand = read_corrections(corrections) if corrections else None
    seen_by: Camera | None = None
    if camera is not None:
        from calibration.store import load_camera

        seen_by = read_with(load_camera, camera)
        height_mm = _height(robot) if height_mm is None else height_mm
    recording = open_recording(video, rate_hz=rate, fields=fields)  # type: ignore[arg-type]
    with progress_bar(f"tracking {Path(video).name}", quiet=quiet) as progress:
        table = track_recording(recording, wanted, progress)
    if by_hand is not None:
        table = correct(table, by_hand, str(corrections))
    if not quiet:
        for note in recording.report().notes:
            click.echo(f"note: {video}: {note}", err=True)
    if explain is not None:
        from evaluator.report.search_sheet import write_search_sheet

        write_search_sheet(recording, table, wanted, explain)
    counts = {name: int(table[f"{name}_x_px"].notna().sum()) for name in wanted.mark}
    if not any(counts.values()):
        raise InputError(
            f"{video}: no mark was found in any of {counted(len(table), 'frame')}; "
            + ("see what the search saw with --explain search.png, and " if explain is None else f"see {explain}, and ")
            + "say their color, diameter_px and region_px in a tracking.toml (--settings)"
        )
    if seen_by is not None and height_mm is not None:
        table = place_on_plate(table, seen_by, height_mm)
    write_marks(table, output)
    _write_pictures(recording, table, overlay, sheet, _drawing(table, seen_by, robot) if overlay else None, quiet=quiet)
    if not quiet:
        shares = ", ".join(f"{name} in {100 * count / len(table):.1f} %" for name, count in counts.items())
        click.echo(f"{output}: {counted(len(table), 'frame')}; {shares}")


def _write_pictures(
    recording: Source,
    table: pd.DataFrame,
    overlay: Path | None,
    sheet: Path | None,
    drawing: Drawing | None,
    *,
    quiet: bool,
) -> None:
    """Write the overlay video and the contact sheet that were asked for."""
    from evaluator.cli.progress import progress_bar
    from evaluator.report.overlay import write_contact_sheet, write_overlay
    from evaluator.wording import counted

    if overlay is not None:
        with progress_bar(f"drawing {overlay.name}", quiet=quiet) as progress:
            write_overlay(recording, table, overlay, drawing, progress)
    if sheet is not None:
        shown = write_contact_sheet(recording, table, sheet)
        if not quiet:
            click.echo(
                f"{sheet}: {counted(shown, 'doubtful mark')} to look at"
                if shown
                else "no doubtful mark: no sheet written"
            )


def _height(robot: str) -> float:
    from evaluator.robot_geometry import read_geometry

    return float(read_geometry(Path(robot)).height_mm)


def _drawing(table: pd.DataFrame, camera: Camera | None, robot: str) -> Drawing | None:
    """Centre, heading and turning circle in the frame, where a camera places them."""
    if camera is None or not {"green_x_mm", "yellow_x_mm"} <= set(table):
        return None
    import numpy as np

    from evaluator.pose import poses_from_marks
    from evaluator.report.overlay import Drawing
    from evaluator.robot_geometry import read_geometry
    from evaluator.turning import measure_turning

    marks = read_geometry(Path(robot))
    geometry = marks.of_pair("green", "yellow")
    poses = poses_from_marks(table, geometry)
    turning = measure_turning(poses)

    def picture(x_mm: object, y_mm: object) -> np.ndarray:
        x, y = np.broadcast_arrays(np.asarray(x_mm, float), np.asarray(y_mm, float))
        return camera.picture_from_plate(np.stack([x, y, np.full_like(x, marks.height_mm)], axis=-1))

    ahead = 4.0  # mm: a nose just beyond the robot's front
    circle, caption = np.empty((0, 2)), ""
    if np.isfinite([turning.radius_mm, turning.center_x_mm, turning.center_y_mm]).all():
        angle = np.linspace(0.0, 2.0 * np.pi, 361)
        radius = abs(turning.radius_mm)
        circle = picture(turning.center_x_mm + radius * np.cos(angle), turning.center_y_mm + radius * np.sin(angle))
        caption = f"R = {radius:.2f} mm"
    return Drawing(
        center_px=picture(poses.x_mm, poses.y_mm),
        nose_px=picture(poses.x_mm + ahead * np.cos(poses.heading_rad), poses.y_mm + ahead * np.sin(poses.heading_rad)),
        circle_px=circle,
        caption=caption,
    )
