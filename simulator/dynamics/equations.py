"""Forces on the robot and the derivative of its velocity: Eqs. (1) and (2) in the plane, in the body frame.

Units: mm, s, g, µN = g·mm/s², rad. The velocity is (u, v, r): forward, to the left, yaw rate of the robot's centre.
drive: state of the motors, rpm of the left and right wheels and the angles they have turned, rad. place: x, y, cosine
and sine of the heading, and time. rest: smoothing width of friction at rest, mm/s. contacts: work array, see
simulator.dynamics.wheel.
"""

from __future__ import annotations

from typing import Any

from simulator.compilation import compiled
from simulator.dynamics.axles import axle_slopes
from simulator.dynamics.body import VELOCITY_STEP, Triple, loads, loads_slopes
from simulator.dynamics.contact import friction, friction_slopes, update_contacts


@compiled(forceinline=True)
def forces(u: float, v: float, r: float, drive: Any, place: Any, rest: float, model: Any, contacts: Any) -> Triple:
    """Forces and moment on the robot, the inertia of the turning frame among them."""
    update_contacts(u, v, r, drive, place, rest, model, contacts)
    along, across, moment = friction(u, v, r, contacts, rest, model)
    more = loads(u, v, r, place, rest, model)
    return along + more[0], across + more[1], moment + more[2]


@compiled(forceinline=True)
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
    if model.wheels_vary_with_velocity == 1:
        _differenced(u, v, r, drive, place, rest, model, contacts, out)
        return
    update_contacts(u, v, r, drive, place, rest, model, contacts)
    more, more_by = loads_slopes(u, v, r, place, rest, model)
    if model.compliance == 0.0:
        total, by = friction_slopes(u, v, r, contacts, rest, model)
    else:
        total, by = axle_slopes(u, v, r, more, more_by, contacts, rest, model)
    out[0, 0], out[0, 1], out[0, 2] = accelerated(total[0] + more[0], total[1] + more[1], total[2] + more[2], model)
    for column in range(3):
        here, there = by[column], more_by[column]
        at = accelerated(here[0] + there[0], here[1] + there[1], here[2] + there[2], model)
        out[1, column], out[2, column], out[3, column] = at


@compiled()
def _differenced(
    u: float, v: float, r: float, drive: Any, place: Any, rest: float, model: Any, contacts: Any, out: Any
) -> None:
    """Accelerations and their derivatives by differences, where terms on the wheels depend on the velocity."""
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
