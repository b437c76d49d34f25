"""Driving wheels are turned about the vertical, counter-clockwise positive seen from above."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from simulator.effects.definition import Effect, Parameter, Values

if TYPE_CHECKING:
    from simulator.dynamics.model import Draft


def _act(draft: Draft, values: Values) -> None:
    draft.toe_rad[0] += math.radians(values["left_deg"])
    draft.toe_rad[1] += math.radians(values["right_deg"])


EFFECT = Effect(
    id="wheel-toe",
    name="the driving wheels are not parallel to the body",
    kind="dynamics",
    where="wheel",
    depends="constant",
    pattern="left-right",
    parameters=(
        Parameter("left_deg", "deg", 0.0, -10.0, 10.0, 0.1),
        Parameter("right_deg", "deg", 0.0, -10.0, 10.0, 0.1),
    ),
    act=_act,
)
