"""Grinding marks: friction = nominal · (1 + amplitude · cos(2·(slide - direction))).

slide: direction in the plate frame in which the contact slides over the plate, of a driven wheel, which rolls freely,
along its axle; friction is largest along direction_deg.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from simulator.dynamics.terms import FRICTION, SLIDE_COS2, SLIDE_SIN2, Term
from simulator.effects.definition import Effect, Parameter, Values

if TYPE_CHECKING:
    from simulator.dynamics.model import Draft


def _act(draft: Draft, values: Values) -> None:
    amplitude, direction = values["amplitude"], math.radians(values["direction_deg"])
    draft.add(
        Term(FRICTION, SLIDE_COS2, amplitude * math.cos(2 * direction)),
        Term(FRICTION, SLIDE_SIN2, amplitude * math.sin(2 * direction)),
    )


EFFECT = Effect(
    id="friction-grain",
    name="friction depends on the direction over the plate",
    kind="dynamics",
    where="plate field",
    depends="heading",
    pattern="common",
    parameters=(
        Parameter("amplitude", "", 0.0, 0.0, 0.8, 0.01, at_least=0.0),
        Parameter("direction_deg", "deg", 0.0, -90.0, 90.0, 5.0),
    ),
    act=_act,
)
