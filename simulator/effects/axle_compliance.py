"""Axles give way sideways: each wheel turns about the vertical by deg_per_mN times the lateral force on it.

Positive: the wheel turns toward the force, counter-clockwise under a force to its left. The angle and the force that
it changes are solved together to second order. Driving forward this feeds itself, driving backward it softens the
wheel: it does not change sign with the velocities, and backward turns become tighter than forward ones.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from simulator.effects.definition import Effect, Parameter, Values

if TYPE_CHECKING:
    from simulator.model import Draft


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
