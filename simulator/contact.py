"""One wheel on the plate: what added physics changes about it, the force it gets, and the derivatives of that force.

Units: mm, s, g, µN, rad. A contact is what terms leave of a wheel at an instant: surface speed, steering angle, factors
of load, friction and stiffness, drag.
"""

from __future__ import annotations

import math
from typing import Any

from simulator.bases import place_basis, slide_basis, velocity_basis
from simulator.compiled import compiled
from simulator.slip.law import slip_ratio, wheel_force, wheel_slopes
from simulator.terms import COS, DRAG, FRICTION, LOAD, ONE, SLIDE_COS2, SPEED, STEER, STIFFNESS

Contact = tuple[float, float, float, float, float, float]
LEAST_FACTOR = 0.02  # a term may weaken load, friction or stiffness of a wheel to 2 %, never reverse it


@compiled()
def law(u: float, v: float, surface: float, wheel: int, scaled: Any, rest: float, model: Any) -> tuple[float, float]:
    """Friction on a wheel; scaled: factors of its grip and of its steepness."""
    return wheel_force(
        u,
        v,
        slip_ratio(u, surface, rest) if wheel < 2 else 0.0,
        model.grip_x[wheel] * scaled[0],
        model.grip_y[wheel] * scaled[0],
        model.steep_x[wheel] * scaled[1],
        model.steep_y[wheel] * scaled[1],
        model.ratio,
        model.shape_x,
        model.shape_y,
        model.decrease,
        rest,
    )


@compiled()
def law_slopes(u: float, v: float, surface: float, wheel: int, scaled: Any, rest: float, model: Any) -> Any:
    """The same friction, then its derivatives; see simulator.slip.law.wheel_slopes."""
    return wheel_slopes(
        u,
        v,
        surface,
        wheel < 2,
        model.grip_x[wheel] * scaled[0],
        model.grip_y[wheel] * scaled[0],
        model.steep_x[wheel] * scaled[1],
        model.steep_y[wheel] * scaled[1],
        model.ratio,
        model.shape_x,
        model.shape_y,
        model.decrease,
        rest,
    )


@compiled()
def drooping_speed(u: float, v: float, free: float, wheel: int, scaled: Any, rest: float, model: Any) -> float:
    """Surface speed of a motor that yields to its load: the w with w = free - droop·F_x(w).

    F_x grows with w, so the root is one; Newton's method within a bracket that friction bounds.
    """
    reach = model.droop * model.grip_x[wheel] * scaled[0]
    low, high, speed = free - reach, free + reach, free
    for _ in range(60):
        slopes = law_slopes(u, v, speed, wheel, scaled, rest, model)
        excess = speed - free + model.droop * slopes[0]
        if excess > 0:
            high = speed
        else:
            low = speed
        newton = speed - excess / (1.0 + model.droop * slopes[6])
        if abs(newton - speed) <= 1e-9 * max(abs(free), 1e-3):  # then the next digits are right too
            return float(newton)
        speed = newton if low < newton < high else (low + high) / 2
    return float(speed)


@compiled()
def giving_way(
    wheel: int, body_u: float, body_v: float, steer: float, surface: float, scaled: Any, rest: float, model: Any
) -> float:
    """Angle by which a compliant axle turns under the lateral force of its wheel, rad.

    The angle d with d = compliance·F_y(steer + d), linearized: d = compliance·F_y / (1 - gain). Where the wheel turns
    into its own force (gain > 0, no solution or several beyond 1), 1/(1 - gain) is replaced by 1 + gain.
    """
    cos, sin = math.cos(steer), math.sin(steer)
    u, v = cos * body_u + sin * body_v, cos * body_v - sin * body_u
    slopes = law_slopes(u, v, surface, wheel, scaled, rest, model)
    gain = model.compliance * (slopes[4] * v - slopes[5] * u)
    aside = model.compliance * slopes[1]
    return float(aside * (1.0 + gain) if gain > 0.0 else aside / (1.0 - gain))


@compiled()
def contact(wheel: int, u: float, v: float, r: float, drive: Any, place: Any, rest: float, model: Any) -> Contact:
    """Surface speed, steering angle, factors of grip and steepness, drag; 0 or 1 whether the speed may droop.

    u, v: of the wheel centre in the body frame; place: of the robot on the plate.
    """
    surface, turning = 0.0, 0.0
    if wheel < 2:
        surface = model.speed[wheel] * drive[wheel]
        turning = 1.0 if drive[wheel] != 0.0 else 0.0
    if model.general == 0:
        return surface, 0.0, 1.0, 1.0, 0.0, 0.0
    free, steer = surface, model.steer[wheel]
    load, friction, stiffness, drag = 1.0, 1.0, 1.0, 0.0
    x, y, cos, sin, time = place
    for term in range(model.body_terms, model.body_terms + model.wheel_terms):
        value = model.pattern[term, wheel] * model.coefficient[term]
        if value == 0.0:
            continue
        channel, basis = model.channel[term], model.basis[term]
        if basis >= SLIDE_COS2:
            slide = u - surface
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
    load, friction, stiffness = max(load, LEAST_FACTOR), max(friction, LEAST_FACTOR), max(stiffness, LEAST_FACTOR)
    steep = stiffness / friction if model.stiffness_follows_load else stiffness / (load * friction)
    scaled = (load * friction, steep)
    if model.compliance != 0.0:
        steer += giving_way(wheel, u, v, steer, surface, scaled, rest, model)
    return surface, steer, scaled[0], scaled[1], drag, turning


@compiled()
def turned(u: float, v: float, steer: float) -> tuple[float, float, float, float]:
    """Cosine and sine of a steering angle, and a body-frame velocity in the frame of the wheel."""
    if steer == 0.0:
        return 1.0, 0.0, u, v
    cos, sin = math.cos(steer), math.sin(steer)
    return cos, sin, cos * u + sin * v, cos * v - sin * u


@compiled()
def contact_force(wheel: int, u: float, v: float, touch: Contact, rest: float, model: Any) -> Any:
    """Force of one wheel in the body frame, then along and across the wheel, and its surface speed under load."""
    surface, scaled = touch[0], (touch[2], touch[3])
    cos, sin, wheel_u, wheel_v = turned(u, v, touch[1])
    if model.droop != 0.0 and touch[5] == 1.0:
        surface = drooping_speed(wheel_u, wheel_v, surface, wheel, scaled, rest, model)
    force_x, force_y = law(wheel_u, wheel_v, surface, wheel, scaled, rest, model)
    force_x += touch[4]
    return cos * force_x - sin * force_y, sin * force_x + cos * force_y, force_x, force_y, surface


@compiled()
def contact_slopes(wheel: int, u: float, v: float, touch: Contact, rest: float, model: Any) -> Any:
    """Force of one wheel in the body frame and its derivatives: F_x and F_y by u, by v; the contact is held."""
    surface, scaled = touch[0], (touch[2], touch[3])
    cos, sin, wheel_u, wheel_v = turned(u, v, touch[1])
    drooping = model.droop != 0.0 and touch[5] == 1.0
    if drooping:
        surface = drooping_speed(wheel_u, wheel_v, surface, wheel, scaled, rest, model)
    f_x, f_y, x_u, x_v, y_u, y_v, x_w, y_w = law_slopes(wheel_u, wheel_v, surface, wheel, scaled, rest, model)
    f_x += touch[4]
    if drooping:  # w = free - droop·F_x, differentiated
        yields = 1.0 / (1.0 + model.droop * x_w)
        y_u, y_v = y_u - y_w * model.droop * x_u * yields, y_v - y_w * model.droop * x_v * yields
        x_u, x_v = x_u * yields, x_v * yields
    along_u, along_v = cos * x_u - sin * x_v, sin * x_u + cos * x_v  # of the force along the wheel, by body u and v
    aside_u, aside_v = cos * y_u - sin * y_v, sin * y_u + cos * y_v
    return (
        *(cos * f_x - sin * f_y, sin * f_x + cos * f_y),
        *(cos * along_u - sin * aside_u, cos * along_v - sin * aside_v),
        *(sin * along_u + cos * aside_u, sin * along_v + cos * aside_v),
    )
