"""`turnscope track`: one recording → marks CSV."""

from __future__ import annotations

from pathlib import Path

import click


@click.command(
    epilog="""\b
Example:
  turnscope track r01.mp4 --camera camera.json -o r01.csv
  turnscope track r01.mp4 --settings tracking.toml -o r01_px.csv"""
)
@click.argument("video", type=click.Path(path_type=Path))
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="The marks CSV to write.")
@click.option("--settings", type=click.Path(path_type=Path), help="tracking.toml: colors, size, region, masks.")
@click.option("--camera", type=click.Path(path_type=Path), help="camera.json: places the marks in mm on the plate.")
@click.option("--height-mm", type=float, default=6.5, show_default=True, help="Height of the marks above the plate.")
def track(video: Path, output: Path, settings: Path | None, camera: Path | None, height_mm: float) -> None:
    """Track the marks of VIDEO: their centres with standard uncertainties, picture by picture.

    Without --camera the table is in px; with it, in mm on the plane of the marks as well.
    """
    from evaluator.cli.progress import progress_bar
    from evaluator.errors import InputError
    from evaluator.files import read_with
    from evaluator.marks import write_marks
    from evaluator.recording import open_recording
    from evaluator.tracking import TrackingSettings, load_settings, place_on_plate
    from evaluator.tracking import track as track_recording

    wanted = read_with(load_settings, settings) if settings else TrackingSettings()
    seen_by = None
    if camera is not None:
        from calibration.store import load_camera

        seen_by = read_with(load_camera, camera)
    recording = open_recording(video)
    with progress_bar(f"tracking {video.name}") as progress:
        table = track_recording(recording, wanted, progress)
    for note in recording.report().notes:
        click.echo(f"note: {video}: {note}", err=True)
    counts = {name: int((table[f"{name}_status"] == "ok").sum()) for name in wanted.mark}
    if not any(counts.values()):
        raise InputError(
            f"{video}: no mark was found in any of {len(table)} pictures; "
            "say their color, diameter_px and region_px in a tracking.toml (--settings)"
        )
    if seen_by is not None:
        table = place_on_plate(table, seen_by, height_mm)
    write_marks(table, output)
    shares = ", ".join(f"{name} in {100 * count / len(table):.1f} %" for name, count in counts.items())
    click.echo(f"{output}: {len(table)} pictures; {shares}")
