"""Centre of gravity away from the middle of the wheels, body frame.

The weight is shared by the levers: a wheel at (+x, +y) carries (1 + 2·x/wheelbase)(1 + 2·y/track) of a quarter. The
inertia acts at the new place too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from simulator.effects.definition import Effect, Parameter, Values

if TYPE_CHECKING:
    from simulator.dynamics.model import Draft


def _act(draft: Draft, values: Values) -> None:
    x, y = draft.gravity_mm
    draft.gravity_mm = (x + values["x_mm"], y + values["y_mm"])


EFFECT = Effect(
    id="mass-offset",
    name="the centre of gravity is off the middle",
    kind="dynamics",
    where="contact",
    depends="constant",
    pattern="front-rear",
    parameters=(
        Parameter("x_mm", "mm", 0.0, -1.5, 1.5, 0.05),
        Parameter("y_mm", "mm", 0.0, -1.5, 1.5, 0.05),
    ),
    act=_act,
)
