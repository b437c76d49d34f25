"""Driving wheels that are not parallel to the body."""

from __future__ import annotations

import math

from simulator.effects.definition import Effect, Values
from simulator.effects.draft import Draft
from simulator.effects.parameter import Parameter


def _act(draft: Draft, values: Values) -> None:
    draft.toe_rad[draft.layout.left] += math.radians(values["left_deg"])
    draft.toe_rad[draft.layout.right] += math.radians(values["right_deg"])


EFFECT = Effect(
    id="wheel-toe",
    name="the driving wheels are not parallel to the body",
    sentence="The driving wheels of either side are turned about the vertical by left_deg and right_deg, "
    "counter-clockwise seen from above.",
    law="the wheel's slip and friction are those of its own axes, turned by left_deg or right_deg from the body's",
    source="static toe (ISO 8855)",
    limits="The contact point does not move. Camber, and the toe of driven wheels, are left out.",
    kind="dynamics",
    parameters=(
        Parameter("left_deg", "deg", 0.0, 0.2, -30.0, 30.0, shown=4.0),
        Parameter("right_deg", "deg", 0.0, 0.2, -30.0, 30.0, shown=-4.0),
    ),
    act=_act,
)
