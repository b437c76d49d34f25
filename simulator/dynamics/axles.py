"""Compliant axles: the steering angle that equals compliance times lateral force. Units: mm, s, g, µN, rad.

The lateral force on an axle is computed from the balance of moments about the other axle, from the longitudinal forces
of the wheels and the forces on the body. (The slip law alone does not determine it, because a wheel that steers into
its own lateral force has several slip angles for one velocity.)
"""

from __future__ import annotations

import math
from typing import Any

from simulator.compilation import compiled, counter
from simulator.dynamics.body import Square, Triple, loads
from simulator.dynamics.wheel import AXLE_ANGLE, wheel_response
from simulator.slip.magic_formula import VECTORS

LEAST_DESCENT = 0.5  # least diagonal of Newton's matrix, which vanishes where an axle steers into its own force


@compiled(forceinline=True, fastmath=VECTORS)
def _axle(
    axle: int, u: float, v: float, r: float, contacts: Any, rest: float, model: Any
) -> tuple[Triple, Triple, Triple, Triple, Triple]:
    """Forces on the front (0) or rear (1) axle, and their derivatives by u, v, r and the axle's angle.

    Forces: forward, to the left, and the moment of the forward forces about the middle of the axle.
    """
    along, across, twist = 0.0, 0.0, 0.0
    along_u, across_u, twist_u, along_v, across_v, twist_v = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    along_r, across_r, twist_r, along_turn, across_turn, twist_turn = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for wheel in range(len(model.wheel_x)):
        if model.axle[wheel] != axle:
            continue
        x, y = model.wheel_x[wheel], model.wheel_y[wheel]
        f_x, f_y, x_u, x_v, y_u, y_v, x_turn, y_turn = wheel_response(wheel, u, v, r, contacts, rest, model)
        x_r, y_r = x * x_v - y * x_u, x * y_v - y * y_u
        along, across, twist = along + f_x, across + f_y, twist - y * f_x
        along_u, across_u, twist_u = along_u + x_u, across_u + y_u, twist_u - y * x_u
        along_v, across_v, twist_v = along_v + x_v, across_v + y_v, twist_v - y * x_v
        along_r, across_r, twist_r = along_r + x_r, across_r + y_r, twist_r - y * x_r
        along_turn, across_turn, twist_turn = along_turn + x_turn, across_turn + y_turn, twist_turn - y * x_turn
    return (
        (along, across, twist),
        (along_u, across_u, twist_u),
        (along_v, across_v, twist_v),
        (along_r, across_r, twist_r),
        (along_turn, across_turn, twist_turn),
    )


@compiled(forceinline=True)
def _lack(axle: int, forward: float, pressed: float, contacts: Any, model: Any) -> tuple[float, float, float]:
    """Compliance times lateral force minus the axle's angle, and its derivatives by the forces to the left and forward.

    forward, pressed: force on the axle forward and to the left in the body frame, µN.
    """
    given = 0.0
    for wheel in range(len(model.wheel_x)):
        if model.axle[wheel] == axle:
            given = contacts[AXLE_ANGLE, wheel]
    by_pressed, by_forward = model.compliance * math.cos(given), -model.compliance * math.sin(given)
    return by_pressed * pressed + by_forward * forward - given, by_pressed, by_forward


@compiled(forceinline=True)
def _balance(front: Any, rear: Any, body: Triple, contacts: Any, model: Any) -> Any:
    """Residuals of both axles (see _lack), their derivatives by the forces, and minus those by the angles, (4)."""
    ahead, behind = model.axle_x[0], model.axle_x[1]
    per_length = 1.0 / (ahead - behind)
    twist = body[2] + front[0][2] + rear[0][2]
    on_front, on_rear = per_length * (behind * body[1] - twist), per_length * (twist - ahead * body[1])
    front_lacks, front_pressed, front_forward = _lack(counter(0), front[0][0], on_front, contacts, model)
    rear_lacks, rear_pressed, rear_forward = _lack(counter(1), rear[0][0], on_rear, contacts, model)
    turned = (
        1.0
        + per_length * front_pressed * front[4][2]
        - front_forward * (front[4][0] + on_front)
        + front_pressed * front[0][0],
        per_length * front_pressed * rear[4][2],
        -per_length * rear_pressed * front[4][2],
        1.0
        - per_length * rear_pressed * rear[4][2]
        - rear_forward * (rear[4][0] + on_rear)
        + rear_pressed * rear[0][0],
    )
    return (front_lacks, rear_lacks), (front_pressed, front_forward, rear_pressed, rear_forward), turned


@compiled()
def turn_axles(u: float, v: float, r: float, place: Any, rest: float, model: Any, contacts: Any) -> float:
    """Turn the axles by one Newton step toward compliance times lateral force; returns the largest change, rad.

    If the forces are not finite, as in a step that is tried and fails, the axles stay, because later steps begin there.
    """
    front, rear = _axle(counter(0), u, v, r, contacts, rest, model), _axle(counter(1), u, v, r, contacts, rest, model)
    (a_lack, b_lack), _, (aa, ab, ba, bb) = _balance(front, rear, loads(u, v, r, place, rest, model), contacts, model)
    aa, bb = max(aa, LEAST_DESCENT), max(bb, LEAST_DESCENT)
    determinant = aa * bb - ab * ba
    if determinant < LEAST_DESCENT * LEAST_DESCENT:
        ab, ba, determinant = 0.0, 0.0, aa * bb
    a_step, b_step = (bb * a_lack - ab * b_lack) / determinant, (aa * b_lack - ba * a_lack) / determinant
    if not abs(a_step) + abs(b_step) < math.inf:  # also where it is no number
        return math.inf
    for wheel in range(len(model.wheel_x)):
        if model.axle[wheel] == 0:
            contacts[AXLE_ANGLE, wheel] += a_step
        elif model.axle[wheel] == 1:
            contacts[AXLE_ANGLE, wheel] += b_step
    change: float = max(abs(a_step), abs(b_step))
    return change


@compiled(forceinline=True)
def _together(front: Triple, rear: Triple, model: Any) -> Triple:
    """Sum of the forces on both axles: forward, to the left, moment about the robot's centre."""
    moment = model.axle_x[0] * front[1] + model.axle_x[1] * rear[1] + front[2] + rear[2]
    return front[0] + rear[0], front[1] + rear[1], moment


@compiled(forceinline=True)
def _yielding(held: Any, body: Triple, by: Any, turned: Any, response: Any, model: Any) -> Triple:
    """Derivative of the friction by a velocity where the axles follow.

    held: derivatives of the axle forces by it at fixed angles; body: of the forces on the body; by, turned: see
    _balance; response: derivatives of the axle forces by the angles.
    """
    front, rear = held
    front_pressed, front_forward, rear_pressed, rear_forward = by
    (aa, ab, ba, bb), ahead, behind = turned, model.axle_x[0], model.axle_x[1]
    twist, per_length = body[2] + front[2] + rear[2], 1.0 / (ahead - behind)
    a_lack = front_pressed * per_length * (behind * body[1] - twist) + front_forward * front[0]
    b_lack = rear_pressed * per_length * (twist - ahead * body[1]) + rear_forward * rear[0]
    determinant = aa * bb - ab * ba
    a, b = (bb * a_lack - ab * b_lack) / determinant, (aa * b_lack - ba * a_lack) / determinant
    by_front, by_rear = response
    return _together(
        (front[0] + a * by_front[0], front[1] + a * by_front[1], front[2] + a * by_front[2]),
        (rear[0] + b * by_rear[0], rear[1] + b * by_rear[1], rear[2] + b * by_rear[2]),
        model,
    )


@compiled()
def axle_slopes(
    u: float, v: float, r: float, body: Triple, body_by: Square, contacts: Any, rest: float, model: Any
) -> tuple[Triple, Square]:
    """Friction on the robot and its derivatives by u, v and r, where compliant axles turn as it changes.

    body, body_by: the forces on the body and their derivatives; the contacts hold the axle angles in equilibrium.
    """
    front, rear = _axle(counter(0), u, v, r, contacts, rest, model), _axle(counter(1), u, v, r, contacts, rest, model)
    _, by, turned = _balance(front, rear, body, contacts, model)
    response = front[4], rear[4]
    return _together(front[0], rear[0], model), (
        _yielding((front[1], rear[1]), body_by[0], by, turned, response, model),
        _yielding((front[2], rear[2]), body_by[1], by, turned, response, model),
        _yielding((front[3], rear[3]), body_by[2], by, turned, response, model),
    )
