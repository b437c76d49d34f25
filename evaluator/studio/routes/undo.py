"""Undo and redo on every screen that writes: the last change of the studio to a file that the screen shows."""

from __future__ import annotations

from pathlib import Path

from starlette.routing import Route

from evaluator.errors import InputError
from evaluator.studio.answers import Asked, Json, Studio, endpoint
from evaluator.studio.folder import IMAGES
from evaluator.studio.history import Touches
from evaluator.workflow import corrections_file, own_effects_folder, robot_file, tracking_file


def routes(studio: Studio) -> list[Route]:
    """Routes that all screens share."""
    return [
        Route("/api/undo/{screen}/{id}", endpoint(studio, steps)),
        Route("/api/undo/{screen}/{id}", endpoint(studio, step), methods=["POST"]),
    ]


def steps(studio: Studio, asked: Asked) -> Json:
    """The changes that would be undone and redone on a screen; id: of its experiment or gauge, run: of the query."""
    return studio.history.next_steps(_touches(studio, asked, asked.query.get("run")))


def step(studio: Studio, asked: Asked) -> Json:
    """Undo or redo the change with a number."""
    touches = _touches(studio, asked, asked.body.get("run"))
    number = asked.body.get("number")
    if type(number) is not int:
        raise InputError("number: of the change")
    return {"words": studio.history.step(touches, "redo" if asked.body.get("way") == "redo" else "undo", number)}


def _touches(studio: Studio, asked: Asked, run: object) -> Touches:
    """A test of whether a screen shows and changes a file."""
    path, screen = studio.folder.path(asked.path["id"]), asked.path["screen"]
    if screen == "camera":
        return lambda changed: changed == path or (changed.parent == path.parent and _of_camera(changed))
    if screen == "runs":
        return {path, robot_file(path).path.resolve()}.__contains__
    if screen == "marks":
        known = {tracking_file(path).path.resolve(), corrections_file(path, str(run)).resolve()}
        return known.__contains__
    if screen in ("diagnosis", "sandbox"):
        robot, own = robot_file(path).path.resolve(), own_effects_folder(path)
        return lambda changed: changed in (robot, path) or changed.parent == own
    raise InputError(f"{screen}: no screen that writes")


def _of_camera(path: Path) -> bool:
    return path.name == "camera.json" or path.suffix.lower() in IMAGES
