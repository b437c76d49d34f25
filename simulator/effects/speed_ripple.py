"""Surface speed that varies within a wheel revolution."""

from __future__ import annotations

import math

from simulator.dynamics.terms import COS_ANGLE, SIN_ANGLE, SPEED, Term
from simulator.effects.coordinates import polar
from simulator.effects.definition import Effect, Values
from simulator.effects.draft import Draft
from simulator.effects.parameter import Parameter

AMPLITUDE = Parameter("amplitude", "", 0.0, 0.01, 0.0, 0.5, shown=0.3)
PHASE = Parameter("phase_deg", "deg", 0.0, 10.0, 0.0, 360.0, period=360.0, shown=90.0)


def _act(draft: Draft, values: Values) -> None:
    amplitude, phase = values["amplitude"], math.radians(values["phase_deg"])
    draft.add(
        Term(SPEED, SIN_ANGLE, amplitude * math.cos(phase), "driving"),
        Term(SPEED, COS_ANGLE, amplitude * math.sin(phase), "driving"),
    )


EFFECT = Effect(
    id="speed-ripple",
    name="surface speed varies within a wheel revolution",
    sentence="The surface speed of each driving wheel varies by amplitude within its revolution, from phase_deg at the "
    "beginning of the run.",
    law="v = (1 + amplitude · sin(θ + phase_deg)) · r·ω, θ: angle that the wheel has turned since the run began",
    source="run-out: a wheel of radius r mounted off its centre by e has the rolling radius r + e·sin θ, so that "
    "amplitude = e/r",
    limits="Both wheels have one amplitude and begin at one phase; the rise and fall of the axle is left out.",
    kind="dynamics",
    parameters=(AMPLITUDE, PHASE),
    act=_act,
    fitted=lambda _: polar("speed-ripple", AMPLITUDE, PHASE),
)
