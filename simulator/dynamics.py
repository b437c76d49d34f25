"""Forces on the robot and the derivative of its velocity: Eqs. (1) and (2) in the plane, in the body frame.

Units: mm, s, g, µN = g·mm/s², rad. The velocity is (u, v, r): forward, to the left, yaw rate of the robot's centre.
A drive is what the motors do at an instant: rpm of the left and right wheel, and the angles they have turned, rad.
A place is x, y, cosine and sine of the heading, and the time. rest: width of the rounding at rest, mm/s.
"""

from __future__ import annotations

from typing import Any

from simulator.bases import place_basis, velocity_basis
from simulator.compiled import compiled
from simulator.contact import contact, contact_force, contact_slopes
from simulator.terms import COS, FORCE_FORWARD, FORCE_LEFT, FORCE_PLATE_X, MOMENT, ONE

Triple = tuple[float, float, float]
# Differences for derivatives: rounding over step, and step over curvature, stay below 1e-5 of the derivative.
VELOCITY_STEP = 3e-10  # mm/s, rad/s; far below the rest speed, where forces bend most


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


@compiled()
def forces(u: float, v: float, r: float, drive: Any, place: Any, rest: float, model: Any) -> Triple:
    """Forces and moment on the robot, the inertia of the turning frame among them."""
    along, across, moment = 0.0, 0.0, 0.0
    if model.body_terms > 0:
        along, across, moment = body_forces(u, v, r, place, rest, model)
    for wheel in range(4):
        x, y = model.wheel_x[wheel], model.wheel_y[wheel]
        wheel_u, wheel_v = u - r * y, v + r * x
        touch = contact(wheel, wheel_u, wheel_v, r, drive, place, rest, model)
        force = contact_force(wheel, wheel_u, wheel_v, touch, rest, model)
        along += force[0]
        across += force[1]
        moment += x * force[1] - y * force[0]
    mass, ahead, aside = model.mass, model.gravity_x, model.gravity_y
    along += mass * r * (v + r * ahead)
    across -= mass * r * (u - r * aside)
    moment -= mass * r * (ahead * u + aside * v)
    return along, across, moment


@compiled()
def accelerations(u: float, v: float, r: float, drive: Any, place: Any, rest: float, model: Any) -> Triple:
    """Rate of change of (u, v, r): forces and moment over the mass matrix."""
    along, across, moment = forces(u, v, r, drive, place, rest, model)
    return accelerated(along, across, moment, model)


@compiled()
def accelerated(along: float, across: float, moment: float, model: Any) -> Triple:
    """Accelerations that forces and a moment give."""
    inverse = model.inverse_mass
    return (
        inverse[0, 0] * along + inverse[0, 1] * across + inverse[0, 2] * moment,
        inverse[1, 0] * along + inverse[1, 1] * across + inverse[1, 2] * moment,
        inverse[2, 0] * along + inverse[2, 1] * across + inverse[2, 2] * moment,
    )


@compiled()
def slopes(u: float, v: float, r: float, drive: Any, place: Any, rest: float, model: Any, out: Any) -> None:
    """Accelerations into out[0], their derivatives by velocity into rows out[1:4]; the first three columns."""
    if model.wheels_feel == 1:
        _differenced(u, v, r, drive, place, rest, model, out)
        return
    force = 0.0, 0.0, 0.0
    mass, ahead, aside = model.mass, model.gravity_x, model.gravity_y
    along, across, moment = mass * r * (v + r * ahead), -mass * r * (u - r * aside), -mass * r * (ahead * u + aside * v)
    along_u, along_v, along_r = 0.0, mass * r, mass * (v + 2.0 * r * ahead)
    across_u, across_v, across_r = -mass * r, 0.0, -mass * (u - 2.0 * r * aside)
    moment_u, moment_v, moment_r = -mass * r * ahead, -mass * r * aside, -mass * (ahead * u + aside * v)
    for wheel in range(4):
        x, y = model.wheel_x[wheel], model.wheel_y[wheel]
        wheel_u, wheel_v = u - r * y, v + r * x
        touch = contact(wheel, wheel_u, wheel_v, r, drive, place, rest, model)
        force_x, force_y, x_u, x_v, y_u, y_v = contact_slopes(wheel, wheel_u, wheel_v, touch, rest, model)
        turn_u, turn_v = x * y_u - y * x_u, x * y_v - y * x_v
        along, across, moment = along + force_x, across + force_y, moment + x * force_y - y * force_x
        along_u, along_v, along_r = along_u + x_u, along_v + x_v, along_r + x * x_v - y * x_u
        across_u, across_v, across_r = across_u + y_u, across_v + y_v, across_r + x * y_v - y * y_u
        moment_u, moment_v, moment_r = moment_u + turn_u, moment_v + turn_v, moment_r + x * turn_v - y * turn_u
    if model.body_terms > 0:
        force = body_forces(u, v, r, place, rest, model)
        along, across, moment = along + force[0], across + force[1], moment + force[2]
    if model.body_feels == 1:
        step = VELOCITY_STEP
        by_u = body_forces(u + step, v, r, place, rest, model)
        by_v = body_forces(u, v + step, r, place, rest, model)
        by_r = body_forces(u, v, r + step, place, rest, model)
        along_u, along_v = along_u + (by_u[0] - force[0]) / step, along_v + (by_v[0] - force[0]) / step
        across_u, across_v = across_u + (by_u[1] - force[1]) / step, across_v + (by_v[1] - force[1]) / step
        moment_u, moment_v = moment_u + (by_u[2] - force[2]) / step, moment_v + (by_v[2] - force[2]) / step
        along_r, across_r = along_r + (by_r[0] - force[0]) / step, across_r + (by_r[1] - force[1]) / step
        moment_r += (by_r[2] - force[2]) / step
    out[0, 0], out[0, 1], out[0, 2] = accelerated(along, across, moment, model)
    out[1, 0], out[2, 0], out[3, 0] = accelerated(along_u, across_u, moment_u, model)
    out[1, 1], out[2, 1], out[3, 1] = accelerated(along_v, across_v, moment_v, model)
    out[1, 2], out[2, 2], out[3, 2] = accelerated(along_r, across_r, moment_r, model)


@compiled()
def _differenced(u: float, v: float, r: float, drive: Any, place: Any, rest: float, model: Any, out: Any) -> None:
    """The same by differences, where what acts on the wheels depends on the velocity in more ways than slip."""
    step = VELOCITY_STEP
    held = accelerations(u, v, r, drive, place, rest, model)
    by_u = accelerations(u + step, v, r, drive, place, rest, model)
    by_v = accelerations(u, v + step, r, drive, place, rest, model)
    by_r = accelerations(u, v, r + step, drive, place, rest, model)
    for row in range(3):
        out[0, row] = held[row]
        out[1 + row, 0] = (by_u[row] - held[row]) / ((u + step) - u)
        out[1 + row, 1] = (by_v[row] - held[row]) / ((v + step) - v)
        out[1 + row, 2] = (by_r[row] - held[row]) / ((r + step) - r)
