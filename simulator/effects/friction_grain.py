"""Friction that depends on the direction over the plate."""

from __future__ import annotations

import math

from simulator.dynamics.terms import FRICTION, SLIDE_COS2, SLIDE_SIN2, Term
from simulator.effects.coordinates import polar
from simulator.effects.definition import Effect, Values
from simulator.effects.draft import Draft
from simulator.effects.parameter import Parameter

AMPLITUDE = Parameter("amplitude", "", 0.0, 0.01, 0.0, 0.9, at_least=0.0, shown=0.6)
DIRECTION = Parameter("direction_deg", "deg", 0.0, 5.0, 0.0, 180.0, period=180.0, shown=90.0)


def _act(draft: Draft, values: Values) -> None:
    amplitude, direction = values["amplitude"], math.radians(values["direction_deg"])
    draft.add(
        Term(FRICTION, SLIDE_COS2, amplitude * math.cos(2 * direction)),
        Term(FRICTION, SLIDE_SIN2, amplitude * math.sin(2 * direction)),
    )


EFFECT = Effect(
    id="friction-grain",
    name="friction depends on the direction over the plate",
    sentence="Friction is largest, by amplitude over the nominal one, where a contact slides along direction_deg of "
    "the plate, and smallest across it.",
    law="μ = μ_nominal · (1 + amplitude · cos 2(slide − direction_deg)), slide: direction in which the contact slides",
    source="orthotropic friction of a surface with grinding marks, first harmonic (Zmitrowicz 1981, Wear 73, 9)",
    limits="Friction still opposes the sliding velocity; on a real grain it turns a little toward the direction of "
    "low friction. A driven wheel rolls freely and slides along its axle only. The stiffness for small slip does not "
    "change. The angle by which a compliant axle turns does not count in the direction of sliding. Of two changes of "
    "friction by different effects, such as this one and friction-gradient, the factors are multiplied.",
    kind="dynamics",
    of_plate=True,
    parameters=(AMPLITUDE, DIRECTION),
    act=_act,
    fitted=lambda _: polar("friction-grain", AMPLITUDE, DIRECTION),
)
