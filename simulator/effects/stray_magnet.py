"""Something that attracts the robot toward a point of the plate."""

from __future__ import annotations

import math

from simulator.dynamics.terms import FORCE_PLATE_X, FORCE_PLATE_Y, TOWARD_X, TOWARD_Y, UN_PER_MN, Term
from simulator.effects.coordinates import Candidate, Coordinate, Parameters, Scene
from simulator.effects.definition import Effect, Values
from simulator.effects.draft import Draft
from simulator.effects.parameter import Parameter

FORCE = Parameter("force_mN", "mN", 0.0, 0.05, 0.0, 20.0, shown=5.0)
PLACE = (Parameter("x_mm", "mm", 0.0, 0.5, shown=10.0), Parameter("y_mm", "mm", 0.0, 0.5, shown=5.0))
FARTHEST_REACHES = 4.0  # a point farther away pulls like a slope: that is plate-tilt's to say


def _act(draft: Draft, values: Values) -> None:
    point, force = (values["x_mm"], values["y_mm"]), UN_PER_MN * values["force_mN"]
    draft.add(
        Term(FORCE_PLATE_X, TOWARD_X, force, point_mm=point),
        Term(FORCE_PLATE_Y, TOWARD_Y, force, point_mm=point),
    )


def _fitted(scene: Scene) -> Candidate:
    """The parameters, from sixteen places in and around the area that the runs cover: without a force, none is felt."""
    far = FARTHEST_REACHES * scene.reach_mm
    force = Coordinate(FORCE.name, FORCE.absent, FORCE.step, FORCE.low, FORCE.high)
    place = tuple(Coordinate(item.name, item.absent, item.step, -far, far) for item in PLACE)

    def physical(values: tuple[float, ...]) -> Parameters:
        return dict(zip(("force_mN", "x_mm", "y_mm"), map(float, values), strict=True))

    starts = tuple(
        (0.0, share * scene.reach_mm * math.cos(angle), share * scene.reach_mm * math.sin(angle))
        for share in (0.5, 1.2)
        for angle in (number * math.pi / 4 for number in range(8))
    )
    return Candidate("stray-magnet", (force, *place), physical, starts)


EFFECT = Effect(
    id="stray-magnet",
    name="something attracts the robot toward a point of the plate",
    sentence="A force of given size pulls the robot's centre toward the point (x_mm, y_mm) of the plate, whatever the "
    "distance.",
    law="F = force_mN · d/√(|d|² + 1 mm²), d: from the robot's centre to the point",
    source="none: a real magnet's pull falls off with distance",
    limits="Within about a millimetre of the point, where its direction is undefined, the force is rounded off to 0.",
    kind="dynamics",
    parameters=(FORCE, *PLACE),
    act=_act,
    fitted=_fitted,
)
