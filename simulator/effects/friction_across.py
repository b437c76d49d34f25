"""Lateral friction of the wheels higher or lower than stated, relative to their longitudinal friction."""

from __future__ import annotations

from simulator.effects.definition import Effect, Values
from simulator.effects.draft import Draft
from simulator.effects.parameter import Parameter


def _act(draft: Draft, values: Values) -> None:
    draft.across_factor *= values["factor"]


EFFECT = Effect(
    id="friction-across",
    name="friction across the wheels is higher or lower than stated",
    sentence="The lateral friction coefficient of all wheels is factor times the stated one; the longitudinal "
    "coefficient and the stiffness for small slip are unchanged.",
    law="μ_y = factor · μ_y,nominal",
    source="tread with more lateral than longitudinal grip: measured and wheel yaw rates of a Clearpath Husky "
    "(tests/benchmarks)",
    limits="One factor for all wheels. A larger factor reduces the yaw rate, most of all on the spot; scrub-torque "
    "reduces it in wide turns as well.",
    kind="dynamics",
    parameters=(Parameter("factor", "", 1.0, 0.01, 0.3, 3.0, at_least=0.01, shown=2.0),),
    act=_act,
    of_ground=True,
)
