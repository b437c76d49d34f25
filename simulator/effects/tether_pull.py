"""A wire pulls at the robot's centre with a force fixed in the body frame: x forward, y to the left."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simulator.dynamics.terms import FORCE_FORWARD, FORCE_LEFT, ONE, Term
from simulator.effects.definition import Effect, Parameter, Values

if TYPE_CHECKING:
    from simulator.dynamics.model import Draft


def _act(draft: Draft, values: Values) -> None:
    draft.add(
        Term(FORCE_FORWARD, ONE, 1000 * values["x_mN"]),
        Term(FORCE_LEFT, ONE, 1000 * values["y_mN"]),
    )


EFFECT = Effect(
    id="tether-pull",
    name="a wire pulls with a force fixed in the body",
    kind="dynamics",
    where="body force",
    depends="constant",
    pattern="common",
    parameters=(
        Parameter("x_mN", "mN", 0.0, -3.0, 3.0, 0.02),
        Parameter("y_mN", "mN", 0.0, -3.0, 3.0, 0.02),
    ),
    act=_act,
)
