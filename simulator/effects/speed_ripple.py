"""Run-out: surface speed = nominal · (1 + amplitude · sin(wheel angle + phase)), on both driving wheels.

The wheel angle is what its motor has turned since the start of the run, positive forward.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from simulator.dynamics.terms import COS_ANGLE, PATTERNS, SIN_ANGLE, SPEED, Term
from simulator.effects.definition import Effect, Parameter, Values

if TYPE_CHECKING:
    from simulator.dynamics.model import Draft


def _act(draft: Draft, values: Values) -> None:
    amplitude, phase = values["amplitude"], math.radians(values["phase_deg"])
    draft.add(
        Term(SPEED, SIN_ANGLE, amplitude * math.cos(phase), PATTERNS["driving"]),
        Term(SPEED, COS_ANGLE, amplitude * math.sin(phase), PATTERNS["driving"]),
    )


EFFECT = Effect(
    id="speed-ripple",
    name="surface speed varies within a wheel revolution",
    kind="dynamics",
    where="wheel",
    depends="time",
    pattern="common",
    parameters=(
        Parameter("amplitude", "", 0.0, 0.0, 0.3, 0.005),
        Parameter("phase_deg", "deg", 0.0, -180.0, 180.0, 10.0),
    ),
    act=_act,
)
