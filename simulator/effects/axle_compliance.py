"""Axles give way sideways: each turns about the vertical by deg_per_mN times the lateral force on its two wheels.

Positive: the axle turns toward the force, counter-clockwise under a force to its left. Angle and force are those of
the balance (simulator.dynamics.axles). Driving forward this feeds itself, driving backward it softens the wheels: it
does not change sign with the velocities, and backward turns become tighter than forward ones, by 0.5 % at 1.1 deg/mN
(model notes). Wheels that gave way one by one, each to its own force, would make it 0.6 %, and beyond 0.7 deg/mN the
wheels of an axle would run away from each other.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from simulator.effects.definition import Effect, Parameter, Values

if TYPE_CHECKING:
    from simulator.dynamics.model import Draft


def _act(draft: Draft, values: Values) -> None:
    draft.compliance_rad_per_mN += math.radians(values["deg_per_mN"])


EFFECT = Effect(
    id="axle-compliance",
    name="axles give way sideways under lateral force",
    kind="dynamics",
    where="wheel",
    depends="sign v",
    pattern="common",
    parameters=(Parameter("deg_per_mN", "deg/mN", 0.0, -5.0, 5.0, 0.05),),
    act=_act,
)
