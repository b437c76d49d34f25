"""Motors that slow down under load."""

from __future__ import annotations

from simulator.effects.definition import Effect, Values
from simulator.effects.draft import Draft
from simulator.effects.parameter import Parameter


def _act(draft: Draft, values: Values) -> None:
    draft.droop_rpm_per_uN_mm += values["rpm_per_uN_mm"]


EFFECT = Effect(
    id="motor-droop",
    name="the motors slow down under load",
    sentence="A motor turns slower than commanded by rpm_per_uN_mm times its load torque, and faster where the load "
    "drives it.",
    law="n = n_commanded − rpm_per_uN_mm · F_x·r, with the force F_x that friction gives the wheel at the speed n",
    source="speed–torque line of a DC motor at constant voltage (Fitzgerald, Kingsley & Umans, Electric Machinery)",
    limits="The straight part of the line: no stall, no heating. The load is the friction of the wheel alone; losses "
    "in bearings and gears are taken to be included in the commanded speed. A motor that is off is held by its gear.",
    kind="dynamics",
    parameters=(Parameter("rpm_per_uN_mm", "rpm/(µN·mm)", 0.0, 2e-4, 0.0, 0.1, at_least=0.0),),
    act=_act,
)
