"""Routes of the forms for values of gauge.toml and robot.toml on the screens Camera and Runs."""

from __future__ import annotations

from starlette.routing import Route

from evaluator.errors import InputError
from evaluator.studio.answers import Asked, Json, Studio, endpoint, number
from evaluator.workflow import Values, gauge_values, robot_file, robot_values, set_gauge_value, set_robot_value

DEEPEST = 8  # keys that lead to a value


def routes(studio: Studio) -> list[Route]:
    """Routes of these forms."""
    gauge, robot = "/api/gauges/{id}/values", "/api/experiments/{id}/robot/values"
    return [
        Route(gauge, endpoint(studio, of_gauge)),
        Route(gauge, endpoint(studio, set_of_gauge), methods=["POST"]),
        Route(robot, endpoint(studio, of_robot)),
        Route(robot, endpoint(studio, set_of_robot), methods=["POST"]),
    ]


def of_gauge(studio: Studio, asked: Asked) -> Json:
    """All values of a gauge.toml."""
    return _listed(studio, gauge_values(studio.folder.path(asked.path["id"])))


def set_of_gauge(studio: Studio, asked: Asked) -> Json:
    """Change one."""
    path, (place, value) = studio.folder.path(asked.path["id"]), _change(asked)
    version = asked.text("version")
    studio.history.record([path], f"{_name(place)} of the gauge", lambda: set_gauge_value(path, version, place, value))
    return of_gauge(studio, asked)


def of_robot(studio: Studio, asked: Asked) -> Json:
    """All values of the robot of an experiment."""
    path = studio.folder.path(asked.path["id"])
    studio.folder.inside(robot_file(path).path)
    return _listed(studio, robot_values(path))


def set_of_robot(studio: Studio, asked: Asked) -> Json:
    """Change one."""
    path, (place, value) = studio.folder.path(asked.path["id"]), _change(asked)
    target, version = studio.folder.inside(robot_file(path).path), asked.text("version")
    files, words = [target, path], f"{_name(place)} of the robot"
    studio.history.record(files, words, lambda: set_robot_value(path, version, place, value))
    return of_robot(studio, asked)


def _change(asked: Asked) -> tuple[list[str | int], str | float | bool | None]:
    place, value = asked.body.get("place"), asked.body.get("value")
    keys = place if isinstance(place, list) and len(place) <= DEEPEST else []
    if not keys or any(type(key) not in (str, int) for key in keys):
        raise InputError("place: the keys that lead to a value")
    if not (value is None or isinstance(value, str | bool | int | float)):
        raise InputError("value: a number or a text")
    if isinstance(value, float):
        number(value, _name(keys))
    return keys, value


def _name(place: list[str | int]) -> str:
    """The name of a place: its last key."""
    return next((key for key in reversed(place) if isinstance(key, str)), "entry")


def _listed(studio: Studio, found: Values) -> Json:
    path = studio.folder.relative(found.path)
    return {"version": found.version, "path": path, "values": [{"place": place, "value": v} for place, v in found.each]}
