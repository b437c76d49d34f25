"""Axles that yield to lateral force."""

from __future__ import annotations

import math

from simulator.effects.definition import Effect, Values
from simulator.effects.draft import Draft
from simulator.effects.parameter import Parameter


def _act(draft: Draft, values: Values) -> None:
    draft.compliance_rad_per_mN += math.radians(values["deg_per_mN"])


EFFECT = Effect(
    id="axle-compliance",
    name="axles give way sideways under lateral force",
    sentence="Each axle turns about the vertical by deg_per_mN times the lateral force on its two wheels together, "
    "counter-clockwise under a force to its left.",
    law="δ = deg_per_mN · (F_y,left + F_y,right), with the forces that the wheels have at the angle δ",
    source="compliance steer (ISO 8855; Milliken & Milliken, Race Car Vehicle Dynamics)",
    limits="Linear and without delay: no play, no inertia of the axle. Driving forward, a positive compliance "
    "amplifies itself; beyond the inverse cornering stiffness of the axle, no angle balances the force. Wheels that "
    "yield separately, each to its own force, follow another law: the backward turn of 33.3/14.4 rpm at 1.1 deg/mN "
    "would be tighter by 0.6 %, not by 0.5 %.",
    kind="dynamics",
    parameters=(Parameter("deg_per_mN", "deg/mN", 0.0, 0.05, -20.0, 20.0),),
    act=_act,
)
