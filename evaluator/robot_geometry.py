"""Geometry of a robot for measurement: its marks, and optionally its outline and wheels.

Measurement does not use the model: it reads only these few lengths of robot.toml, and a file with only [marks] or
[[mark]] is sufficient. Body frame, mm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import ValidationError

from calibration.frames import plate_from_body
from evaluator.errors import InputError
from evaluator.files import explain, read_with
from evaluator.mark_geometry import MarkGeometry, equal_height_mm
from evaluator.marks import columns_of
from evaluator.pose import NO_HEADING, poses_from_marks
from evaluator.settings import MeasuredRobot, load_measured
from evaluator.tracking.settings import MarkSettings, TrackingSettings, load_settings, with_marks
from evaluator.turning import RobotShape
from simulator.mark_layout import Mark
from simulator.nominal_robot import Wheel
from simulator.robot import Robot
from simulator.units import in_standard_units

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RobotGeometry:
    """Marks in the order of the file, all at one height above the plate, and the shape if known."""

    layout: tuple[Mark, ...]
    shape: RobotShape | None = None

    @property
    def height_mm(self) -> float:
        """Height of the marks above the plate."""
        return self.layout[0].height_mm

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the marks."""
        return tuple(mark.name for mark in self.layout)

    def marks(self) -> MarkGeometry:
        """Points from which poses are reconstructed: marks, and corners of tags."""
        return MarkGeometry(_points(self.layout), height_mm=self.height_mm)


def read_geometry(name_or_path: Path) -> RobotGeometry:
    """Read the marks (and the shape, if it is complete) of a shipped robot or a robot.toml.

    Raises SimulationError for an unknown name, else InputError that names file, place and remedy.
    """
    said = read_with(load_measured, name_or_path)
    equal_height_mm(said.layout, str(name_or_path))  # raises if they differ
    return RobotGeometry(said.layout, _shape(said))


def _shape(said: MeasuredRobot) -> RobotShape | None:
    if said.wheel:
        return _shape_of_list(said)
    try:
        length, width = _length(said.body, "length"), _length(said.body, "width")
        x, y, radius = (_length(said.wheels, name) for name in ("wheelbase", "track", "radius"))
    except KeyError:
        return None
    x, y = x / 2, y / 2
    return RobotShape(((x, y), (x, -y), (-x, y), (-x, -y)), radius, length, width)


def _shape_of_list(said: MeasuredRobot) -> RobotShape | None:
    """The shape of a robot with a [[wheel]] list; None if the list is incomplete."""
    try:
        wheels = [Wheel.model_validate(wheel) for wheel in said.wheel]
        length, width = _length(said.body, "length"), _length(said.body, "width")
    except (ValidationError, KeyError):
        return None
    driving = [wheel.radius_mm for wheel in wheels if wheel.driven_by != "none"]
    return RobotShape(
        tuple((wheel.x_mm, wheel.y_mm) for wheel in wheels),
        sum(driving) / len(driving) if driving else wheels[0].radius_mm,
        length,
        width,
        tuple(wheel.name for wheel in wheels),
        tuple(_rolls(wheel) for wheel in wheels),
    )


def _rolls(wheel: Wheel) -> str:
    """Drive of a wheel in the words of RobotShape.driven_by."""
    return wheel.driven_by if wheel.grips else "caster"


def _length(table: dict[str, Any], name: str) -> float:
    """A positive length of a table in mm. Raises KeyError if it is missing."""
    key = f"{name}_mm"
    value = in_standard_units(table, [key])[key]
    if not (isinstance(value, (int, float)) and value > 0):
        raise KeyError(name)
    return float(value)


def sought(robot: RobotGeometry, said: TrackingSettings | None) -> TrackingSettings:
    """Settings of the search for marks: those of tracking.toml, completed by the marks of the robot.

    Raises InputError for a mark whose colour is in neither of them.
    """
    said = said or TrackingSettings()
    of_robot = {mark.name: mark for mark in robot.layout}
    try:
        if "mark" not in said.model_fields_set:
            said = with_marks(said, {name: MarkSettings(kind=mark.kind, id=mark.id) for name, mark in of_robot.items()})
    except ValidationError as error:
        raise InputError(f"{explain(error, load_settings)} in a tracking.toml (--settings)") from error
    changes: dict[str, Any] = {}
    body = tuple(name for name in of_robot if name in said.mark)
    if said.body is None:
        changes["body"] = body if len(body) > 1 else None
    if "distance_diameters" not in said.model_fields_set and len(body) == len(said.mark) == 2:
        diameter = sum(of_robot[name].diameter_mm for name in body) / len(body)
        changes["distance_diameters"] = robot.marks().only(body).spacing_mm / diameter
    return said.model_copy(update=changes)


def reference_pair(robot: Robot) -> tuple[str, str] | None:
    """The two marks (or corners of a tag) of a robot that are farthest apart; None for a robot with one mark."""
    return MarkGeometry.of_robot(robot).farthest_pair() if len(robot.points_mm) > 1 else None


def reference_places(robot: Robot) -> list[tuple[float, float]]:
    """Places of the reference pair, body frame. Raises InputError for a robot with a single mark."""
    pair = reference_pair(robot)
    if pair is None:
        raise InputError(f"{robot.name}: {NO_HEADING}; two marks are needed")
    return [robot.points_mm[name] for name in pair]


def reference_line(robot: Robot) -> Array:
    """From the second to the first of the reference pair, (2,), body frame."""
    first, second = reference_places(robot)
    return np.asarray(np.array(first) - np.array(second))


def stated_distances_mm(robots: Sequence[Robot]) -> list[float]:
    """Distance of the reference pair of each robot; computed once for a robot that thousands of runs share."""
    found = {id(robot): robot for robot in robots}
    known = {key: float(np.hypot(*reference_line(robot))) for key, robot in found.items()}
    return [known[id(robot)] for robot in robots]


def wheel_paths(robot: Robot, marks_mm: Array) -> NDArray[np.complex128]:
    """Wheels on the plate, x + iy in mm, (wheels, n), from marks (n, 4)."""
    first, second = (complex(*place) for place in reference_places(robot))
    seen = marks_mm[:, ::2] + 1j * marks_mm[:, 1::2]
    forward = (seen[:, 0] - seen[:, 1]) / (first - second)
    forward /= np.abs(forward)
    centre = seen.mean(axis=1) - forward * (first + second) / 2
    x, y = robot.wheel_positions_mm().T
    return np.asarray(centre + forward * (x + 1j * y)[:, None])


def reference_marks(table: pd.DataFrame, robot: Robot) -> pd.DataFrame:
    """The table of a robot with two marks; for more marks, time_s and the reference pair computed from all marks.

    If one of three marks is hidden, the pair is still complete. Raises InputError for a robot with a single mark.
    """
    pair = reference_pair(robot)
    if pair is None:
        raise InputError(f"{robot.name}: {NO_HEADING}; two marks are needed")
    if len(robot.points_mm) == len(pair):
        return table
    geometry = MarkGeometry.of_robot(robot)
    poses = poses_from_marks(table, geometry)
    usual = np.nanmedian(poses.spacing_mm) if np.isfinite(poses.spacing_mm).any() else geometry.spacing_mm
    size = np.where(np.isfinite(poses.spacing_mm), poses.spacing_mm, usual) / geometry.spacing_mm
    middle = geometry.places().mean(axis=0)
    found = pd.DataFrame({"time_s": poses.time_s})
    for name in pair:
        place = middle + size[:, None] * (np.array(geometry.places_mm[name]) - middle)
        found[columns_of([name])] = plate_from_body(place, poses.x_mm, poses.y_mm, poses.heading_rad)
    return found


def _points(layout: tuple[Mark, ...]) -> dict[str, tuple[float, float]]:
    return {name: place for mark in layout for name, place in mark.points_mm().items()}


def robot_shape(robot: Robot | MeasuredRobot) -> RobotShape | None:
    """Outline and wheels, body frame, mm; None if a file for measuring alone lacks them."""
    if isinstance(robot, MeasuredRobot):
        return _shape(robot)
    return RobotShape(
        wheel_positions_mm=tuple((float(x), float(y)) for x, y in robot.wheel_positions_mm()),
        wheel_radius_mm=robot.driving_radius_mm,
        length_mm=robot.body.length_mm,
        width_mm=robot.body.width_mm,
        wheel_names=robot.wheel_names,
        driven_by=tuple(map(_rolls, robot.all_wheels)),
    )
