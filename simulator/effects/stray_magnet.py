"""A force of given size pulls the robot's centre toward a point of the plate, whatever the distance.

Within about a millimetre of the point, where its direction is undefined, the force is rounded off to 0.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from simulator.dynamics.terms import FORCE_PLATE_X, FORCE_PLATE_Y, TOWARD_X, TOWARD_Y, Term
from simulator.effects.definition import Effect, Parameter, Values

if TYPE_CHECKING:
    from simulator.dynamics.model import Draft


def _act(draft: Draft, values: Values) -> None:
    point, force = (values["x_mm"], values["y_mm"]), 1000 * values["force_mN"]
    draft.add(
        Term(FORCE_PLATE_X, TOWARD_X, force, point_mm=point),
        Term(FORCE_PLATE_Y, TOWARD_Y, force, point_mm=point),
    )


EFFECT = Effect(
    id="stray-magnet",
    name="something attracts the robot toward a point of the plate",
    kind="dynamics",
    where="plate field",
    depends="place",
    pattern="common",
    parameters=(
        Parameter("force_mN", "mN", 0.0, -3.0, 3.0, 0.02),
        Parameter("x_mm", "mm", 0.0, -100.0, 100.0, 2.0),
        Parameter("y_mm", "mm", 0.0, -100.0, 100.0, 2.0),
    ),
    act=_act,
)
