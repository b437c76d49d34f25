"""No rotation while the command is below rpm in size; from there on the motor turns as commanded."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simulator.effects.definition import Effect, Parameter, Values

if TYPE_CHECKING:
    from simulator.dynamics.model import Draft


def _act(draft: Draft, values: Values) -> None:
    draft.dead_band_rpm = max(draft.dead_band_rpm, values["rpm"])


EFFECT = Effect(
    id="dead-band",
    name="the motors do not turn at small commands",
    kind="command",
    where="command",
    depends="constant",
    pattern="common",
    parameters=(Parameter("rpm", "rpm", 0.0, 0.0, 30.0, 0.5, at_least=0.0),),
    act=_act,
)
