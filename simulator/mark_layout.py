"""Marks on a robot as robot.toml describes them: names, places, sizes, heights and kinds.

Body frame, mm. [[mark]] describes them one by one; [marks] is its shorthand for coloured marks that differ in place
only, with a key NAME_mm = [x, y] for each.
"""

from __future__ import annotations

import difflib
import math
import re
import tomllib
from functools import cache
from importlib.resources import files
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from simulator.units import in_standard_units

Positive = Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(strict=True, ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Place = tuple[float, float]
Kind = Literal["color", "light", "aruco", "apriltag"]
TAGS: tuple[Kind, ...] = ("aruco", "apriltag")
DIAMETER_MM, HEIGHT_MM = 1.0, 6.5  # of the paper's marks
# Names begin the names of columns and of keys: letters and digits of any script, and within them _, - and blanks.
MARK_NAME = r"^\w(?:[\w -]*\w)?$"


def is_mark_name(name: str) -> bool:
    """Whether a mark may have a name."""
    return re.fullmatch(MARK_NAME, name) is not None


class Mark(BaseModel):
    """One [[mark]] on the robot."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str = Field(pattern=MARK_NAME)
    x_mm: Finite  # forward, of the centre
    y_mm: Finite  # to the left, of the centre
    diameter_mm: Positive = DIAMETER_MM  # of a tag: side of its black square
    height_mm: NotNegative = HEIGHT_MM  # above the plate
    kind: Kind = "color"  # appearance
    id: Annotated[int, Field(ge=0)] | None = None  # number of a tag; default: the number at the end of its name

    @model_validator(mode="before")
    @classmethod
    def _read(cls, content: Any) -> Any:
        return in_mm(content)

    @property
    def place_mm(self) -> Place:
        """Its place in the body frame."""
        return self.x_mm, self.y_mm

    def points_mm(self) -> dict[str, Place]:
        """Its centre by its name; of a tag also its corners, NAME_corner1 to 4, as OpenCV orders them.

        A tag's columns run along the body's x axis and its rows along −y.
        """
        points, half = {self.name: self.place_mm}, self.diameter_mm / 2
        if self.kind in TAGS:
            for k, (ahead, left) in enumerate(((-1, 1), (1, 1), (1, -1), (-1, -1)), start=1):
                points[f"{self.name}_corner{k}"] = self.x_mm + ahead * half, self.y_mm + left * half
        return points


class Marks(BaseModel):
    """[marks]: NAME_mm = [x, y] of every mark, body frame."""

    model_config = ConfigDict(extra="allow", frozen=True)
    __pydantic_extra__: dict[str, tuple[Finite, Finite]] = Field(init=False)

    diameter_mm: Positive = DIAMETER_MM  # of all marks
    height_mm: NotNegative = HEIGHT_MM  # of all marks, above the plate

    @model_validator(mode="before")
    @classmethod
    def _read(cls, content: Any) -> Any:
        content = in_mm(content)
        if isinstance(content, dict):
            for key, value in content.items():
                if key not in cls.model_fields and not (key.endswith("_mm") and isinstance(value, (list, tuple))):
                    raise ValueError(_unknown(key, list(cls.model_fields)))
        return content

    @property
    def places_mm(self) -> dict[str, Place]:
        """Places by name, in the order of the file."""
        return {key.removesuffix("_mm"): place for key, place in (self.__pydantic_extra__ or {}).items()}

    def each(self) -> tuple[Mark, ...]:
        """Every mark with its place, diameter and height."""
        return tuple(
            Mark(name=name, x_mm=x, y_mm=y, diameter_mm=self.diameter_mm, height_mm=self.height_mm)
            for name, (x, y) in self.places_mm.items()
        )


def checked_layout(marks: Marks, mark: tuple[Mark, ...]) -> tuple[Mark, ...]:
    """All marks of a robot, from [marks] or [[mark]]. Raises ValueError if both are given or a name is repeated."""
    if mark and marks.places_mm:
        raise ValueError("there are both [marks] and [[mark]]; keep one of them")
    layout = mark or marks.each()
    names = [item.name for item in layout]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ValueError(f"mark name {', '.join(twice)} is used more than once")
    return layout


def in_mm(content: Any) -> Any:
    """A table with lengths in m (keys that end in _m) converted to mm. Raises ValueError if one is given in both."""
    if not isinstance(content, dict):
        return content
    return in_standard_units(content, [f"{key}m" for key in content if isinstance(key, str) and key.endswith("_m")])


def _unknown(key: str, known: list[str]) -> str:
    near = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]}?" if near else "a mark is NAME_mm = [x, y]"
    return f"unknown key marks.{key}; {hint}"


def with_default_places(content: Any) -> Any:
    """Content of robot.toml; without marks, those of the paper's robot are added.

    Their positions are scaled with the length of the body: a robot of a metre that is measured by poses needs marks
    which are far enough apart to show its heading.
    """
    if not isinstance(content, dict) or content.get("mark"):
        return content
    said = content.get("marks", {})
    if not isinstance(said, dict) or any(key not in Marks.model_fields for key in in_mm(said)):
        return content
    paper = _paper_robot()
    places = {key: value for key, value in paper["marks"].items() if key not in Marks.model_fields}
    ratio = _length_mm(content.get("body"), paper["body"]["length_mm"]) / paper["body"]["length_mm"]
    sized = {key: [ratio * x, ratio * y] for key, (x, y) in places.items()}
    return {**content, "marks": {**sized, **said}}


def _length_mm(body: Any, otherwise_mm: float) -> float:
    """Length of a [body] as given, mm; otherwise_mm if it is missing or invalid."""
    length = in_mm(body).get("length_mm") if isinstance(body, dict) else None
    if isinstance(length, int | float) and not isinstance(length, bool) and 0 < length < math.inf:
        return float(length)
    return otherwise_mm


@cache
def _paper_robot() -> dict[str, Any]:
    return tomllib.loads(files("simulator").joinpath("robots", "barrel.toml").read_text(encoding="utf-8"))
