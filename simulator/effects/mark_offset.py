"""The pair of marks is turned by angle_deg about the robot's centre, then moved by (x_mm, y_mm), body frame."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from simulator.effects.definition import Effect, Parameter, Values

if TYPE_CHECKING:
    from simulator.effects.view import View


def _view(view: View, values: Values) -> None:
    angle, moved = math.radians(values["angle_deg"]), []
    cos, sin = math.cos(angle), math.sin(angle)
    for x, y in (view.green_mm, view.yellow_mm):
        moved.append((cos * x - sin * y + values["x_mm"], sin * x + cos * y + values["y_mm"]))
    view.green_mm, view.yellow_mm = moved


EFFECT = Effect(
    id="mark-offset",
    name="the marks are not where the robot file says",
    kind="observation",
    where="observation",
    depends="constant",
    pattern="common",
    parameters=(
        Parameter("x_mm", "mm", 0.0, -1.0, 1.0, 0.01),
        Parameter("y_mm", "mm", 0.0, -1.0, 1.0, 0.01),
        Parameter("angle_deg", "deg", 0.0, -10.0, 10.0, 0.1),
    ),
    view=_view,
)
