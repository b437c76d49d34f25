"""Axles that give way sideways: by the angle at which compliance and balance agree. Units: mm, s, g, µN, rad."""

from __future__ import annotations

import math
from typing import Any

from simulator.body import body_forces
from simulator.compiled import compiled
from simulator.wheel import (
    COS_STEER,
    DRAG_FORCE,
    GIVEN,
    GRIP_X,
    GRIP_Y,
    SIN_STEER,
    STEEP_X,
    STEEP_Y,
    SURFACE,
    law_slopes,
)

LEAST_DESCENT = 0.5  # of Newton's method, where an axle would turn into its own force


@compiled()
def give_way(u: float, v: float, r: float, place: Any, rest: float, model: Any, contacts: Any) -> float:
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
