"""Routes of the screens Marks (candidates, settings, corrections) and Camera (gauge images, calibration)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from starlette.responses import Response
from starlette.routing import Route

from evaluator.errors import InputError
from evaluator.studio.answers import Asked, Json, Studio, endpoint, number
from evaluator.studio.folder import IMAGES
from evaluator.workflow import (
    camera_view,
    cameras_among,
    corrections_file,
    corrections_of,
    gauge_pdf,
    run_of,
    tracking_file,
    write_corrections,
    write_tracking,
)
from simulator.mark_layout import is_mark_name

MOST_LOOKED_AT = 16  # frames of a contact sheet
MOST_CORRECTIONS = 20_000  # both marks in three minutes at 60 frames/s


def routes(studio: Studio) -> list[Route]:
    """Routes of these screens."""
    one = "/api/experiments/{id}"
    return [
        Route(one + "/tracking", endpoint(studio, tracking)),
        Route(one + "/tracking", endpoint(studio, set_tracking), methods=["POST"]),
        Route(one + "/runs/{run}/look", endpoint(studio, look), methods=["POST"]),
        Route(one + "/runs/{run}/corrections", endpoint(studio, corrections)),
        Route(one + "/runs/{run}/corrections", endpoint(studio, set_corrections), methods=["POST"]),
        Route("/api/rig", endpoint(studio, rig)),
        Route("/api/images/{id}", endpoint(studio, image)),
        Route("/api/images/{id}/dots", endpoint(studio, dots)),
        Route("/api/cameras/{id}", endpoint(studio, camera)),
        Route("/api/gauges/{id}/sheet.pdf", endpoint(studio, sheet)),
        Route("/api/gauges/{id}/calibrate", endpoint(studio, calibrate), methods=["POST"]),
    ]


def tracking(studio: Studio, asked: Asked) -> Json:
    """tracking.toml of an experiment."""
    found = tracking_file(studio.folder.path(asked.path["id"]))
    inside = studio.folder.inside(found.path)
    path = studio.folder.relative(inside)
    return {"version": found.version, "said": found.said, "sought": found.sought, "path": path}


def set_tracking(studio: Studio, asked: Asked) -> Json:
    """Write tracking.toml."""
    path = studio.folder.path(asked.path["id"])
    target = studio.folder.inside(tracking_file(path).path)
    said = asked.body.get("said")
    if not isinstance(said, dict):
        raise InputError("said: the settings of tracking.toml")

    def change() -> None:
        write_tracking(path, asked.text("version"), said)

    studio.history.record([target, path], "settings of the search for marks", change)
    return tracking(studio, asked)


def look(studio: Studio, asked: Asked) -> Json:
    """Results of the search for marks in some frames, with settings that need not be saved yet."""
    run = run_of(studio.folder.path(asked.path["id"]), asked.path["run"])
    numbers, said = asked.body.get("frames"), asked.body.get("said") or {}
    if run.video is None:
        raise InputError(f"run {run.id} has no video")
    whole = isinstance(numbers, list) and 0 < len(numbers) <= MOST_LOOKED_AT and all(type(n) is int for n in numbers)
    if not whole or not isinstance(said, dict):
        raise InputError(f"frames: up to {MOST_LOOKED_AT} frame numbers")
    assert isinstance(numbers, list)
    return {"frames": studio.decoder.marks(studio.folder.inside(run.video), numbers, said, run.rate_hz)}


def corrections(studio: Studio, asked: Asked) -> Json:
    """Manual corrections of a run."""
    path = studio.folder.path(asked.path["id"])
    inside = studio.folder.inside(corrections_file(path, asked.path["run"]))
    rows, version = corrections_of(path, asked.path["run"])
    return {"rows": rows, "version": version, "path": studio.folder.relative(inside)}


def set_corrections(studio: Studio, asked: Asked) -> Json:
    """Write the corrections of a run."""
    path = studio.folder.path(asked.path["id"])
    target = studio.folder.inside(corrections_file(path, asked.path["run"]))
    rows = asked.body.get("rows")
    if not isinstance(rows, list) or len(rows) > MOST_CORRECTIONS:
        raise InputError("rows: corrections, each with frame, mark, x, y")
    run, version, corrected = asked.path["run"], asked.text("version"), [_correction(row) for row in rows]

    def change() -> None:
        write_corrections(path, run, version, corrected)

    studio.history.record([target, path], f"a correction of {run}", change)
    return corrections(studio, asked)


def _correction(row: Any) -> Json:
    if not isinstance(row, dict) or type(row.get("frame")) is not int or row["frame"] < 0:
        raise InputError("a correction needs the number of a frame")
    mark = row.get("mark")
    if not isinstance(mark, str) or not is_mark_name(mark):
        raise InputError("a correction needs the name of a mark")
    if row.get("x") is None:
        return {"frame": row["frame"], "mark": mark, "x": None, "y": None}
    return {"frame": row["frame"], "mark": mark, "x": number(row["x"], "x"), "y": number(row.get("y"), "y")}


def rig(studio: Studio, asked: Asked) -> Json:
    """Gauges, images and cameras of the folder."""
    del asked
    folder = studio.folder
    files = list(folder.files())

    def entry(path: Path) -> Json:
        place = folder.relative(path)
        return {"id": folder.id_of(path), "path": place, "folder": str(Path(place).parent), "name": path.name}

    return {
        "gauges": [entry(path) for path in files if path.suffix == ".toml" and _is_gauge(path)],
        "images": [entry(path) for path in files if path.suffix.lower() in IMAGES],
        "cameras": [{**entry(one.path), "level": one.level} for one in cameras_among(files)],
    }


def image(studio: Studio, asked: Asked) -> Response:
    """An image of the folder."""
    return Response(studio.decoder.image(_image(studio, asked.path["id"])), media_type="image/jpeg")


def dots(studio: Studio, asked: Asked) -> Json:
    """The dots found in an image."""
    return studio.decoder.dots(_image(studio, asked.path["id"]))


def camera(studio: Studio, asked: Asked) -> Json:
    """Verdict and map of a camera."""
    return camera_view(studio.folder.path(asked.path["id"]))


def sheet(studio: Studio, asked: Asked) -> Response:
    """The printable sheet of a gauge."""
    headers = {"Content-Disposition": 'attachment; filename="gauge.pdf"'}
    return Response(gauge_pdf(studio.folder.path(asked.path["id"])), media_type="application/pdf", headers=headers)


def calibrate(studio: Studio, asked: Asked) -> Json:
    """Solve a camera from images of a gauge; camera.json is written beside gauge.toml."""
    gauge = studio.folder.path(asked.path["id"])
    chosen, plate = asked.body.get("images"), asked.body.get("plate", 0)
    if not isinstance(chosen, list) or not chosen or type(plate) is not int or not 0 <= plate < len(chosen):
        raise InputError("choose the images of the gauge, and which of them shows it lying on the plate")
    images = [str(_image(studio, str(one))) for one in chosen]
    target = studio.folder.inside(gauge.parent / "camera.json")
    options = {"images": images, "plate": plate, "camera": str(target)}
    return {"job": studio.jobs.add("calibrate", gauge, options, studio.history.watch([target], "the calibration"))}


def _image(studio: Studio, identifier: str) -> Path:
    path = studio.folder.path(identifier)
    if path.suffix.lower() not in IMAGES:
        raise InputError(f"{path.name}: is no image")
    return path


def _is_gauge(path: Path) -> bool:
    import tomllib

    try:
        return "dots" in tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
