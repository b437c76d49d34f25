"""Friction higher or lower than stated."""

from __future__ import annotations

import math

from simulator.effects.coordinates import Candidate, Coordinate, Parameters, Scene, plain
from simulator.effects.definition import Effect, Values
from simulator.effects.draft import Draft
from simulator.effects.parameter import Parameter

FACTOR = Parameter("factor", "", 1.0, 0.01, 0.2, 5.0, at_least=0.01, shown=3.0)
# Friction of tyres: sliding on ice, and peak on dry asphalt (Wong 2008, Theory of Ground Vehicles, Table 1.3). A robot
# file may state one surface and the robot drive on the other.
ICE, ASPHALT = 0.07, 0.9
# With friction beyond the usual range a robot accelerates as slowly as with motors that follow late, which is common in
# robots of a metre: so little friction is accepted together with this effect only, not instead of it.
LATE = "command-lag"
# Initial factors of a fit to a robot of a metre: the level of friction has no effect until wheels spin.
BEGUN = (1.0, 0.5, 0.25, 0.125)


def _act(draft: Draft, values: Values) -> None:
    draft.friction_factor *= values["factor"]


def _fitted(scene: Scene) -> Candidate:
    """The factor itself on a plate; its logarithm on ground, where it may be wrong by several times."""
    if not scene.size.on_ground:
        return plain("friction-level", (FACTOR,))

    def physical(values: tuple[float, ...]) -> Parameters:
        return {"factor": math.exp(values[0])}

    most = math.log(ASPHALT / ICE)
    starts = tuple((math.log(factor),) for factor in BEGUN)
    size = Coordinate("log_factor", 0.0, FACTOR.step, -most, most)
    usual = math.log(FACTOR.low), math.log(FACTOR.high)
    return Candidate("friction-level", (size,), physical, starts, usual=usual, beside=LATE)


EFFECT = Effect(
    id="friction-level",
    name="friction is higher or lower than stated",
    sentence="Both friction coefficients of all wheels are factor times the stated ones; the stiffness for small slip "
    "stays.",
    law="μ_x = factor · μ_x,nominal and μ_y = factor · μ_y,nominal",
    source="Coulomb's friction: the limit of the force is the coefficient times the load",
    limits="One factor for all wheels, directions and slips: the shape of the slip curve does not change.",
    kind="dynamics",
    parameters=(FACTOR,),
    act=_act,
    fitted=_fitted,
)
