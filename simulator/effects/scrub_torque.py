"""Every contact patch resists spinning about the vertical by the torque radius_mm · f_z, against the yaw rate.

These are the aligning moments n_j of Eq. (2).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from simulator.dynamics.terms import MOMENT, SIGN_YAW, Term
from simulator.effects.definition import Effect, Parameter, Values

if TYPE_CHECKING:
    from simulator.dynamics.model import Draft


def _act(draft: Draft, values: Values) -> None:
    def resist(complete: Draft) -> None:
        _, load = complete.loads_uN()
        complete.add(Term(MOMENT, SIGN_YAW, -values["radius_mm"] * float(load.sum())))

    draft.finally_do(resist)


EFFECT = Effect(
    id="scrub-torque",
    name="contact patches resist turning on the spot",
    kind="dynamics",
    where="contact",
    depends="sign v",
    pattern="common",
    parameters=(Parameter("radius_mm", "mm", 0.0, 0.0, 0.5, 0.005, at_least=0.0),),
    act=_act,
)
