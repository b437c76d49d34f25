"""Dead time, then a first-order lag of both motors: rpm' = (commanded rpm(t - dead time) - rpm)/time constant."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simulator.effects.definition import Effect, Parameter, Values

if TYPE_CHECKING:
    from simulator.dynamics.model import Draft


def _act(draft: Draft, values: Values) -> None:
    draft.dead_time_s += values["dead_time_s"]
    draft.lag_s += values["time_constant_s"]


EFFECT = Effect(
    id="command-lag",
    name="the motors follow commands late",
    kind="command",
    where="command",
    depends="time",
    pattern="common",
    parameters=(
        Parameter("dead_time_s", "s", 0.0, 0.0, 0.5, 0.005, at_least=0.0),
        Parameter("time_constant_s", "s", 0.0, 0.0, 1.0, 0.005, at_least=0.0),
    ),
    act=_act,
)
