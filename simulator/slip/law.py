"""Slip ratio, slip angle and friction force of one wheel: Eqs. (3) to (7) in the reading of the model notes.

Wheel frame: x along the wheel's rolling direction, y to its left. Forces act on the wheel.

Rest is regularised by one small speed: |u| is replaced by sqrt(u² + REST_SPEED²), so that a wheel at rest has slip
angle 0 and slip ratio 0, and a wheel that starts to spin at rest has slip ratio -1 and pulls forward.
"""

from __future__ import annotations

import math

from simulator.compiled import compiled

REST_SPEED_MM_S = 1e-4  # far below the slowest speed in use (0.16 mm/s at 3 rpm); tests show that results hold


@compiled(inline="always")
def slip_ratio(u: float, surface_speed: float, rest_speed: float) -> float:
    """Slip ratio s of Eq. (3): (u - r·phi') over the larger of |u| and |r·phi'|; mm/s."""
    return (u - surface_speed) / max(math.sqrt(u * u + rest_speed * rest_speed), abs(surface_speed))


@compiled()
def wheel_force(
    u: float,
    v: float,
    slip: float,
    grip_x: float,
    grip_y: float,
    steep_x: float,
    steep_y: float,
    ratio: float,
    shape_x: float,
    shape_y: float,
    decrease: float,
    rest_speed: float,
) -> tuple[float, float]:
    """Longitudinal and lateral friction force on a wheel, in the unit of the grips.

    u, v: velocity of the wheel centre in the wheel frame, mm/s; slip: slip ratio s (0 for a wheel that rolls freely);
    grip_i: mu0_i·f_z; steep_i: K_y/(mu0_i·f_z), the b of Eq. (6); ratio: K_x/K_y; shape_i: a; decrease: K_mu.
    Each force opposes its own slip, forward and backward alike; friction falls to 0, never below.
    """
    forward = math.sqrt(u * u + rest_speed * rest_speed)
    speed = math.sqrt(forward * forward + v * v)
    sin_angle = v / speed
    slide = ratio * slip * forward / speed
    sigma = math.sqrt(sin_angle * sin_angle + slide * slide)
    if sigma < 1e-12:  # the limit of sin(a·atan(b·sigma))/sigma; both forces vanish with their slip
        return -slide * grip_x * shape_x * steep_x, -sin_angle * grip_y * shape_y * steep_y
    level = max(1.0 - decrease * sigma, 0.0) / sigma
    along = level * grip_x * math.sin(shape_x * math.atan(steep_x * sigma))
    if grip_x == grip_y and shape_x == shape_y:
        return -slide * along, -sin_angle * along
    across = level * grip_y * math.sin(shape_y * math.atan(steep_y * sigma))
    return -slide * along, -sin_angle * across
