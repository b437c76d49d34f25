"""Routes of the first screen: experiments, cameras, samples; and of jobs, which all screens show."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from starlette.requests import Request
from starlette.responses import StreamingResponse
from starlette.routing import Route

from evaluator.errors import InputError
from evaluator.studio.answers import Asked, Json, Studio, endpoint
from evaluator.studio.folder import IMAGES, VIDEOS, Folder
from evaluator.workflow import (
    cameras_among,
    experiments_among,
    new_experiment,
    new_table,
    results_state,
    robot_names,
)

SAMPLES = "turnscope-samples"
LOOK_S = 0.2  # interval at which jobs are checked for news
BEAT_S = 15.0  # interval of comments that show a page that the studio is running


def routes(studio: Studio) -> list[Route]:
    """Routes of this screen."""
    return [
        Route("/api/home", endpoint(studio, home)),
        Route("/api/experiments", endpoint(studio, create), methods=["POST"]),
        Route("/api/experiments/{id}/state", endpoint(studio, state)),
        Route("/api/samples", endpoint(studio, samples), methods=["POST"]),
        Route("/api/experiments/{id}/jobs", endpoint(studio, start), methods=["POST"]),
        Route("/api/jobs/{number:int}", endpoint(studio, end), methods=["POST"]),
        Route("/api/events", _events(studio)),
    ]


def home(studio: Studio, asked: Asked) -> Json:
    """Experiments, cameras and recordings of the folder."""
    del asked
    folder = studio.folder
    files = list(folder.files())
    recordings = [path for path in files if path.suffix.lower() in VIDEOS]
    return {
        "folder": folder.root.name or str(folder.root),
        "experiments": [_entry(folder, one, ("name", "runs", "videos", "fault")) for one in experiments_among(files)],
        "cameras": [_entry(folder, one, ("level", "summary", "scale_sigma")) for one in cameras_among(files)],
        "recordings": len(recordings),
        "images": sum(path.suffix.lower() in IMAGES for path in files),
        "robots": robot_names(),
        "places": sorted({folder.relative(path.parent) for path in recordings}),
    }


def _entry(folder: Folder, summary: Any, names: tuple[str, ...]) -> Json:
    identified = {"id": folder.id_of(summary.path), "path": folder.relative(summary.path)}
    return identified | {name: getattr(summary, name) for name in names}


def state(studio: Studio, asked: Asked) -> Json:
    """Which results of an experiment are up to date."""
    found = results_state(studio.folder.path(asked.path["id"]))
    return {"outdated": found.outdated, "results": found.results, "diagnosis": found.diagnosis, "fault": found.fault}


def create(studio: Studio, asked: Asked) -> Json:
    """Create an experiment: a folder of that name with its files, and a run for each recording of a chosen folder."""
    name = asked.text("name").strip()
    if not name or name.startswith(".") or any(letter in name for letter in '/\\:*?"<>|') or not name.isprintable():
        raise InputError('give the experiment a name without / \\ : * ? " < > | that does not begin with a dot')
    target = studio.folder.inside(Path(name))
    if target.exists():
        raise InputError(f"{name}: there is already something of this name; choose another")
    robot = asked.text("robot")
    new_experiment(target, robot)
    place = asked.body.get("place")
    recordings: list[str] = []
    if isinstance(place, str):
        inside = studio.folder.inside(Path(place))
        recordings = [
            Path("..", studio.folder.relative(path)).as_posix()
            for path in studio.folder.files(VIDEOS)
            if path.parent == inside
        ]
    new_table(target / "experiment.toml", name, "robot.toml", recordings)
    return {"id": studio.folder.id_of(target / "experiment.toml")}


def samples(studio: Studio, asked: Asked) -> Json:
    """Copy the samples into the folder and solve their camera."""
    del asked
    target = studio.folder.inside(Path(SAMPLES))
    target.mkdir(exist_ok=True)
    return {"job": studio.jobs.add("samples", target)}


def start(studio: Studio, asked: Asked) -> Json:
    """Analyse or diagnose an experiment."""
    kind = asked.text("kind")
    if kind not in ("analyse", "diagnose"):
        raise InputError(f"{kind}: no such work")
    path = studio.folder.path(asked.path["id"])
    _all_inside(studio, path)
    return {"job": studio.jobs.add(kind, path)}


def end(studio: Studio, asked: Asked) -> Json:
    """Cancel or pause a job."""
    how = asked.text("how")
    if how not in ("cancelled", "paused"):
        raise InputError(f"{how}: a job can be cancelled or paused")
    studio.jobs.end(int(asked.path["number"]), how)
    return {}


def _all_inside(studio: Studio, experiment: Path) -> None:
    """Refuse an experiment that names files outside the folder."""
    from evaluator.workflow import files_named

    for path in files_named(experiment):
        studio.folder.inside(path)


def _events(studio: Studio) -> Any:
    async def events(request: Request) -> StreamingResponse:
        async def stream() -> AsyncIterator[str]:
            seen, silent = -1, 0.0
            while not await request.is_disconnected():
                if studio.jobs.version != seen:
                    seen, silent = studio.jobs.version, 0.0
                    yield f"data: {json.dumps(studio.jobs.view())}\n\n"
                elif silent >= BEAT_S:
                    silent = 0.0
                    yield ": here\n\n"
                await asyncio.sleep(LOOK_S)
                silent += LOOK_S

        return StreamingResponse(stream(), media_type="text/event-stream")

    return events
