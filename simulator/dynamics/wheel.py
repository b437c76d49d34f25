"""One wheel on the plate: its contact state, its friction, and motor droop under that friction.

Units: mm, s, µN, rad. Contacts are an array (ROWS, n), a column per wheel. Rows: SURFACE, surface speed, mm/s;
COS_STEER, SIN_STEER, of the steering angle; GRIP_X, GRIP_Y and STEEP_X, STEEP_Y, factors of the nominal grip mu0·f_z
and of the nominal K_y/(mu0·f_z), along and across the wheel; DRAG_FORCE, µN; DROOP, loss of surface speed per µN;
AXLE_ANGLE, steering angle of a compliant axle, rad.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from simulator.compilation import compiled
from simulator.slip.law import sliding_slopes, wheel_slopes
from simulator.slip.magic_formula import VECTORS

SURFACE, COS_STEER, SIN_STEER, GRIP_X, GRIP_Y, STEEP_X, STEEP_Y, DRAG_FORCE, DROOP, AXLE_ANGLE, ROWS = range(11)


def fresh_contacts(slots: int = 4) -> Any:
    """Contacts (ROWS, slots) at rest, without effects; slots: wheels that a record has room for."""
    contacts = np.zeros((ROWS, slots))
    reset_contacts(contacts)
    return contacts


@compiled()
def reset_contacts(contacts: Any) -> None:
    """Fill contacts, an array of zeros, with the state at rest without effects."""
    for wheel in range(contacts.shape[1]):
        contacts[COS_STEER, wheel] = 1.0
        for row in range(GRIP_X, STEEP_Y + 1):
            contacts[row, wheel] = 1.0


@compiled(forceinline=True, fastmath=VECTORS)
def law_slopes(u: float, v: float, surface: float, wheel: int, scaled: Any, rest: float, model: Any) -> Any:
    """Friction along and across one wheel and its derivatives, in the order of simulator.slip.law.wheel_slopes."""
    if model.sliding > 0.0:
        return _sliding_law(u, v, surface, wheel, scaled, rest, model)
    return wheel_slopes(
        u,
        v,
        surface,
        model.driving[wheel],
        model.grip_x[wheel] * scaled[0],
        model.grip_y[wheel] * scaled[1],
        model.steep_x[wheel] * scaled[2],
        model.steep_y[wheel] * scaled[3],
        model.ratio[wheel],
        model.shape_x[wheel],
        model.shape_y[wheel],
        model.decrease[wheel],
        rest,
    )


@compiled(forceinline=True, fastmath=VECTORS)
def _sliding_law(u: float, v: float, surface: float, wheel: int, scaled: Any, rest: float, model: Any) -> Any:
    """law_slopes where the share model.sliding of the friction follows sliding_slopes, the rest wheel_slopes."""
    numbers = (
        *(model.driving[wheel], model.grip_x[wheel] * scaled[0], model.grip_y[wheel] * scaled[1]),
        *(model.steep_x[wheel] * scaled[2], model.steep_y[wheel] * scaled[3], model.ratio[wheel]),
        *(model.shape_x[wheel], model.shape_y[wheel], model.decrease[wheel], rest),
    )
    one, other, share = wheel_slopes(u, v, surface, *numbers), sliding_slopes(u, v, surface, *numbers), model.sliding
    return (
        one[0] + share * (other[0] - one[0]),
        one[1] + share * (other[1] - one[1]),
        one[2] + share * (other[2] - one[2]),
        one[3] + share * (other[3] - one[3]),
        one[4] + share * (other[4] - one[4]),
        one[5] + share * (other[5] - one[5]),
        one[6] + share * (other[6] - one[6]),
        one[7] + share * (other[7] - one[7]),
    )


@compiled(forceinline=True, fastmath=VECTORS)
def wheel_response(wheel: int, u: float, v: float, r: float, contacts: Any, rest: float, model: Any) -> Any:
    """Force on a wheel and its derivatives at a velocity of the robot, in the body frame.

    Eight numbers: force forward and to the left; derivatives of the forward force by the wheel centre's velocity
    forward and left, (x_u, x_v); likewise of the force to the left, (y_u, y_v); derivatives of both by the steering
    angle. Contacts are constant, except that surface speeds droop. Inlined: unused numbers are never computed.
    """
    x, y = model.wheel_x[wheel], model.wheel_y[wheel]
    body_u, body_v = u - r * y, v + r * x
    cos, sin, droop = contacts[COS_STEER, wheel], contacts[SIN_STEER, wheel], contacts[DROOP, wheel]
    wheel_u, wheel_v = cos * body_u + sin * body_v, cos * body_v - sin * body_u
    scaled = (contacts[GRIP_X, wheel], contacts[GRIP_Y, wheel], contacts[STEEP_X, wheel], contacts[STEEP_Y, wheel])
    f_x, f_y, x_1, x_2, y_1, y_2, x_w, y_w = law_slopes(
        wheel_u, wheel_v, contacts[SURFACE, wheel], wheel, scaled, rest, model
    )
    f_x += contacts[DRAG_FORCE, wheel]
    yields = 1.0 / (1.0 + droop * x_w)  # w = free - droop·F_x, differentiated
    y_1, y_2 = y_1 - y_w * droop * x_1 * yields, y_2 - y_w * droop * x_2 * yields
    x_1, x_2 = x_1 * yields, x_2 * yields
    f_u, f_v, g_u, g_v = cos * x_1 - sin * x_2, sin * x_1 + cos * x_2, cos * y_1 - sin * y_2, sin * y_1 + cos * y_2
    force_x, force_y = cos * f_x - sin * f_y, sin * f_x + cos * f_y
    x_turn, y_turn = x_1 * wheel_v - x_2 * wheel_u, y_1 * wheel_v - y_2 * wheel_u
    return (
        *(force_x, force_y, cos * f_u - sin * g_u, cos * f_v - sin * g_v, sin * f_u + cos * g_u, sin * f_v + cos * g_v),
        *(cos * x_turn - sin * y_turn - force_y, sin * x_turn + cos * y_turn + force_x),
    )


@compiled(forceinline=True, fastmath=VECTORS)
def law(u: float, v: float, wheel: int, contacts: Any, rest: float, model: Any) -> tuple[float, float]:
    """Friction along and across one wheel; u, v: velocity of its centre in the wheel frame."""
    scaled = (contacts[GRIP_X, wheel], contacts[GRIP_Y, wheel], contacts[STEEP_X, wheel], contacts[STEEP_Y, wheel])
    slopes = law_slopes(u, v, contacts[SURFACE, wheel], wheel, scaled, rest, model)
    return slopes[0], slopes[1]


@compiled(forceinline=True)  # as law_slopes is: the order of its sums depends on what surrounds them
def drooping_speed(
    u: float, v: float, free: float, guess: float, wheel: int, scaled: Any, rest: float, model: Any
) -> float:
    """Surface speed w of a wheel whose motor slows down under load: the root of w = free - droop·F_x(w).

    F_x grows with w, so the root is unique. Newton's method starts from guess, within a bracket given by the largest
    friction.
    """
    droop = model.droop[wheel]
    reach = droop * model.grip_x[wheel] * scaled[0]
    low, high = free - reach, free + reach
    speed = guess if low < guess < high else free
    for _ in range(60):
        slopes = law_slopes(u, v, speed, wheel, scaled, rest, model)
        excess = speed - free + droop * slopes[0]
        if excess > 0:
            high = speed
        else:
            low = speed
        newton = speed - excess / (1.0 + droop * slopes[6])
        if abs(newton - speed) <= 1e-7 * max(abs(free), 1e-3):  # convergence is quadratic: the error is its square
            return float(newton)
        speed = newton if low < newton < high else (low + high) / 2
    return float(speed)
