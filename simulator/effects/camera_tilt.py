"""A camera that does not look straight down."""

from __future__ import annotations

from simulator.effects.definition import Effect, Values
from simulator.effects.parameter import Parameter
from simulator.effects.view import View


def _view(view: View, values: Values) -> None:
    x, y = view.keystone_per_mm
    view.keystone_per_mm = (x + values["per_mm_x"], y + values["per_mm_y"])
    view.perspective = max(view.perspective, values.get("perspective", 0.0))


EFFECT = Effect(
    id="camera-tilt",
    name="scale changes across the image",
    sentence="Measured coordinates are the true ones (x, y) times 1 + t + perspective · t²/(1 − t), "
    "t = per_mm_x·x + per_mm_y·y, in the plate frame: perspective is 1 for a camera that is tilted, 0 for a scale that "
    "changes evenly.",
    law="(x, y) measured = (x, y) · (1 + t + perspective · t²/(1 − t)), t = per_mm_x·x + per_mm_y·y; "
    "with perspective 1: (x, y)/(1 − t)",
    source="keystone: a homography whose last row is (−per_mm_x, −per_mm_y, 1) "
    "(Hartley & Zisserman, Multiple View Geometry in Computer Vision)",
    limits="The origin of the plate frame keeps its place and scale. If t is below some per cent, perspective is of "
    "second order and cannot be measured.",
    kind="observation",
    of_plate=True,
    parameters=(
        Parameter("per_mm_x", "1/mm", 0.0, 1e-4, -0.02, 0.02, shown=0.01),
        Parameter("per_mm_y", "1/mm", 0.0, 1e-4, -0.02, 0.02, shown=0.01),
        Parameter("perspective", "", 0.0, 0.2, 0.0, 1.0, at_least=0.0, shown=1.0, closed=True),
    ),
    view=_view,
)
