"""Routes of the live camera: current frame with dots, and images for the calibration."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from starlette.responses import Response
from starlette.routing import Route

from evaluator.errors import InputError
from evaluator.files import plain
from evaluator.studio.answers import Asked, Json, Studio, endpoint, number
from evaluator.studio.folder import VIDEOS
from evaluator.workflow import LiveSource, cameras_here

# Only devices and files of the folder: with addresses another page could make the studio request them.
CAMERA = re.compile(r"/dev/video\d{1,3}|\d{1,3}")
SIZE = re.compile(r"\d{2,5}x\d{2,5}")
TAKEN = re.compile(r"gauge-(\d+)", re.ASCII)


def routes(studio: Studio) -> list[Route]:
    """Routes of the live camera."""
    return [
        Route("/api/live", endpoint(studio, sources)),
        Route("/api/live/look", endpoint(studio, look)),
        Route("/api/live/close", endpoint(studio, close), methods=["POST"]),
        Route("/api/gauges/{id}/take", endpoint(studio, take), methods=["POST"]),
    ]


def sources(studio: Studio, asked: Asked) -> Json:
    """Cameras of this computer, and recordings of the folder, which can replace one."""
    del asked
    folder = studio.folder
    files = [{"id": folder.id_of(path), "path": folder.relative(path)} for path in folder.files(VIDEOS)]
    return {"cameras": cameras_here(), "files": files}


def look(studio: Studio, asked: Asked) -> Response:
    """The current frame: length of the JSON as 4 bytes (big-endian), JSON of the dots, JPEG."""
    shown, found = studio.live.look(_source(studio, asked.query))
    described = json.dumps(plain(found)).encode()
    return Response(len(described).to_bytes(4, "big") + described + shown, media_type="application/octet-stream")


def close(studio: Studio, asked: Asked) -> Json:
    """Release the camera."""
    del asked
    studio.live.close()
    return {}


def take(studio: Studio, asked: Asked) -> Json:
    """Write the last shown image beside a gauge."""
    gauge, source = studio.folder.path(asked.path["id"]), _source(studio, asked.body)
    numbers = [int(found[1]) for path in gauge.parent.iterdir() if (found := TAKEN.match(path.name))]
    target = studio.folder.inside(gauge.parent / f"gauge-{max(numbers, default=0) + 1}.png")
    studio.history.record([target], f"the image {target.name}", lambda: studio.live.take(source, target))
    return {"id": studio.folder.id_of(target), "name": target.name}


def _source(studio: Studio, said: Mapping[str, Any]) -> LiveSource:
    """The camera or file of a request, checked."""
    camera, file, size, rate = (str(said.get(key) or "") for key in ("camera", "file", "size", "rate"))
    if size and not SIZE.fullmatch(size):
        raise InputError(f"{size}: give the size of the image as width x height, such as 1280x720")
    hertz = number(rate, "frames per second") if rate else None
    if hertz is not None and not 0 < hertz <= 1000:
        raise InputError(f"{rate} frames per second: give a number up to 1000")
    if file:
        path = studio.folder.path(file)
        if path.suffix.lower() not in VIDEOS:
            raise InputError(f"{path.name}: is no recording")
        return LiveSource(str(path))
    if not CAMERA.fullmatch(camera):
        raise InputError("choose a camera")
    if camera.startswith("/") and not Path(camera).exists():
        raise InputError(f"{camera}: no such camera; is it plugged in?")
    return LiveSource(camera, size or None, hertz)
