"""Friction higher or lower than stated."""

from __future__ import annotations

from simulator.effects.definition import Effect, Values
from simulator.effects.draft import Draft
from simulator.effects.parameter import Parameter


def _act(draft: Draft, values: Values) -> None:
    draft.friction_factor *= values["factor"]


EFFECT = Effect(
    id="friction-level",
    name="friction is higher or lower than stated",
    sentence="Both friction coefficients of all wheels are factor times the stated ones; the stiffness for small slip "
    "stays.",
    law="μ_x = factor · μ_x,nominal and μ_y = factor · μ_y,nominal",
    source="Coulomb's friction: the limit of the force is the coefficient times the load",
    limits="One factor for all wheels, directions and slips: the shape of the slip curve stays.",
    kind="dynamics",
    parameters=(Parameter("factor", "", 1.0, 0.01, 0.2, 5.0, at_least=0.01, shown=3.0),),
    act=_act,
)
