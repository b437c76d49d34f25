"""Forces on the robot and the derivative of its velocity: Eqs. (1) and (2) in the plane, in the body frame.

Units: mm, s, g, µN = g·mm/s², rad. The velocity is (u, v, r): forward, to the left, yaw rate of the robot's centre.
A drive is what the motors do at an instant: rpm of the left and right wheel, and the angles they have turned, rad.
A place is x, y, cosine and sine of the heading, and the time. rest: width of the rounding at rest,
mm/s; contacts: scratch, see simulator.contact.
"""

from __future__ import annotations

from typing import Any

from simulator.body import Triple, body_forces
from simulator.compiled import compiled
from simulator.contact import friction, friction_slopes, touch

# Differences for derivatives: rounding over step, and step over curvature, stay below 1e-5 of the derivative.
VELOCITY_STEP = 3e-10  # mm/s, rad/s; far below the rest speed, where forces bend most


@compiled(inline="always")
def forces(u: float, v: float, r: float, drive: Any, place: Any, rest: float, model: Any, contacts: Any) -> Triple:
    """Forces and moment on the robot, the inertia of the turning frame among them."""
    touch(u, v, r, drive, place, rest, model, contacts)
    along, across, moment = friction(u, v, r, contacts, rest, model)
    if model.body_terms > 0:
        added = body_forces(u, v, r, place, rest, model)
        along, across, moment = along + added[0], across + added[1], moment + added[2]
    mass, ahead, aside = model.mass, model.gravity_x, model.gravity_y
    along += mass * r * (v + r * ahead)
    across -= mass * r * (u - r * aside)
    moment -= mass * r * (ahead * u + aside * v)
    return along, across, moment


@compiled(inline="always")
def accelerated(along: float, across: float, moment: float, model: Any) -> Triple:
    """Accelerations that forces and a moment give."""
    inverse = model.inverse_mass
    return (
        inverse[0, 0] * along + inverse[0, 1] * across + inverse[0, 2] * moment,
        inverse[1, 0] * along + inverse[1, 1] * across + inverse[1, 2] * moment,
        inverse[2, 0] * along + inverse[2, 1] * across + inverse[2, 2] * moment,
    )


@compiled()
def accelerations(
    u: float, v: float, r: float, drive: Any, place: Any, rest: float, model: Any, contacts: Any
) -> Triple:
    """Rate of change of (u, v, r): forces and moment over the mass matrix."""
    along, across, moment = forces(u, v, r, drive, place, rest, model, contacts)
    return accelerated(along, across, moment, model)


@compiled()
def slopes(
    u: float, v: float, r: float, drive: Any, place: Any, rest: float, model: Any, contacts: Any, out: Any
) -> None:
    """Accelerations into out[0], their derivatives by velocity into rows out[1:4]; the first three columns."""
    if model.wheels_feel == 1:
        _differenced(u, v, r, drive, place, rest, model, contacts, out)
        return
    touch(u, v, r, drive, place, rest, model, contacts)
    total, by = friction_slopes(u, v, r, contacts, rest, model)
    mass, ahead, aside = model.mass, model.gravity_x, model.gravity_y
    along, across = total[0] + mass * r * (v + r * ahead), total[1] - mass * r * (u - r * aside)
    moment = total[2] - mass * r * (ahead * u + aside * v)
    by_u = by[0][0], by[1][0] - mass * r, by[2][0] - mass * r * ahead
    by_v = by[0][1] + mass * r, by[1][1], by[2][1] - mass * r * aside
    by_r = (
        by[0][2] + mass * (v + 2.0 * r * ahead),
        by[1][2] - mass * (u - 2.0 * r * aside),
        by[2][2] - mass * (ahead * u + aside * v),
    )
    if model.body_terms > 0:
        force = body_forces(u, v, r, place, rest, model)
        along, across, moment = along + force[0], across + force[1], moment + force[2]
        if model.body_feels == 1:
            by_u = _grown(by_u, body_forces(u + VELOCITY_STEP, v, r, place, rest, model), force)
            by_v = _grown(by_v, body_forces(u, v + VELOCITY_STEP, r, place, rest, model), force)
            by_r = _grown(by_r, body_forces(u, v, r + VELOCITY_STEP, place, rest, model), force)
    out[0, 0], out[0, 1], out[0, 2] = accelerated(along, across, moment, model)
    out[1, 0], out[2, 0], out[3, 0] = accelerated(by_u[0], by_u[1], by_u[2], model)
    out[1, 1], out[2, 1], out[3, 1] = accelerated(by_v[0], by_v[1], by_v[2], model)
    out[1, 2], out[2, 2], out[3, 2] = accelerated(by_r[0], by_r[1], by_r[2], model)


@compiled()
def _grown(slope: Triple, further: Triple, here: Triple) -> Triple:
    """A derivative and that of forces known here and a step further."""
    return (
        slope[0] + (further[0] - here[0]) / VELOCITY_STEP,
        slope[1] + (further[1] - here[1]) / VELOCITY_STEP,
        slope[2] + (further[2] - here[2]) / VELOCITY_STEP,
    )


@compiled()
def _differenced(
    u: float, v: float, r: float, drive: Any, place: Any, rest: float, model: Any, contacts: Any, out: Any
) -> None:
    """The same by differences, where what acts on the wheels depends on the velocity in more ways than slip."""
    step = VELOCITY_STEP
    held = accelerations(u, v, r, drive, place, rest, model, contacts)
    by_u = accelerations(u + step, v, r, drive, place, rest, model, contacts)
    by_v = accelerations(u, v + step, r, drive, place, rest, model, contacts)
    by_r = accelerations(u, v, r + step, drive, place, rest, model, contacts)
    for row in range(3):
        out[0, row] = held[row]
        out[1 + row, 0] = (by_u[row] - held[row]) / ((u + step) - u)
        out[1 + row, 1] = (by_v[row] - held[row]) / ((v + step) - v)
        out[1 + row, 2] = (by_r[row] - held[row]) / ((r + step) - r)
