"""Forces that act on the body, not through its wheels: what added physics pulls, pushes and turns it with.

Units: mm, s, µN, rad. A place is x, y, cosine and sine of the heading, and the time.
"""

from __future__ import annotations

from typing import Any

from simulator.bases import place_basis, velocity_basis
from simulator.compiled import compiled
from simulator.terms import COS, FORCE_FORWARD, FORCE_LEFT, FORCE_PLATE_X, MOMENT, ONE

Triple = tuple[float, float, float]


@compiled()
def body_forces(u: float, v: float, r: float, place: Any, rest: float, model: Any) -> Triple:
    """Forces and moments that act on the body: forward, to the left, about the vertical."""
    along, across, moment = 0.0, 0.0, 0.0
    x, y, cos, sin, time = place
    for term in range(model.body_terms):
        channel, basis, value = model.channel[term], model.basis[term], model.coefficient[term]
        if basis >= COS:
            value *= place_basis(basis, x, y, cos, sin, time, 0.0, model.point_x[term], model.point_y[term])
        elif basis != ONE:
            value *= velocity_basis(basis, u, v, r, rest)
        if channel == FORCE_FORWARD:
            along += value
        elif channel == FORCE_LEFT:
            across += value
        elif channel == MOMENT:
            moment += value
        elif channel == FORCE_PLATE_X:
            along += cos * value
            across -= sin * value
        else:
            along += sin * value
            across += cos * value
    return along, across, moment
