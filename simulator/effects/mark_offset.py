"""Marks that are not where the robot file says."""

from __future__ import annotations

import math

from simulator.effects.definition import Effect, Values
from simulator.effects.parameter import Parameter
from simulator.effects.view import View


def _view(view: View, values: Values) -> None:
    angle, moved = math.radians(values["angle_deg"]), []
    cos, sin = math.cos(angle), math.sin(angle)
    for x, y in view.places_mm:
        moved.append((cos * x - sin * y + values["x_mm"], sin * x + cos * y + values["y_mm"]))
    view.places_mm = tuple(moved)


EFFECT = Effect(
    id="mark-offset",
    name="the marks are not where the robot file says",
    sentence="The marks are turned together by angle_deg about the robot's centre, then moved by (x_mm, y_mm) in the "
    "body frame.",
    law="p = R(angle_deg) · p_stated + (x_mm, y_mm), for all marks",
    source="rigid displacement in the plane",
    limits="The distances between the marks do not change. The effect does not describe marks that are displaced one "
    "by one, or marks at another height.",
    kind="observation",
    parameters=(
        Parameter("x_mm", "mm", 0.0, 0.02, -3.0, 3.0),
        Parameter("y_mm", "mm", 0.0, 0.02, -3.0, 3.0),
        Parameter("angle_deg", "deg", 0.0, 0.2, -45.0, 45.0),
    ),
    view=_view,
)
