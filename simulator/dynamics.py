"""Forces on the robot and the derivative of its velocity: Eqs. (1) and (2) in the plane, in the body frame.

Units: mm, s, g, µN = g·mm/s², rad. The velocity is (u, v, r): forward, to the left, yaw rate of the robot's centre.
A drive is what the motors do at an instant: rpm of the left and right wheel, and the angles they have turned, rad.
A place is x, y, cosine and sine of the heading, and the time.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from simulator.bases import place_basis, slide_basis, velocity_basis
from simulator.compiled import compiled
from simulator.slip.law import slip_ratio, wheel_force
from simulator.terms import (
    COS,
    DRAG,
    FORCE_FORWARD,
    FORCE_LEFT,
    FORCE_PLATE_X,
    FRICTION,
    LOAD,
    MOMENT,
    ONE,
    SLIDE_COS2,
    SPEED,
    STEER,
    STIFFNESS,
)

Triple = tuple[float, float, float]
COMPLIANCE_PROBE_RAD = 1e-6
LEAST_FACTOR = 0.02  # a term may weaken load, friction or stiffness of a wheel to 2 %, never reverse it


@compiled()
def law(u: float, v: float, slip: float, load: float, friction: float, stiffness: float, wheel: int, model: Any) -> Any:
    """Friction on a wheel whose load, friction and stiffness are changed by factors."""
    grip = load * friction
    steep = stiffness / friction if model.stiffness_follows_load else stiffness / grip
    return wheel_force(
        u,
        v,
        slip,
        model.grip_x[wheel] * grip,
        model.grip_y[wheel] * grip,
        model.steep_x[wheel] * steep,
        model.steep_y[wheel] * steep,
        model.ratio,
        model.shape_x,
        model.shape_y,
        model.decrease,
        model.rest_speed,
    )


@compiled()
def nominal_forces(u: float, v: float, r: float, left: float, right: float, model: Any) -> Triple:
    """Friction of the four wheels without any effect: force forward, to the left, and moment."""
    along, across, moment = 0.0, 0.0, 0.0
    for wheel in range(4):
        x, y = model.wheel_x[wheel], model.wheel_y[wheel]
        wheel_u, wheel_v = u - r * y, v + r * x
        slip = 0.0
        if wheel < 2:
            surface = model.speed[wheel] * (left if wheel == 0 else right)
            slip = slip_ratio(wheel_u, surface, model.rest_speed)
        force_x, force_y = wheel_force(
            wheel_u,
            wheel_v,
            slip,
            model.grip_x[wheel],
            model.grip_y[wheel],
            model.steep_x[wheel],
            model.steep_y[wheel],
            model.ratio,
            model.shape_x,
            model.shape_y,
            model.decrease,
            model.rest_speed,
        )
        along += force_x
        across += force_y
        moment += x * force_y - y * force_x
    return along, across, moment


@compiled()
def drooping_speed(
    u: float, v: float, free: float, load: float, friction: float, stiffness: float, wheel: int, model: Any
) -> float:
    """Surface speed of a motor that yields to its load: the w with w = free - droop·F_x(w).

    F_x grows with w, so the root is one; Newton's method within a bracket that friction bounds.
    """
    reach = model.droop * model.grip_x[wheel] * load * friction
    low, high, speed = free - reach, free + reach, free
    for _ in range(60):
        slip = slip_ratio(u, speed, model.rest_speed)
        excess = speed - free + model.droop * law(u, v, slip, load, friction, stiffness, wheel, model)[0]
        if excess > 0:
            high = speed
        else:
            low = speed
        step = 1e-7 * max(abs(speed), 1e-3)
        slip = slip_ratio(u, speed + step, model.rest_speed)
        beyond = speed + step - free + model.droop * law(u, v, slip, load, friction, stiffness, wheel, model)[0]
        newton = speed - excess * step / (beyond - excess)
        if abs(newton - speed) <= 1e-11 * max(abs(free), 1e-3):  # then the next digits are right too
            return float(newton)
        speed = newton if low < newton < high else (low + high) / 2
    return float(speed)


@compiled()
def giving_way(
    wheel: int,
    body_u: float,
    body_v: float,
    steer: float,
    surface: float,
    load: float,
    friction: float,
    stiffness: float,
    model: Any,
) -> float:
    """Angle by which a compliant axle turns under the lateral force of its wheel, rad.

    The angle d with d = compliance·F_y(steer + d), linearized: d = compliance·F_y / (1 - gain). Where the wheel turns
    into its own force (gain > 0, no solution or several beyond 1), 1/(1 - gain) is replaced by 1 + gain.
    """
    sides = np.empty(2)
    for probe in range(2):
        angle = steer + COMPLIANCE_PROBE_RAD * probe
        cos, sin = math.cos(angle), math.sin(angle)
        u, v = cos * body_u + sin * body_v, cos * body_v - sin * body_u
        slip = slip_ratio(u, surface, model.rest_speed) if wheel < 2 else 0.0
        sides[probe] = model.compliance * law(u, v, slip, load, friction, stiffness, wheel, model)[1]
    gain = (sides[1] - sides[0]) / COMPLIANCE_PROBE_RAD
    return float(sides[0] * (1.0 + gain) if gain > 0.0 else sides[0] / (1.0 - gain))


@compiled()
def wheel_state(
    wheel: int,
    u: float,
    v: float,
    r: float,
    rpm: float,
    angle: float,
    x: float,
    y: float,
    cos: float,
    sin: float,
    time: float,
    model: Any,
) -> Any:
    """Force of one wheel in the body frame, then its slip ratio, slip angle and force along and across it."""
    arm_x, arm_y = model.wheel_x[wheel], model.wheel_y[wheel]
    body_u, body_v = u - r * arm_y, v + r * arm_x
    at_x, at_y = x + cos * arm_x - sin * arm_y, y + sin * arm_x + cos * arm_y
    surface, steer = 0.0, model.steer[wheel]
    if wheel < 2:
        surface = model.speed[wheel] * rpm
    load, friction, stiffness, drag = 1.0, 1.0, 1.0, 0.0
    for term in range(model.body_terms, model.body_terms + model.wheel_terms):
        weight = model.pattern[term, wheel] * model.coefficient[term]
        if weight == 0.0:
            continue
        channel, basis = model.channel[term], model.basis[term]
        if basis == ONE:
            value = weight
        elif basis < COS:
            value = weight * velocity_basis(basis, body_u, body_v, r, model.rest_speed)
        elif basis < SLIDE_COS2:
            value = weight * place_basis(
                basis, at_x, at_y, cos, sin, time, angle, model.point_x[term], model.point_y[term]
            )
        else:
            slide = body_u - surface
            value = weight * slide_basis(
                basis, cos * slide - sin * body_v, sin * slide + cos * body_v, model.rest_speed
            )
        if channel == SPEED:
            surface += value * model.speed[min(wheel, 1)] * rpm
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
    if model.compliance != 0.0:
        steer += giving_way(wheel, body_u, body_v, steer, surface, load, friction, stiffness, model)
    cos_steer, sin_steer, wheel_u, wheel_v = 1.0, 0.0, body_u, body_v
    if steer != 0.0:
        cos_steer, sin_steer = math.cos(steer), math.sin(steer)
        wheel_u, wheel_v = cos_steer * body_u + sin_steer * body_v, cos_steer * body_v - sin_steer * body_u
    slip = 0.0
    if wheel < 2:
        if model.droop != 0.0 and rpm != 0.0:
            surface = drooping_speed(wheel_u, wheel_v, surface, load, friction, stiffness, wheel, model)
        slip = slip_ratio(wheel_u, surface, model.rest_speed)
    force_x, force_y = law(wheel_u, wheel_v, slip, load, friction, stiffness, wheel, model)
    force_x += drag
    rolled = math.sqrt(wheel_u * wheel_u + model.rest_speed * model.rest_speed)
    along, across = cos_steer * force_x - sin_steer * force_y, sin_steer * force_x + cos_steer * force_y
    return along, across, slip, math.atan2(wheel_v, rolled), force_x, force_y


@compiled()
def body_terms(
    u: float, v: float, r: float, x: float, y: float, cos: float, sin: float, time: float, model: Any
) -> Triple:
    """Forces and moments that act on the body: forward, to the left, about the vertical."""
    along, across, moment = 0.0, 0.0, 0.0
    for term in range(model.body_terms):
        channel, basis, value = model.channel[term], model.basis[term], model.coefficient[term]
        if basis >= COS:
            value *= place_basis(basis, x, y, cos, sin, time, 0.0, model.point_x[term], model.point_y[term])
        elif basis != ONE:
            value *= velocity_basis(basis, u, v, r, model.rest_speed)
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
def accelerations(
    u: float,
    v: float,
    r: float,
    left: float,
    right: float,
    left_angle: float,
    right_angle: float,
    x: float,
    y: float,
    cos: float,
    sin: float,
    time: float,
    model: Any,
) -> Triple:
    """Rate of change of (u, v, r): forces and moment less the inertia of the turning frame, over the mass matrix."""
    along, across, moment = body_terms(u, v, r, x, y, cos, sin, time, model)
    if model.general == 0:
        friction = nominal_forces(u, v, r, left, right, model)
        along, across, moment = along + friction[0], across + friction[1], moment + friction[2]
    else:
        for wheel in range(4):
            rpm, angle = 0.0, 0.0
            if wheel == 0:
                rpm, angle = left, left_angle
            elif wheel == 1:
                rpm, angle = right, right_angle
            state = wheel_state(wheel, u, v, r, rpm, angle, x, y, cos, sin, time, model)
            along += state[0]
            across += state[1]
            moment += model.wheel_x[wheel] * state[1] - model.wheel_y[wheel] * state[0]
    mass, ahead, aside = model.mass, model.gravity_x, model.gravity_y
    along += mass * r * (v + r * ahead)
    across -= mass * r * (u - r * aside)
    moment -= mass * r * (ahead * u + aside * v)
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
