"""Routes of the screen Runs: the table of experiment.toml, frames of recordings, and synchronous curves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from starlette.responses import Response
from starlette.routing import Route

from evaluator.errors import InputError
from evaluator.files import named_from
from evaluator.studio.answers import Asked, Json, Studio, endpoint, number
from evaluator.studio.folder import VIDEOS
from evaluator.workflow import Edit, Wanted, edit_experiment, read_experiment, run_curves, run_of

MOST_FRAMES = 60  # of one answer
NAMES_OF_FILES = ("video", "marks", "poses", "commands", "corrections", "camera", "robot")


def routes(studio: Studio) -> list[Route]:
    """Routes of this screen."""
    run = "/api/experiments/{id}/runs/{run}"
    return [
        Route("/api/experiments/{id}", endpoint(studio, table)),
        Route("/api/experiments/{id}/edit", endpoint(studio, edit), methods=["POST"]),
        Route(run + "/contents", endpoint(studio, contents)),
        Route(run + "/frame", endpoint(studio, frame)),
        Route(run + "/frames", endpoint(studio, frames)),
        Route(run + "/curves", endpoint(studio, curves)),
    ]


def table(studio: Studio, asked: Asked) -> Json:
    """The table of an experiment, its faults, and the recordings that it may use."""
    return _answer(studio, studio.folder.path(asked.path["id"]))


def edit(studio: Studio, asked: Asked) -> Json:
    """Change cells and rows."""
    path = studio.folder.path(asked.path["id"])
    edits = asked.body.get("edits")
    if not isinstance(edits, list) or not edits:
        raise InputError("there is no change in this request")
    changes = [_edit(studio, path, item) for item in edits]
    version = asked.text("version")
    studio.history.record([path], _words(changes), lambda: edit_experiment(path, version, changes))
    return _answer(studio, path)


def contents(studio: Studio, asked: Asked) -> Json:
    """Times of all frames of a run's video, key frames, size."""
    path, rate = _video(studio, asked)
    return studio.decoder.contents(path, rate)


def frame(studio: Studio, asked: Asked) -> Response:
    """One frame as JPEG; its number is in the header X-Frame."""
    path, rate = _video(studio, asked)
    first, most = int(asked.number("index", 0)), int(asked.number("px", 0))
    near = asked.query.get("near") == "1"
    (found,) = studio.decoder.frames(Wanted(path, first, 1, near, most, rate))
    return Response(found[1], media_type="image/jpeg", headers={"X-Frame": str(found[0])})


def frames(studio: Studio, asked: Asked) -> Response:
    """Consecutive frames: for each its number and length as 4 bytes (big-endian), then JPEG."""
    path, rate = _video(studio, asked)
    first, most = int(asked.number("first", 0)), int(asked.number("px", 0))
    count = max(1, min(int(asked.number("count", 1)), MOST_FRAMES))
    found = studio.decoder.frames(Wanted(path, first, count, False, most, rate))
    parts = [index.to_bytes(4, "big") + len(data).to_bytes(4, "big") + data for index, data in found]
    return Response(b"".join(parts), media_type="application/octet-stream")


def curves(studio: Studio, asked: Asked) -> Json:
    """Marks, poses and simulation of a run over time."""
    found = run_curves(studio.folder.path(asked.path["id"]), asked.path["run"])
    return {"marks": found.marks, "poses": found.poses, "simulated": found.simulated}


def _answer(studio: Studio, path: Path) -> Json:
    found = read_experiment(path)
    folder = path.parent
    recordings = [_from(folder, video) for video in studio.folder.files(VIDEOS)]
    return {
        "version": found.version,
        "head": {key: value for key, value in found.head.items() if isinstance(value, str | int | float)},
        "rows": found.rows,
        "faults": [{"row": fault.row, "key": fault.key, "sentence": fault.sentence} for fault in found.faults],
        "recordings": recordings,
        "path": studio.folder.relative(path),
    }


def _words(changes: list[Edit]) -> str:
    """Description of changes of the table, for undo."""
    if len(changes) > 1:
        return f"{len(changes)} changes of the table"
    (change,) = changes
    return {"add": "a new run", "remove": "a run taken away"}.get(change.kind, f"{change.key} of a run")


def _from(folder: Path, path: Path) -> str:
    """A path as written in a file of a folder."""
    return named_from(folder.resolve(), path.resolve())


def _edit(studio: Studio, path: Path, item: Any) -> Edit:
    """One change of a request, checked."""
    if not isinstance(item, dict) or item.get("kind") not in ("set", "add", "remove"):
        raise InputError("this change is none that the studio knows")
    row, key, values = item.get("row"), item.get("key", ""), item.get("values") or {}
    if not (row is None or isinstance(row, int)) or not isinstance(key, str) or not isinstance(values, dict):
        raise InputError("this change is none that the studio knows")
    named = {**values, key: item.get("value")} if key else dict(values)
    for name, value in named.items():
        if not (value is None or isinstance(value, str | bool | int | float)):
            raise InputError(f"{name}: a cell holds a number or a text")
        if isinstance(value, float | int) and not isinstance(value, bool):
            number(value, name)
        if name in NAMES_OF_FILES and isinstance(value, str) and (name != "robot" or value.endswith(".toml")):
            studio.folder.inside(path.parent / value)
    return Edit(item["kind"], row, key, item.get("value"), values)


def _video(studio: Studio, asked: Asked) -> tuple[Path, float | None]:
    run = run_of(studio.folder.path(asked.path["id"]), asked.path["run"])
    if run.video is None:
        raise InputError(f"run {run.id} has no video: its marks were tracked elsewhere")
    return studio.folder.inside(run.video), run.rate_hz
