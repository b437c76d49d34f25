"""Driving wheels faster or slower than commanded."""

from __future__ import annotations

from simulator.effects.definition import Effect, Values
from simulator.effects.draft import Draft
from simulator.effects.parameter import Parameter


def _act(draft: Draft, values: Values) -> None:
    draft.speed_factor *= values["factor"]


EFFECT = Effect(
    id="drive-speed-scale",
    name="both driving wheels are faster or slower than commanded",
    sentence="Both driving wheels have factor times the surface speed that their command and radius give.",
    law="v = factor · r·ω",
    source="rolling, v = r·ω, with a wrong radius or gain of the motors",
    limits="The same factor at all speeds and loads. It changes the surface speed alone: the lever of the motor's "
    "torque and the wheel's place keep the stated radius.",
    kind="dynamics",
    parameters=(Parameter("factor", "", 1.0, 0.005, 0.5, 2.0, at_least=0.01),),
    act=_act,
)
