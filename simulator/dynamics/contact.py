"""The wheels on the plate: their state with all effects at an instant, and the resulting friction.

Units: mm, s, g, µN, rad. Contacts: see simulator.dynamics.wheel.
"""

from __future__ import annotations

import math
from typing import Any

from simulator.compilation import compiled
from simulator.dynamics.axles import turn_axles
from simulator.dynamics.bases import place_basis, slide_basis, velocity_basis
from simulator.dynamics.body import Square, Triple
from simulator.dynamics.terms import (
    COS,
    DRAG,
    FRICTION,
    FRICTION_ACROSS,
    LOAD,
    ONE,
    SLIDE_COS2,
    SPEED,
    STEER,
    STIFFNESS,
)
from simulator.dynamics.wheel import (
    AXLE_ANGLE,
    COS_STEER,
    DRAG_FORCE,
    DROOP,
    GRIP_X,
    GRIP_Y,
    SIN_STEER,
    STEEP_X,
    STEEP_Y,
    SURFACE,
    drooping_speed,
    law,
    wheel_response,
)
from simulator.slip.law import slip_ratio, wheel_force
from simulator.slip.magic_formula import VECTORS

AXLE_TOLERANCE_RAD, MOST_PASSES = 1e-8, 40  # Newton converges quadratically: only rounding is left
LEAST_FACTOR = 0.02  # a term may weaken load, friction or stiffness of a wheel to 2 %, never reverse it


@compiled(forceinline=True)
def _slide(u: float, v: float, surface: float, steer: float, driven: bool) -> tuple[float, float]:
    """Sliding velocity, body frame, of the contact of a wheel that is steered by an angle.

    u, v: velocity of its centre, body frame. A wheel that rolls freely slides along its axle only.
    """
    cos, sin = math.cos(steer), math.sin(steer)
    if driven:
        return u - cos * surface, v - sin * surface
    along_axle = cos * v - sin * u
    return -sin * along_axle, cos * along_axle


@compiled(forceinline=True)
def _update_one(
    wheel: int, u: float, v: float, r: float, drive: Any, place: Any, rest: float, model: Any, contacts: Any
) -> None:
    """Update the contact of one wheel.

    u, v: velocity of its centre in the body frame; place: of the robot, see simulator.dynamics.body.
    """
    surface = model.by_left[wheel] * drive[0] + model.by_right[wheel] * drive[1]
    side = model.side[wheel]
    driven = model.driving[wheel] != 0.0
    free, steer = surface, model.steer[wheel]
    load, friction, grain, across, stiffness, drag = 1.0, 1.0, 1.0, 1.0, 1.0, 0.0
    x, y, cos, sin, time = place
    for term in range(model.body_terms, model.body_terms + model.wheel_terms):
        value = model.pattern[term, wheel] * model.coefficient[term]
        if value == 0.0:
            continue
        channel, basis = model.channel[term], model.basis[term]
        if basis >= SLIDE_COS2:
            # without the angle of a compliant axle: as a function of the force it makes steps a hundred times as short
            slide_u, slide_v = _slide(u, v, surface, steer, driven)
            value *= slide_basis(basis, cos * slide_u - sin * slide_v, sin * slide_u + cos * slide_v, rest)
        elif basis >= COS:
            at_x = x + cos * model.wheel_x[wheel] - sin * model.wheel_y[wheel]
            at_y = y + sin * model.wheel_x[wheel] + cos * model.wheel_y[wheel]
            angle = drive[2 + side] if driven else 0.0
            point = model.point_x[term], model.point_y[term], model.falloff[term], model.point_depth
            value *= place_basis(basis, at_x, at_y, cos, sin, time, angle, point)
        elif basis != ONE:
            value *= velocity_basis(basis, u, v, r, rest)
        if channel == SPEED:
            surface += value * free
        elif channel == STEER:
            steer += value
        elif channel == LOAD:
            load += value
        elif channel == STIFFNESS:
            stiffness += value
        elif channel == DRAG:
            drag += value
        elif channel == FRICTION and basis >= SLIDE_COS2:
            grain += value  # by direction: a factor of its own, because place and direction act independently
        elif channel == FRICTION:
            friction += value
        elif channel == FRICTION_ACROSS:
            across += value
    friction = max(friction, 0.0) * max(grain, 0.0)
    load, friction, stiffness = max(load, LEAST_FACTOR), max(friction, LEAST_FACTOR), max(stiffness, LEAST_FACTOR)
    across = max(across, LEAST_FACTOR)
    steep = stiffness / friction if model.stiffness_follows_load[wheel] else stiffness / (load * friction)
    scaled = (load * friction, load * friction * across, steep, steep / across)
    steer += contacts[AXLE_ANGLE, wheel]
    cos_steer, sin_steer, wheel_u, wheel_v = 1.0, 0.0, u, v
    if steer != 0.0:
        cos_steer, sin_steer = math.cos(steer), math.sin(steer)
        wheel_u, wheel_v = cos_steer * u + sin_steer * v, cos_steer * v - sin_steer * u
    droop = model.droop[wheel] if driven and drive[side] != 0.0 else 0.0
    if droop != 0.0:
        surface = drooping_speed(wheel_u, wheel_v, surface, contacts[SURFACE, wheel], wheel, scaled, rest, model)
    contacts[SURFACE, wheel], contacts[COS_STEER, wheel], contacts[SIN_STEER, wheel] = surface, cos_steer, sin_steer
    contacts[GRIP_X, wheel], contacts[GRIP_Y, wheel], contacts[STEEP_X, wheel], contacts[STEEP_Y, wheel] = scaled
    contacts[DRAG_FORCE, wheel], contacts[DROOP, wheel] = drag, droop


@compiled(forceinline=True)  # counting references to the arrays of a call takes as long as this function
def update_contacts(
    u: float, v: float, r: float, drive: Any, place: Any, rest: float, model: Any, contacts: Any
) -> None:
    """Update all contacts for a velocity, a drive and a place."""
    if model.general == 0:
        for wheel in range(len(model.wheel_x)):
            contacts[SURFACE, wheel] = model.by_left[wheel] * drive[0] + model.by_right[wheel] * drive[1]
    else:
        _update_with_effects(u, v, r, drive, place, rest, model, contacts)


@compiled()
def _update_with_effects(
    u: float, v: float, r: float, drive: Any, place: Any, rest: float, model: Any, contacts: Any
) -> None:
    """Update all contacts where effects act on the wheels."""
    _update_all(u, v, r, drive, place, rest, model, contacts)
    if model.compliance == 0.0:
        return
    for _ in range(MOST_PASSES):
        change = turn_axles(u, v, r, place, rest, model, contacts)
        _update_all(u, v, r, drive, place, rest, model, contacts)
        if change < AXLE_TOLERANCE_RAD:
            break


@compiled()
def _update_all(u: float, v: float, r: float, drive: Any, place: Any, rest: float, model: Any, contacts: Any) -> None:
    for wheel in range(len(model.wheel_x)):
        body_u, body_v = u - r * model.wheel_y[wheel], v + r * model.wheel_x[wheel]
        _update_one(wheel, body_u, body_v, r, drive, place, rest, model, contacts)


@compiled(forceinline=True, fastmath=VECTORS)
def friction(u: float, v: float, r: float, contacts: Any, rest: float, model: Any) -> Triple:
    """Friction of all wheels on the robot: force forward, to the left, and moment."""
    if model.sliding > 0.0:
        return _sliding_friction(u, v, r, contacts, rest, model)
    along, across, moment = 0.0, 0.0, 0.0
    for wheel in range(len(model.wheel_x)):
        x, y = model.wheel_x[wheel], model.wheel_y[wheel]
        body_u, body_v = u - r * y, v + r * x
        cos, sin = contacts[COS_STEER, wheel], contacts[SIN_STEER, wheel]
        wheel_u = cos * body_u + sin * body_v
        f_x, f_y = wheel_force(
            wheel_u,
            cos * body_v - sin * body_u,
            model.driving[wheel] * slip_ratio(wheel_u, contacts[SURFACE, wheel], rest),
            model.grip_x[wheel] * contacts[GRIP_X, wheel],
            model.grip_y[wheel] * contacts[GRIP_Y, wheel],
            model.steep_x[wheel] * contacts[STEEP_X, wheel],
            model.steep_y[wheel] * contacts[STEEP_Y, wheel],
            model.ratio[wheel],
            model.shape_x[wheel],
            model.shape_y[wheel],
            model.decrease[wheel],
            rest,
        )
        f_x += contacts[DRAG_FORCE, wheel]
        force_x, force_y = cos * f_x - sin * f_y, sin * f_x + cos * f_y
        along += force_x
        across += force_y
        moment += x * force_y - y * force_x
    return along, across, moment


@compiled(forceinline=True, fastmath=VECTORS)
def _sliding_friction(u: float, v: float, r: float, contacts: Any, rest: float, model: Any) -> Triple:
    """Result of friction where the share model.sliding of it opposes the sliding velocity of each wheel."""
    along, across, moment = 0.0, 0.0, 0.0
    for wheel in range(len(model.wheel_x)):
        x, y = model.wheel_x[wheel], model.wheel_y[wheel]
        body_u, body_v = u - r * y, v + r * x
        cos, sin = contacts[COS_STEER, wheel], contacts[SIN_STEER, wheel]
        f_x, f_y = law(cos * body_u + sin * body_v, cos * body_v - sin * body_u, wheel, contacts, rest, model)
        f_x += contacts[DRAG_FORCE, wheel]
        force_x, force_y = cos * f_x - sin * f_y, sin * f_x + cos * f_y
        along += force_x
        across += force_y
        moment += x * force_y - y * force_x
    return along, across, moment


@compiled(forceinline=True, fastmath=VECTORS)
def friction_slopes(u: float, v: float, r: float, contacts: Any, rest: float, model: Any) -> tuple[Triple, Square]:
    """Friction of all wheels and its derivatives by u, v and r; contacts are constant, but surface speeds droop."""
    along, across, moment = 0.0, 0.0, 0.0
    along_u, along_v, along_r, across_u, across_v, across_r = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    moment_u, moment_v, moment_r = 0.0, 0.0, 0.0
    for wheel in range(len(model.wheel_x)):
        x, y = model.wheel_x[wheel], model.wheel_y[wheel]
        force_x, force_y, x_u, x_v, y_u, y_v, _, _ = wheel_response(wheel, u, v, r, contacts, rest, model)
        turn_u, turn_v = x * y_u - y * x_u, x * y_v - y * x_v
        along, across, moment = along + force_x, across + force_y, moment + x * force_y - y * force_x
        along_u, along_v, along_r = along_u + x_u, along_v + x_v, along_r + x * x_v - y * x_u
        across_u, across_v, across_r = across_u + y_u, across_v + y_v, across_r + x * y_v - y * y_u
        moment_u, moment_v, moment_r = moment_u + turn_u, moment_v + turn_v, moment_r + x * turn_v - y * turn_u
    return (along, across, moment), (
        (along_u, across_u, moment_u),
        (along_v, across_v, moment_v),
        (along_r, across_r, moment_r),
    )
