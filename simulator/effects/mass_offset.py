"""A centre of gravity away from the middle of the wheels."""

from __future__ import annotations

from simulator.effects.definition import Effect, Values
from simulator.effects.draft import Draft
from simulator.effects.parameter import Parameter


def _act(draft: Draft, values: Values) -> None:
    x, y = draft.gravity_mm
    draft.gravity_mm = (x + values["x_mm"], y + values["y_mm"])


EFFECT = Effect(
    id="mass-offset",
    name="the centre of gravity is off the middle",
    sentence="The centre of gravity is (x_mm, y_mm) away from where it is stated; weight and inertia act there.",
    law="weight of one of four wheels at (±L/2, ±B/2) = m·g/4 · (1 ± 2·x_mm/L)(1 ± 2·y_mm/B), L: wheelbase, B: track; "
    "of other layouts by statics (simulator.dynamics.statics); yaw inertia about the robot's centre = I + "
    "m·(x_mm² + y_mm²)",
    source="lever rule and parallel-axis theorem (Meriam & Kraige, Engineering Mechanics)",
    limits="Four wheels are statically indeterminate: the load is taken to be shared between left and right in equal "
    "ratio on both axles. More wheels, or wheels in another layout, are modelled as equally stiff supports of a rigid "
    "body. The stated yaw inertia is about the centre of gravity, wherever it is. The model is plane: load transfer by "
    "acceleration is left out.",
    kind="dynamics",
    parameters=(
        Parameter("x_mm", "mm", 0.0, 0.05, -1.9, 1.9, shown=-1.5),
        Parameter("y_mm", "mm", 0.0, 0.05, -1.9, 1.9, shown=1.5),
    ),
    act=_act,
)
