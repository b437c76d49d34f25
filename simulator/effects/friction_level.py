"""Both friction coefficients of all wheels are off by one factor; the stiffness for small slip stays."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simulator.effects.definition import Effect, Parameter, Values

if TYPE_CHECKING:
    from simulator.dynamics.model import Draft


def _act(draft: Draft, values: Values) -> None:
    draft.friction_factor *= values["factor"]


EFFECT = Effect(
    id="friction-level",
    name="friction is higher or lower than stated",
    kind="dynamics",
    where="contact",
    depends="constant",
    pattern="common",
    parameters=(Parameter("factor", "", 1.0, 0.3, 3.0, 0.02, at_least=0.01),),
    act=_act,
)
