"""Something that attracts the robot toward a point of the plate."""

from __future__ import annotations

import math

from simulator.dynamics.terms import FORCE_PLATE_X, FORCE_PLATE_Y, TOWARD_X, TOWARD_Y, UN_PER_MN, Term
from simulator.effects.coordinates import Candidate, Coordinate, Parameters, Scene, coordinate
from simulator.effects.definition import Effect, Values
from simulator.effects.draft import Draft
from simulator.effects.parameter import Parameter

FORCE = Parameter("force_mN", "mN", 0.0, 0.05, 0.0, 20.0, shown=1.0)
EXPONENT = Parameter("exponent", "", 2.0, 0.2, 0.0, 6.0, shown=2.0, closed=True)
PLACE = (Parameter("x_mm", "mm", 0.0, 0.5, shown=8.0), Parameter("y_mm", "mm", 0.0, 0.5, shown=3.0))
REFERENCE_MM = 10.0  # distance at which the force is stated
EXPONENTS, NEARLY = (1.0, 2.0, 3.0, 4.0), 0.2  # of laws to try, and difference of logarithms that fits bridge anyway
FARTHEST_REACHES = 4.0  # the force of a point farther away is nearly uniform: that is the effect plate-tilt


def _act(draft: Draft, values: Values) -> None:
    point, force = (values["x_mm"], values["y_mm"]), UN_PER_MN * values["force_mN"]
    draft.add(
        Term(FORCE_PLATE_X, TOWARD_X, force, point_mm=point, falloff=values["exponent"]),
        Term(FORCE_PLATE_Y, TOWARD_Y, force, point_mm=point, falloff=values["exponent"]),
    )


def _fitted(scene: Scene) -> Candidate:
    """The parameters, with sixteen initial positions in and around the area of the runs.

    At zero force the response does not depend on the position, so that linearization there cannot find it.
    """
    far = FARTHEST_REACHES * scene.reach_mm
    place = tuple(
        Coordinate(item.name, item.absent, item.sized(scene.size).step, -far, far, closed=True) for item in PLACE
    )
    coordinates = (coordinate(FORCE.sized(scene.size)), *place, coordinate(EXPONENT))

    def physical(values: tuple[float, ...]) -> Parameters:
        return {item.name: float(value) for item, value in zip(coordinates, values, strict=True)}

    starts = tuple(
        (0.0, radius * math.cos(angle), radius * math.sin(angle), EXPONENT.absent)
        for radius in (0.5 * scene.reach_mm, 1.2 * scene.reach_mm)
        for angle in (number * math.pi / 4 for number in range(8))
    )
    return Candidate("stray-magnet", coordinates, physical, starts, alike=_alike)


def _alike(values: tuple[float, ...]) -> tuple[tuple[float, ...], ...]:
    """Magnets with other exponents whose force and gradient are the same in the middle of the plate.

    A force that falls off as d^-n changes there by n/d: a steeper one farther away acts as a flatter one nearby. Of a
    magnet of 0.4 mN at 17 mm (n = 2), a fit ended at 26 mm (n = 4.5), 40 below its best evidence.
    """
    force, x, y, exponent = values
    distance = math.hypot(x, y)
    if not force or not distance or not exponent:
        return ()
    here = force * (REFERENCE_MM / distance) ** exponent
    found = []
    for other in EXPONENTS:
        share = other / exponent
        if abs(math.log(share)) > NEARLY:
            found.append((here * (share * distance / REFERENCE_MM) ** other, share * x, share * y, other))
    return tuple(found)


EFFECT = Effect(
    id="stray-magnet",
    name="something attracts the robot toward a point of the plate",
    sentence="The robot's centre is attracted toward the point (x_mm, y_mm) of the plate, with force_mN at a distance "
    "of 10 mm, and falling off with distance by the exponent (2 where it is not given).",
    law="F = force_mN · (10 mm/d)^exponent · e/d, e: from the robot's centre to the point, d = √(|e|² + (2 mm)²)",
    source="field of a magnet that is small beside its distance (Jackson, Classical Electrodynamics): the force "
    "between two poles goes with 1/d², between a pole and a dipole with 1/d³, between two dipoles with 1/d⁴",
    limits="One force at the centre. Its gradient over the robot, and so its moment, is left out, and also its share "
    "in the loads of the wheels. The point lies 2 mm below the robot, whatever the robot's size, so that nearer than "
    "about 2 mm the force decreases smoothly to 0. Force and exponent are hard to distinguish if all runs keep one "
    "distance from the point, and the effect is hard to distinguish from plate-tilt if the point is farther away than "
    "the robot moves.",
    kind="dynamics",
    of_plate=True,
    parameters=(FORCE, *PLACE, EXPONENT),
    act=_act,
    fitted=_fitted,
)
