"""The wheels on the plate: what added physics leaves of each at an instant, and the friction that follows.

Units: mm, s, g, µN, rad. Contacts are an array (ROWS, 4): rows SURFACE (speed, mm/s), COS_STEER and SIN_STEER, GRIP
and STEEP (factors of a wheel's grip and steepness, along X and across Y), DRAG (µN), DROOP (loss of surface speed per
µN), GIVEN (angle by which its axle has given way, rad); a column per wheel.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from simulator.bases import place_basis, slide_basis, velocity_basis
from simulator.body import Triple, body_forces
from simulator.compiled import compiled
from simulator.slip.law import VECTORS, slip_ratio, wheel_force, wheel_slopes
from simulator.terms import COS, DRAG, FRICTION, FRICTION_ACROSS, LOAD, ONE, SLIDE_COS2, SPEED, STEER, STIFFNESS

SURFACE, COS_STEER, SIN_STEER, GRIP_X, GRIP_Y, STEEP_X, STEEP_Y, DRAG_FORCE, DROOP, GIVEN, ROWS = range(11)
GRIPS = slice(GRIP_X, STEEP_Y + 1)
Square = tuple[Triple, Triple, Triple]
GIVEN_RAD, MOST_PASSES = 1e-15, 40  # derivatives are differences over steps of 3e-10
LEAST_DESCENT = 0.5  # of Newton's method, where an axle would turn into its own force
LEAST_FACTOR = 0.02  # a term may weaken load, friction or stiffness of a wheel to 2 %, never reverse it


@compiled()
def fresh_contacts() -> Any:
    """Contacts of wheels without any effect, at rest."""
    contacts = np.zeros((ROWS, 4))
    reset_contacts(contacts)
    return contacts


@compiled()
def reset_contacts(contacts: Any) -> None:
    """Contacts of wheels without any effect, at rest, into an array of zeros."""
    for wheel in range(4):
        contacts[COS_STEER, wheel] = 1.0
        for row in range(GRIP_X, STEEP_Y + 1):
            contacts[row, wheel] = 1.0


@compiled()
def law(u: float, v: float, wheel: int, contacts: Any, rest: float, model: Any) -> tuple[float, float]:
    """Friction along and across one wheel; u, v: of its centre in its own frame."""
    scaled = (contacts[GRIP_X, wheel], contacts[GRIP_Y, wheel], contacts[STEEP_X, wheel], contacts[STEEP_Y, wheel])
    slopes = law_slopes(u, v, contacts[SURFACE, wheel], wheel, scaled, rest, model)
    return slopes[0], slopes[1]


@compiled()
def law_slopes(u: float, v: float, surface: float, wheel: int, scaled: Any, rest: float, model: Any) -> Any:
    """The same friction, then its derivatives; see simulator.slip.law.wheel_slopes."""
    return wheel_slopes(
        u,
        v,
        surface,
        1.0 if wheel < 2 else 0.0,
        model.grip_x[wheel] * scaled[0],
        model.grip_y[wheel] * scaled[1],
        model.steep_x[wheel] * scaled[2],
        model.steep_y[wheel] * scaled[3],
        model.ratio,
        model.shape_x,
        model.shape_y,
        model.decrease,
        rest,
    )


@compiled()
def drooping_speed(
    u: float, v: float, free: float, guess: float, wheel: int, scaled: Any, rest: float, model: Any
) -> float:
    """Surface speed of a motor that yields to its load: the w with w = free - droop·F_x(w).

    F_x grows with w, so the root is one; Newton's method from a guess within a bracket that friction bounds.
    """
    reach = model.droop * model.grip_x[wheel] * scaled[0]
    low, high = free - reach, free + reach
    speed = guess if low < guess < high else free
    for _ in range(60):
        slopes = law_slopes(u, v, speed, wheel, scaled, rest, model)
        excess = speed - free + model.droop * slopes[0]
        if excess > 0:
            high = speed
        else:
            low = speed
        newton = speed - excess / (1.0 + model.droop * slopes[6])
        if abs(newton - speed) <= 1e-7 * max(abs(free), 1e-3):  # then as many digits more are right
            return float(newton)
        speed = newton if low < newton < high else (low + high) / 2
    return float(speed)


@compiled(inline="always")
def _touch_one(
    wheel: int, u: float, v: float, r: float, drive: Any, place: Any, rest: float, model: Any, contacts: Any
) -> None:
    """The contact of one wheel; u, v: of its centre in the body frame; place: of the robot on the plate."""
    surface = model.speed[wheel] * drive[wheel] if wheel < 2 else 0.0
    free, steer = surface, model.steer[wheel]
    load, friction, across, stiffness, drag = 1.0, 1.0, 1.0, 1.0, 0.0
    x, y, cos, sin, time = place
    for term in range(model.body_terms, model.body_terms + model.wheel_terms):
        value = model.pattern[term, wheel] * model.coefficient[term]
        if value == 0.0:
            continue
        channel, basis = model.channel[term], model.basis[term]
        if basis >= SLIDE_COS2:
            slide = u - surface if wheel < 2 else 0.0  # a driven wheel rolls: it slides sideways only
            value *= slide_basis(basis, cos * slide - sin * v, sin * slide + cos * v, rest)
        elif basis >= COS:
            at_x = x + cos * model.wheel_x[wheel] - sin * model.wheel_y[wheel]
            at_y = y + sin * model.wheel_x[wheel] + cos * model.wheel_y[wheel]
            angle = drive[2 + wheel] if wheel < 2 else 0.0
            value *= place_basis(basis, at_x, at_y, cos, sin, time, angle, model.point_x[term], model.point_y[term])
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
        elif channel == FRICTION:
            friction += value
        elif channel == FRICTION_ACROSS:
            across += value
    load, friction, stiffness = max(load, LEAST_FACTOR), max(friction, LEAST_FACTOR), max(stiffness, LEAST_FACTOR)
    across = max(across, LEAST_FACTOR)
    steep = stiffness / friction if model.stiffness_follows_load else stiffness / (load * friction)
    scaled = (load * friction, load * friction * across, steep, steep / across)
    steer += contacts[GIVEN, wheel]
    cos_steer, sin_steer, wheel_u, wheel_v = 1.0, 0.0, u, v
    if steer != 0.0:
        cos_steer, sin_steer = math.cos(steer), math.sin(steer)
        wheel_u, wheel_v = cos_steer * u + sin_steer * v, cos_steer * v - sin_steer * u
    droop = model.droop if wheel < 2 and drive[wheel] != 0.0 else 0.0
    if droop != 0.0:
        surface = drooping_speed(wheel_u, wheel_v, surface, contacts[SURFACE, wheel], wheel, scaled, rest, model)
    contacts[SURFACE, wheel], contacts[COS_STEER, wheel], contacts[SIN_STEER, wheel] = surface, cos_steer, sin_steer
    contacts[GRIP_X, wheel], contacts[GRIP_Y, wheel], contacts[STEEP_X, wheel], contacts[STEEP_Y, wheel] = scaled
    contacts[DRAG_FORCE, wheel], contacts[DROOP, wheel] = drag, droop


@compiled(inline="always")  # a call that hands an array on costs a count of its users, as long as this takes
def touch(u: float, v: float, r: float, drive: Any, place: Any, rest: float, model: Any, contacts: Any) -> None:
    """Bring the contacts to a velocity, a drive and a place."""
    if model.general == 0:
        contacts[SURFACE, 0], contacts[SURFACE, 1] = model.speed[0] * drive[0], model.speed[1] * drive[1]
    else:
        touch_changed(u, v, r, drive, place, rest, model, contacts)


@compiled()
def touch_changed(u: float, v: float, r: float, drive: Any, place: Any, rest: float, model: Any, contacts: Any) -> None:
    """The same for wheels that added physics changes."""
    _touch_all(u, v, r, drive, place, rest, model, contacts)
    if model.compliance == 0.0:
        return
    for _ in range(MOST_PASSES):
        if _give_way(u, v, r, place, rest, model, contacts) < GIVEN_RAD:
            break
        _touch_all(u, v, r, drive, place, rest, model, contacts)


@compiled()
def _touch_all(u: float, v: float, r: float, drive: Any, place: Any, rest: float, model: Any, contacts: Any) -> None:
    for wheel in range(4):
        body_u, body_v = u - r * model.wheel_y[wheel], v + r * model.wheel_x[wheel]
        _touch_one(wheel, body_u, body_v, r, drive, place, rest, model, contacts)


@compiled()
def _give_way(u: float, v: float, r: float, place: Any, rest: float, model: Any, contacts: Any) -> float:
    """Turn the axles by one step of Newton's method toward compliance times the lateral force on each; the change, rad.

    That force is what the rest of the robot presses the axle with: forces balance, so that those along the wheels and
    on the body tell it by their moment about the other axle. (A wheel that turns into its own force has several slip
    angles for one velocity, and none of them but by the balance.)
    """
    across, moment = 0.0, 0.0
    if model.body_terms > 0:
        _, across, moment = body_forces(u, v, r, place, rest, model)
    across -= model.mass * r * (u - r * model.gravity_y)
    moment -= model.mass * r * (model.gravity_x * u + model.gravity_y * v)
    forward, bend, lever = (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)
    for wheel in range(4):
        body_u, body_v = u - r * model.wheel_y[wheel], v + r * model.wheel_x[wheel]
        cos, sin = contacts[COS_STEER, wheel], contacts[SIN_STEER, wheel]
        wheel_u, wheel_v = cos * body_u + sin * body_v, cos * body_v - sin * body_u
        scaled = (contacts[GRIP_X, wheel], contacts[GRIP_Y, wheel], contacts[STEEP_X, wheel], contacts[STEEP_Y, wheel])
        f_x, f_y, x_1, x_2, y_1, y_2, _, _ = law_slopes(
            wheel_u, wheel_v, contacts[SURFACE, wheel], wheel, scaled, rest, model
        )
        f_x += contacts[DRAG_FORCE, wheel]
        ahead, aside = cos * f_x - sin * f_y, sin * f_x + cos * f_y
        turned = cos * (x_1 * wheel_v - x_2 * wheel_u) - sin * (y_1 * wheel_v - y_2 * wheel_u) - aside
        moment -= model.wheel_y[wheel] * ahead
        if wheel < 2:
            forward = (forward[0] + ahead, forward[1])
            lever = (lever[0] - model.wheel_y[wheel] * turned, lever[1])
            bend = (bend[0] + turned, bend[1])
        else:
            forward = (forward[0], forward[1] + ahead)
            lever = (lever[0], lever[1] - model.wheel_y[wheel] * turned)
            bend = (bend[0], bend[1] + turned)
    front, rear = model.wheel_x[0], model.wheel_x[2]
    apart, change = front - rear, 0.0
    for axle in range(2):
        given = contacts[GIVEN, 2 * axle]
        cos, sin = math.cos(given), math.sin(given)
        pressed = (rear * across - moment if axle == 0 else moment - front * across) / apart
        slope = (-lever[axle] if axle == 0 else lever[axle]) / apart
        excess = model.compliance * (pressed * cos - forward[axle] * sin) - given
        gain = model.compliance * (slope * cos - bend[axle] * sin - pressed * sin - forward[axle] * cos)
        step = excess / max(1.0 - gain, LEAST_DESCENT)
        contacts[GIVEN, 2 * axle] = contacts[GIVEN, 2 * axle + 1] = given + step
        change = max(change, abs(step))
    return change


@compiled(forceinline=True, fastmath=VECTORS)
def friction(u: float, v: float, r: float, contacts: Any, rest: float, model: Any) -> Triple:
    """Force forward, to the left, and moment of the four wheels."""
    along, across, moment = 0.0, 0.0, 0.0
    for wheel in range(4):
        x, y = model.wheel_x[wheel], model.wheel_y[wheel]
        body_u, body_v = u - r * y, v + r * x
        cos, sin = contacts[COS_STEER, wheel], contacts[SIN_STEER, wheel]
        wheel_u, driving = cos * body_u + sin * body_v, 1.0 if wheel < 2 else 0.0
        f_x, f_y = wheel_force(
            wheel_u,
            cos * body_v - sin * body_u,
            driving * slip_ratio(wheel_u, contacts[SURFACE, wheel], rest),
            model.grip_x[wheel] * contacts[GRIP_X, wheel],
            model.grip_y[wheel] * contacts[GRIP_Y, wheel],
            model.steep_x[wheel] * contacts[STEEP_X, wheel],
            model.steep_y[wheel] * contacts[STEEP_Y, wheel],
            model.ratio,
            model.shape_x,
            model.shape_y,
            model.decrease,
            rest,
        )
        f_x += contacts[DRAG_FORCE, wheel]
        force_x, force_y = cos * f_x - sin * f_y, sin * f_x + cos * f_y
        along += force_x
        across += force_y
        moment += x * force_y - y * force_x
    return along, across, moment


@compiled(forceinline=True, fastmath=VECTORS)
def friction_slopes(u: float, v: float, r: float, contacts: Any, rest: float, model: Any) -> tuple[Triple, Square]:
    """The same, and its derivatives by u, v and r, a row for each; the contacts are held, but speeds may droop."""
    along, across, moment = 0.0, 0.0, 0.0
    along_u, along_v, along_r, across_u, across_v, across_r = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    moment_u, moment_v, moment_r = 0.0, 0.0, 0.0
    for wheel in range(4):
        x, y = model.wheel_x[wheel], model.wheel_y[wheel]
        body_u, body_v = u - r * y, v + r * x
        cos, sin, droop = contacts[COS_STEER, wheel], contacts[SIN_STEER, wheel], contacts[DROOP, wheel]
        f_x, f_y, x_1, x_2, y_1, y_2, x_w, y_w = wheel_slopes(
            cos * body_u + sin * body_v,
            cos * body_v - sin * body_u,
            contacts[SURFACE, wheel],
            1.0 if wheel < 2 else 0.0,
            model.grip_x[wheel] * contacts[GRIP_X, wheel],
            model.grip_y[wheel] * contacts[GRIP_Y, wheel],
            model.steep_x[wheel] * contacts[STEEP_X, wheel],
            model.steep_y[wheel] * contacts[STEEP_Y, wheel],
            model.ratio,
            model.shape_x,
            model.shape_y,
            model.decrease,
            rest,
        )
        f_x += contacts[DRAG_FORCE, wheel]
        yields = 1.0 / (1.0 + droop * x_w)  # w = free - droop·F_x, differentiated
        y_1, y_2 = y_1 - y_w * droop * x_1 * yields, y_2 - y_w * droop * x_2 * yields
        x_1, x_2 = x_1 * yields, x_2 * yields
        f_u, f_v, g_u, g_v = cos * x_1 - sin * x_2, sin * x_1 + cos * x_2, cos * y_1 - sin * y_2, sin * y_1 + cos * y_2
        force_x, force_y = cos * f_x - sin * f_y, sin * f_x + cos * f_y
        x_u, x_v, y_u, y_v = cos * f_u - sin * g_u, cos * f_v - sin * g_v, sin * f_u + cos * g_u, sin * f_v + cos * g_v
        turn_u, turn_v = x * y_u - y * x_u, x * y_v - y * x_v
        along, across, moment = along + force_x, across + force_y, moment + x * force_y - y * force_x
        along_u, along_v, along_r = along_u + x_u, along_v + x_v, along_r + x * x_v - y * x_u
        across_u, across_v, across_r = across_u + y_u, across_v + y_v, across_r + x * y_v - y * y_u
        moment_u, moment_v, moment_r = moment_u + turn_u, moment_v + turn_v, moment_r + x * turn_v - y * turn_u
    return (along, across, moment), (
        (along_u, along_v, along_r),
        (across_u, across_v, across_r),
        (moment_u, moment_v, moment_r),
    )
