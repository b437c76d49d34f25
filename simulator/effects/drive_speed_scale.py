"""Both surface speeds are off by one factor, as from a wrong wheel radius or motor gain."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simulator.effects.definition import Effect, Parameter, Values

if TYPE_CHECKING:
    from simulator.dynamics.model import Draft


def _act(draft: Draft, values: Values) -> None:
    draft.speed_factor *= values["factor"]


EFFECT = Effect(
    id="drive-speed-scale",
    name="both driving wheels are faster or slower than commanded",
    kind="dynamics",
    where="actuator",
    depends="constant",
    pattern="common",
    parameters=(Parameter("factor", "", 1.0, 0.8, 1.25, 0.002, at_least=0.01),),
    act=_act,
)
