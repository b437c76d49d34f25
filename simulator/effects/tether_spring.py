"""A spring without slack pulls the robot's centre toward an anchor of the plate: stiffness · (anchor - centre)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simulator.dynamics.terms import FORCE_PLATE_X, FORCE_PLATE_Y, ONE, Term, X, Y
from simulator.effects.definition import Effect, Parameter, Values

if TYPE_CHECKING:
    from simulator.dynamics.model import Draft


def _act(draft: Draft, values: Values) -> None:
    stiffness = 1000 * values["stiffness_mN_mm"]
    draft.add(
        Term(FORCE_PLATE_X, ONE, stiffness * values["anchor_x_mm"]),
        Term(FORCE_PLATE_X, X, -stiffness),
        Term(FORCE_PLATE_Y, ONE, stiffness * values["anchor_y_mm"]),
        Term(FORCE_PLATE_Y, Y, -stiffness),
    )


EFFECT = Effect(
    id="tether-spring",
    name="a wire pulls toward a fixed anchor",
    kind="dynamics",
    where="plate field",
    depends="place",
    pattern="common",
    parameters=(
        Parameter("stiffness_mN_mm", "mN/mm", 0.0, 0.0, 0.5, 0.002, at_least=0.0),
        Parameter("anchor_x_mm", "mm", 0.0, -100.0, 100.0, 2.0),
        Parameter("anchor_y_mm", "mm", 0.0, -100.0, 100.0, 2.0),
    ),
    act=_act,
)
