"""`turnscope track`: one recording → marks CSV."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from evaluator.cli.options import PATH

if TYPE_CHECKING:
    import pandas as pd

    from evaluator.recording import Source
    from evaluator.tracking import TrackingSettings
    from evaluator.workflow import Tracked


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
@click.option("--settings", type=PATH, help="tracking.toml: colours, size, region and masks.")
@click.option("--camera", type=PATH, help="camera.json: adds coordinates in mm in the plate frame.")
@click.option("--robot", default="barrel", show_default=True, help="Shipped robot or robot.toml, with its marks.")
@click.option("--height-mm", type=float, help="Height of the marks above the plate. [default: from the robot]")
@click.option("--rate", type=float, help="Frame rate, 1/s, for images and streams without time stamps.")
@click.option(
    "--fields",
    type=click.Choice(["auto", "none", "top", "bottom"]),
    default="auto",
    show_default=True,
    help="Interlaced recordings: which field is first.",
)
@click.option("--corrections", type=PATH, help='CSV of manual corrections: frame, mark, x, y or "absent".')
@click.option("--overlay", type=PATH, help="Video to write, with marks, path, heading and circle drawn on it.")
@click.option("--sheet", type=PATH, help="PNG to write, with the frames whose marks are doubtful.")
@click.option(
    "--explain",
    type=PATH,
    help="PNG to write, with all candidates for marks and why each was rejected.",
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

    VIDEO is any file that FFmpeg reads, a folder or TIFF stack of images (with --rate), a camera device, an address, or
    "-" for standard input. The table is in px; with --camera also in mm on the plane of the marks.
    """
    from evaluator.cli.progress import progress_bar
    from evaluator.files import refuse_to_lose
    from evaluator.wording import counted
    from evaluator.workflow import track_recording

    def explained(recording: Source, marks: pd.DataFrame, wanted: TrackingSettings) -> None:
        if explain is not None:
            from evaluator.report.measurement.search_sheet import write_search_sheet

            write_search_sheet(recording, marks, wanted, explain)

    refuse_to_lose(output, ("frame", "time_s"))
    hint = "--explain search.png shows all candidates" if explain is None else f"see {explain}"
    with progress_bar(f"tracking {Path(video).name}", quiet=quiet) as progress:
        tracked = track_recording(
            video,
            output,
            settings=settings,
            camera=camera,
            robot=robot,
            height_mm=height_mm,
            rate_hz=rate,
            fields=fields,  # type: ignore[arg-type]
            corrections=corrections,
            looked_at=explained,
            where_to_look=hint,
            progress=progress,
        )
    if not quiet:
        for note in tracked.notes:
            click.echo(f"note: {video}: {note}", err=True)
    said = _write_images(tracked, overlay, sheet, quiet=quiet)
    if not quiet:
        shares = ", ".join(f"{name} in {100 * share:.1f} %" for name, share in tracked.shares.items())
        for line in (*said, f"{output}: {counted(len(tracked.marks), 'frame')}; {shares}"):
            click.echo(line)
        if unseen := [name for name, share in tracked.shares.items() if not share]:
            click.echo(
                f"not found: {', '.join(unseen)}; say color, diameter_px and region_px of each in [mark.NAME] of a "
                "tracking.toml (--settings), or leave out marks that are not there",
                err=True,
            )


def _write_images(tracked: Tracked, overlay: Path | None, sheet: Path | None, *, quiet: bool) -> list[str]:
    """Write the overlay video and the contact sheet if requested; return the lines to print."""
    from evaluator.cli.progress import progress_bar
    from evaluator.report.overlay import write_contact_sheet, write_overlay
    from evaluator.report.turn_overlay import turn_drawing
    from evaluator.wording import counted

    if overlay is not None:
        with progress_bar(f"drawing {overlay.name}", quiet=quiet) as progress:
            write_overlay(tracked.recording, tracked.marks, overlay, turn_drawing(tracked), progress)
    if sheet is None:
        return []
    shown = write_contact_sheet(tracked.recording, tracked.marks, sheet)
    if not shown:
        return ["no doubtful mark: no sheet written"]
    return [f"{sheet}: {counted(shown, 'doubtful mark')}"]
