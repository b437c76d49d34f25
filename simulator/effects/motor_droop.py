"""Rotation falls with load torque: rpm = commanded rpm - rpm_per_uN_mm · (force along the wheel · wheel radius).

The force is what friction gives the wheel at the speed that results, so that the two are solved together. A wheel that
the other one drags along runs faster than commanded. A motor that is off is held by its gear.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from simulator.effects.definition import Effect, Parameter, Values

if TYPE_CHECKING:
    from simulator.dynamics.model import Draft


def _act(draft: Draft, values: Values) -> None:
    draft.droop_rpm_per_uN_mm += values["rpm_per_uN_mm"]


EFFECT = Effect(
    id="motor-droop",
    name="the motors slow down under load",
    kind="dynamics",
    where="actuator",
    depends="v",
    pattern="common",
    parameters=(Parameter("rpm_per_uN_mm", "rpm/(µN·mm)", 0.0, 0.0, 0.01, 1e-05, at_least=0.0),),
    act=_act,
)
