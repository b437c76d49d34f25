"""Positions of the marks on a robot, body frame, mm."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Protocol

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from evaluator.errors import InputError
from evaluator.marks import columns_of, mark_names
from evaluator.rigid_fit import pose_jacobian

Array = NDArray[np.float64]
Place = tuple[float, float]

# Marks CSV have six decimals of a millimetre: rounding error of one coordinate, the smallest sigma of a file.
ROUNDING_SIGMA_MM = 1e-6 / np.sqrt(12)
# Marks nearer than this, the rounding error of four coordinates, are at one position: no heading.
ONE_PLACE_MM = 10 * ROUNDING_SIGMA_MM
UNNAMED = "mark "
CORNER = "_corner"  # part of the names of corners of tags
# Drawn axes in distances of the marks: of the paper's robot, from its centre beyond its front and to its wheels.
AHEAD, TO_THE_LEFT = 1.1, 0.55


class MarkAtHeight(Protocol):
    """A mark as `MarkGeometry.of_robot` reads it."""

    @property
    def height_mm(self) -> float: ...  # noqa: D102


class MarksKnownTo(Protocol):
    """Standard uncertainties of a robot's marks, and whether its file states them."""

    @property
    def mark_position_mm(self) -> float: ...  # noqa: D102
    @property
    def mark_height_mm(self) -> float: ...  # noqa: D102
    def states(self, key: str) -> bool: ...  # noqa: D102


class RobotWithMarks(Protocol):
    """A robot as `MarkGeometry.of_robot` reads it, such as simulator.Robot."""

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def layout(self) -> Sequence[MarkAtHeight]: ...  # noqa: D102
    @property
    def points_mm(self) -> Mapping[str, Place]: ...  # noqa: D102
    @property
    def known_to(self) -> MarksKnownTo: ...  # noqa: D102


@dataclass(frozen=True, init=False, eq=True)
class MarkGeometry:
    """Positions of the marks on the robot: body frame, mm; height_mm above the plate (needed with a camera only).

    MarkGeometry({"front": (2, 0), "rear": (-2, 0)}, height_mm=6.5); with keywords as in [marks] of robot.toml,
    MarkGeometry(front_mm=(2, 0), rear_mm=(-2, 0)); or positions alone, MarkGeometry((2, 0), (-2, 0)), for the marks of
    a table in its order. MarkGeometry.of_robot(robot) takes positions and height from a robot, with the standard
    uncertainties that it states: place_sigma_mm of every mark along each axis, height_sigma_mm of all marks.
    """

    places_mm: Mapping[str, Place]
    height_mm: float | None = None
    place_sigma_mm: float = 0.0
    height_sigma_mm: float = 0.0

    def __init__(self, *places: Mapping[str, Place] | Place | float, **named: Place | float | None) -> None:
        """Refuse marks at one position (they determine no heading), and a robot without any. Raises InputError."""
        found: dict[str, Place] = {}
        height: Any = named.pop("height_mm", None)
        sigmas = {key: float(named.pop(key, None) or 0.0) for key in ("place_sigma_mm", "height_sigma_mm")}  # type: ignore[arg-type]
        for item in places:
            if isinstance(item, Mapping):
                found |= {str(name): _place(place) for name, place in item.items()}
            elif isinstance(item, (int, float)):
                height = float(item)
            elif item is not None:
                found[f"{UNNAMED}{len(found) + 1}"] = _place(item)
        found |= {name.removesuffix("_mm"): _place(place) for name, place in named.items()}
        if not found:
            raise InputError("marks: there is none; give their positions on the robot")
        for (first, at), (second, other) in combinations(found.items(), 2):
            if not np.hypot(at[0] - other[0], at[1] - other[1]) > ONE_PLACE_MM:
                raise InputError(
                    f"marks: {first} and {second} are both at {at}; a heading needs two different positions"
                )
        object.__setattr__(self, "places_mm", found)
        object.__setattr__(self, "height_mm", height)
        for key, sigma in sigmas.items():
            object.__setattr__(self, key, sigma)

    @staticmethod
    def of_robot(robot: RobotWithMarks) -> MarkGeometry:
        """Positions and height of the marks of a robot. Raises InputError if they are at different heights."""
        known = robot.known_to
        place, height = (
            getattr(known, key) if known.states(key) else 0.0 for key in ("mark_position_mm", "mark_height_mm")
        )
        return MarkGeometry(robot.points_mm, height_mm=equal_height_mm(robot.layout, robot.name)).with_sigmas(
            place, height
        )

    def __getattr__(self, name: str) -> Place:
        """Positions by the keys of [marks], NAME_mm."""
        places = self.__dict__.get("places_mm", {})
        if name.removesuffix("_mm") in places and name.endswith("_mm"):
            return _place(places[name.removesuffix("_mm")])
        raise AttributeError(name)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the marks, in their order."""
        return tuple(self.places_mm)

    def shown(self) -> dict[str, Place]:
        """Positions of the marks without the corners of tags."""
        return {name: place for name, place in self.places_mm.items() if CORNER not in name}

    def places(self) -> Array:
        """Positions (m, 2)."""
        return np.array(list(self.places_mm.values()), dtype=float)

    def farthest_pair(self) -> tuple[str, str]:
        """The two marks that are farthest apart, in their order. There must be two."""
        return max(combinations(self.places_mm, 2), key=lambda pair: self._apart(*pair))

    @property
    def spacing_mm(self) -> float:
        """Largest distance between two marks; NaN for a single one."""
        return self._apart(*self.farthest_pair()) if len(self.places_mm) > 1 else float("nan")

    def pose_shifts(self) -> Array:
        """Shifts (k, 3) of centre and heading, body frame, by one standard deviation of each coordinate of each mark.

        They are those of the rigid fit (pose_jacobian). The corners of a tag are displaced together.
        """
        if not self.place_sigma_mm:
            return np.zeros((0, 3))
        places, owners = self.places(), [name.split(CORNER)[0] for name in self.places_mm]
        if len(places) == 1:
            by_point = np.array([[[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]]])
        else:
            by_point = pose_jacobian(places[None], np.zeros(1), places, np.ones(len(places)))[0]
        marks = [by_point[[owner == mark for owner in owners]].sum(axis=0) for mark in dict.fromkeys(owners)]
        return self.place_sigma_mm * np.concatenate(marks, axis=1).T

    @property
    def axes_mm(self) -> tuple[float, float]:
        """Lengths at which the robot's axes are drawn, ahead and to the left; NaN for a single mark."""
        return AHEAD * self.spacing_mm, TO_THE_LEFT * self.spacing_mm

    def only(self, names: Iterable[str]) -> MarkGeometry:
        """Some of the marks, in the order of the robot."""
        chosen = set(names)
        return self._at({name: place for name, place in self.places_mm.items() if name in chosen})

    def seen_in(self, table: pd.DataFrame) -> MarkGeometry:
        """The marks that a table contains, all if it has too few for a pose. Unnamed positions get their names."""
        if all(name.startswith(UNNAMED) for name in self.places_mm):
            names = mark_names(table)[: len(self.places_mm)]
            if len(names) < len(self.places_mm):
                names = mark_names(table, "px")[: len(self.places_mm)]
            if len(names) == len(self.places_mm):
                return self._at(dict(zip(names, self.places_mm.values(), strict=True)))
        there = [name for name in self.places_mm if set(columns_of([name])) <= set(table)]
        return self.only(there) if 2 <= len(there) < len(self.places_mm) else self

    def with_sigmas(self, place_sigma_mm: float = 0.0, height_sigma_mm: float = 0.0) -> MarkGeometry:
        """The same marks with other standard uncertainties of their positions and height."""
        return MarkGeometry(
            self.places_mm,
            height_mm=self.height_mm,
            place_sigma_mm=place_sigma_mm,
            height_sigma_mm=height_sigma_mm,
        )

    def _at(self, places_mm: Mapping[str, Place]) -> MarkGeometry:
        """Marks at other places, known as well as these."""
        moved = MarkGeometry(places_mm, height_mm=self.height_mm)
        return moved.with_sigmas(self.place_sigma_mm, self.height_sigma_mm)

    def _apart(self, first: str, second: str) -> float:
        one, other = self.places_mm[first], self.places_mm[second]
        return float(np.hypot(one[0] - other[0], one[1] - other[1]))


def equal_height_mm(layout: Sequence[MarkAtHeight], name: str) -> float:
    """The height of all marks of a robot with this name. Raises InputError if they are at different heights."""
    heights = sorted({mark.height_mm for mark in layout})
    if len(heights) > 1:
        raise InputError(f"{name}: marks of different heights {heights}; measuring needs equal ones")
    return heights[0]


def _place(place: Any) -> Place:
    x, y = place
    return float(x), float(y)
