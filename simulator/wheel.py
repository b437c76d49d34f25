"""One wheel on the plate: its row of numbers, its friction, and the motor that yields to it.

Units: mm, s, µN, rad. Contacts are an array (ROWS, 4): rows SURFACE (speed, mm/s), COS_STEER and SIN_STEER, GRIP and
STEEP (factors of a wheel's grip and steepness, along X and across Y), DRAG (µN), DROOP (loss of surface speed per µN),
GIVEN (angle by which its axle has given way, rad); a column per wheel.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from simulator.compiled import compiled
from simulator.slip.law import wheel_slopes

SURFACE, COS_STEER, SIN_STEER, GRIP_X, GRIP_Y, STEEP_X, STEEP_Y, DRAG_FORCE, DROOP, GIVEN, ROWS = range(11)


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
