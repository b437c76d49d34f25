"""What measurement needs to know of a robot: where its marks are, and, where it is given, its outline and wheels.

Measurement never sees the model: only these few lengths pass from robot.toml to it, and a file that holds nothing but
[marks] or [[mark]] is enough for it. Body frame, mm.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, model_validator

from evaluator.errors import InputError
from evaluator.files import read_with
from evaluator.pose import MarkGeometry
from evaluator.turning import RobotShape
from simulator.robot import Robot, shipped_robot_text, shipped_robots

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
MM_PER_M = 1000.0


class Table(BaseModel):
    """A table of marks: unknown keys are errors; lengths may be given in m instead of mm."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _in_mm(cls, content: Any) -> Any:
        if not isinstance(content, dict):
            return content
        result = dict(content)
        for key, value in content.items():
            name = f"{key}m"
            if key.endswith("_m") and name in cls.model_fields and name not in content:
                result[name] = _times_1000(value)
                del result[key]
        return result


class Marks(Table):
    """[marks]: the green and the yellow one."""

    green_mm: tuple[Finite, Finite]
    yellow_mm: tuple[Finite, Finite]
    diameter_mm: Positive = 1.0
    height_mm: NotNegative = 6.5


class Mark(Table):
    """One [[mark]] of any name."""

    name: str
    x_mm: Finite
    y_mm: Finite
    diameter_mm: Positive = 1.0
    height_mm: NotNegative = 6.5
    kind: str = "color"


class MeasuredRobot(BaseModel):
    """The part of robot.toml that measurement reads; the simulator checks the rest."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    marks: Marks | None = None
    mark: tuple[Mark, ...] = ()
    body: dict[str, Any] = Field(default_factory=dict)
    wheels: dict[str, Any] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _has_marks(self) -> MeasuredRobot:
        if self.marks is None and not self.mark:
            raise ValueError("there is neither [marks] nor [[mark]]; say where the marks sit on the robot")
        if self.marks is not None and self.mark:
            raise ValueError("there are both [marks] and [[mark]]; keep one of them")
        return self


@dataclass(frozen=True)
class RobotGeometry:
    """Places of the marks by name, in the order of the file, their height above the plate, and the shape if known."""

    places_mm: dict[str, tuple[float, float]]
    height_mm: float
    shape: RobotShape | None = None

    def of_pair(self, first: str, second: str) -> MarkGeometry:
        """Geometry of two marks, the first of which is called green in what follows."""
        return MarkGeometry(self.places_mm[first], self.places_mm[second], self.height_mm)


def load_measured(name_or_path: Path) -> MeasuredRobot:
    """Read what measurement needs of a shipped robot by name or of any robot.toml by path.

    Raises SimulationError for an unknown name, else OSError, tomllib.TOMLDecodeError, pydantic.ValidationError.
    """
    text = str(name_or_path)
    if text not in shipped_robots() and (text.endswith(".toml") or Path(text).exists()):
        content = Path(text).read_text(encoding="utf-8")
    else:
        content = shipped_robot_text(text)
    return MeasuredRobot.model_validate(tomllib.loads(content))


def read_geometry(name_or_path: Path) -> RobotGeometry:
    """Read the marks (and the shape, where it is whole) of a shipped robot or a robot.toml.

    Raises SimulationError for an unknown name, else InputError that names file, place and remedy.
    """
    said = read_with(load_measured, name_or_path)
    if said.marks is not None:
        places = {"green": said.marks.green_mm, "yellow": said.marks.yellow_mm}
        return RobotGeometry(places, said.marks.height_mm, _shape(said))
    heights = {mark.height_mm for mark in said.mark}
    if len(heights) > 1:
        raise InputError(f"{name_or_path}: marks of different heights {sorted(heights)}; measuring needs equal ones")
    return RobotGeometry({mark.name: (mark.x_mm, mark.y_mm) for mark in said.mark}, heights.pop(), _shape(said))


def _shape(said: MeasuredRobot) -> RobotShape | None:
    try:
        length, width = _length(said.body, "length"), _length(said.body, "width")
        x, y, radius = (_length(said.wheels, name) for name in ("wheelbase", "track", "radius"))
    except KeyError:
        return None
    x, y = x / 2, y / 2
    return RobotShape(((x, y), (x, -y), (-x, y), (-x, -y)), radius, length, width)


def _length(table: dict[str, Any], name: str) -> float:
    """A positive length of a table in mm. Raises KeyError where there is none."""
    for key, factor in ((f"{name}_mm", 1.0), (f"{name}_m", MM_PER_M)):
        value = table.get(key)
        if isinstance(value, (int, float)) and value > 0:
            return float(value) * factor
    raise KeyError(name)


def _times_1000(value: Any) -> Any:
    if isinstance(value, list):
        return [_times_1000(item) for item in value]
    return value * MM_PER_M if isinstance(value, (int, float)) else value


def mark_geometry(robot: Robot) -> MarkGeometry:
    """Where the marks are: body frame and height above the plate, mm."""
    marks = robot.marks
    return MarkGeometry(green_mm=marks.green_mm, yellow_mm=marks.yellow_mm, height_mm=marks.height_mm)


def robot_shape(robot: Robot) -> RobotShape:
    """Outline and wheels, body frame, mm."""
    return RobotShape(
        wheel_positions_mm=tuple((float(x), float(y)) for x, y in robot.wheel_positions_mm()),
        wheel_radius_mm=robot.driving_radius_mm,
        length_mm=robot.body.length_mm,
        width_mm=robot.body.width_mm,
        wheel_names=robot.wheel_names,
        driven_by=tuple(wheel.driven_by for wheel in robot.all_wheels),
    )
