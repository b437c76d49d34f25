"""A camera that does not look straight down."""

from __future__ import annotations

from simulator.effects.definition import Effect, Values
from simulator.effects.parameter import Parameter
from simulator.effects.view import View


def _view(view: View, values: Values) -> None:
    x, y = view.keystone_per_mm
    view.keystone_per_mm = (x + values["per_mm_x"], y + values["per_mm_y"])


EFFECT = Effect(
    id="camera-tilt",
    name="scale changes across the picture",
    sentence="Measured coordinates are the true ones (x, y) times 1 + per_mm_x·x + per_mm_y·y, in the plate frame.",
    law="(x, y) measured = (x, y) · (1 + per_mm_x·x + per_mm_y·y)",
    source="keystone: a homography whose last row is (−per_mm_x, −per_mm_y, 1), to first order "
    "(Hartley & Zisserman, Multiple View Geometry in Computer Vision)",
    limits="First order in the tilt: the next term is the square of the correction, 1e-4 where the scale is off by "
    "1 %. The origin of the plate frame keeps its place and scale.",
    kind="observation",
    parameters=(
        Parameter("per_mm_x", "1/mm", 0.0, 1e-4, -0.02, 0.02, shown=0.01),
        Parameter("per_mm_y", "1/mm", 0.0, 1e-4, -0.02, 0.02, shown=0.01),
    ),
    view=_view,
)
