"""Both surface speeds drift over the session: factor 1 + per_run · run index, runs counted from 0, never below 1 %."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simulator.effects.definition import Effect, Parameter, Values

if TYPE_CHECKING:
    from simulator.dynamics.model import Draft


def _act(draft: Draft, values: Values) -> None:
    draft.speed_factor *= max(1 + values["per_run"] * draft.run_index, 0.01)


EFFECT = Effect(
    id="speed-drift",
    name="speed changes from run to run",
    kind="dynamics",
    where="actuator",
    depends="time",
    pattern="common",
    parameters=(Parameter("per_run", "1/run", 0.0, -0.05, 0.05, 0.0005),),
    act=_act,
)
