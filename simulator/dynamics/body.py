"""Forces and moments of effects on the body, apart from its wheels, and inertia.

Units: mm, s, µN, rad. place: x, y, cosine and sine of the heading, and time.
"""

from __future__ import annotations

from typing import Any

from simulator.compilation import compiled
from simulator.dynamics.bases import place_basis, velocity_basis
from simulator.dynamics.terms import COS, FORCE_FORWARD, FORCE_LEFT, FORCE_PLATE_X, MOMENT, ONE

Triple = tuple[float, float, float]
Square = tuple[Triple, Triple, Triple]
# Differences for derivatives: rounding over step, and step over curvature, stay below 1e-5 of the derivative.
VELOCITY_STEP = 3e-10  # mm/s, rad/s; far below the rest speed, where forces are most curved


@compiled()
def body_forces(u: float, v: float, r: float, place: Any, rest: float, model: Any) -> Triple:
    """Forces and moments that act on the body: forward, to the left, about the vertical."""
    along, across, moment = 0.0, 0.0, 0.0
    x, y, cos, sin, time = place
    for term in range(model.body_terms):
        channel, basis, value = model.channel[term], model.basis[term], model.coefficient[term]
        if basis >= COS:
            point = model.point_x[term], model.point_y[term], model.falloff[term], model.point_depth
            value *= place_basis(basis, x, y, cos, sin, time, 0.0, point)
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


@compiled(forceinline=True)
def loads(u: float, v: float, r: float, place: Any, rest: float, model: Any) -> Triple:
    """Forces of body terms and inertial forces of the rotating frame, which wheel friction has to balance."""
    along, across, moment = 0.0, 0.0, 0.0
    if model.body_terms > 0:
        along, across, moment = body_forces(u, v, r, place, rest, model)
    mass, gravity_x, gravity_y = model.mass, model.gravity_x, model.gravity_y
    return (
        along + mass * r * (v + r * gravity_x),
        across - mass * r * (u - r * gravity_y),
        moment - mass * r * (gravity_x * u + gravity_y * v),
    )


@compiled(forceinline=True)
def loads_slopes(u: float, v: float, r: float, place: Any, rest: float, model: Any) -> tuple[Triple, Square]:
    """Result of loads, and its derivatives by u, v and r."""
    here, mass, gravity_x, gravity_y = loads(u, v, r, place, rest, model), model.mass, model.gravity_x, model.gravity_y
    if model.body_varies_with_velocity == 1:
        return here, (
            _grown(here, loads(u + VELOCITY_STEP, v, r, place, rest, model)),
            _grown(here, loads(u, v + VELOCITY_STEP, r, place, rest, model)),
            _grown(here, loads(u, v, r + VELOCITY_STEP, place, rest, model)),
        )
    return here, (
        (0.0, -mass * r, -mass * r * gravity_x),
        (mass * r, 0.0, -mass * r * gravity_y),
        (mass * (v + 2.0 * r * gravity_x), -mass * (u - 2.0 * r * gravity_y), -mass * (gravity_x * u + gravity_y * v)),
    )


@compiled()
def _grown(here: Triple, further: Triple) -> Triple:
    """Forward difference of forces over VELOCITY_STEP."""
    return (
        (further[0] - here[0]) / VELOCITY_STEP,
        (further[1] - here[1]) / VELOCITY_STEP,
        (further[2] - here[2]) / VELOCITY_STEP,
    )
