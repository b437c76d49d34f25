"""The wheels of a robot as arrays, computed once for all records compiled from it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from simulator.dynamics.record import NO_COMMAND, SIDES, model_type
from simulator.dynamics.scale import time_unit_s
from simulator.dynamics.statics import Rectangle
from simulator.dynamics.terms import UN_PER_MN
from simulator.nominal_robot import NominalRobot, Wheel, four_wheels

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
MOST_LAYOUTS = 256  # cached: a fit varies radius, wheelbase and track of a robot


@dataclass(frozen=True, eq=False)
class Layout:
    """Wheels in their order; arrays over them are (n,), or (n, 2) for positions in the body frame, and read-only.

    left, right, driving, rolling: wheels driven by the left, the right, either and no command; casters and balls are in
    none of them. turning: for each wheel, surface speed per rpm in the units of the kernels, whether the left and the
    right command drive it, and radius in mm times the unit of length in mm. time_unit_s: see simulator.dynamics.scale.
    """

    wheels: tuple[Wheel, ...]
    places_mm: Array
    attraction_uN: Array
    left: Flags
    right: Flags
    driving: Flags
    rolling: Flags
    turning: tuple[tuple[float, bool, bool, float], ...]
    rectangle: Rectangle | None
    time_unit_s: float

    @staticmethod
    def of(robot: NominalRobot) -> Layout:
        """The layout of a robot."""
        if robot.wheels is None:
            return _layout(robot.wheel)
        attraction = robot.magnetic_attraction
        return _of_four(
            *(robot.wheels.wheelbase_mm, robot.wheels.track_mm, robot.wheels.radius_mm),
            *(attraction.driving_wheel_mN, attraction.driven_wheel_mN),
        )

    def record(self, slots: int) -> NDArray[np.void]:
        """A new record (1,) with room for `slots` wheels, filled with the fields that no effect changes."""
        return _record(self, slots).copy().view(model_type(slots))


@lru_cache(MOST_LAYOUTS)
def _record(layout: Layout, slots: int) -> NDArray[np.int64]:
    """The record as 64-bit words, which numpy copies faster than fields."""
    model, count, length = np.zeros(1, model_type(slots)), len(layout.wheels), layout.time_unit_s**2
    row = model[0]
    row["time_unit"], row["wheels"] = layout.time_unit_s, count
    row["wheel_x"][:count], row["wheel_y"][:count] = layout.places_mm.T / length
    row["driving"][:count] = layout.driving
    row["side"] = NO_COMMAND
    row["side"][:count] = [SIDES[wheel.driven_by] for wheel in layout.wheels]
    return model.view(np.int64)


@lru_cache(MOST_LAYOUTS)
def _of_four(wheelbase: float, track: float, radius: float, driving: float, driven: float) -> Layout:
    return _layout(four_wheels(wheelbase, track, radius, driving, driven))


@lru_cache(MOST_LAYOUTS)
def _layout(wheels: tuple[Wheel, ...]) -> Layout:
    places = np.array([[wheel.x_mm, wheel.y_mm] for wheel in wheels])
    left, right, rolling = (
        np.array([wheel.grips and wheel.driven_by == side for wheel in wheels]) for side in ("left", "right", "none")
    )
    attraction = np.array([UN_PER_MN * wheel.attraction_mN for wheel in wheels])
    driving = left | right
    for array in (places, attraction, left, right, driving, rolling):
        array.setflags(write=False)
    unit = time_unit_s(places)
    turning = tuple(
        (2 * math.pi * wheel.radius_mm / 60 / unit**2, bool(on_left), bool(on_right), wheel.radius_mm * unit**2)
        for wheel, on_left, on_right in zip(wheels, left, right, strict=True)
    )
    return Layout(wheels, places, attraction, left, right, driving, rolling, turning, Rectangle.of(places), unit)
