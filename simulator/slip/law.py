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


@compiled()
def wheel_slopes(
    u: float,
    v: float,
    surface_speed: float,
    driven_by_motor: bool,
    grip_x: float,
    grip_y: float,
    steep_x: float,
    steep_y: float,
    ratio: float,
    shape_x: float,
    shape_y: float,
    decrease: float,
    rest_speed: float,
) -> tuple[float, float, float, float, float, float, float, float]:
    """Both forces of wheel_force, then their derivatives: F_x and F_y by u, by v, by the surface speed.

    driven_by_motor: False for a wheel that rolls freely, whose slip ratio is 0.
    """
    forward = math.sqrt(u * u + rest_speed * rest_speed)
    per_speed = 1.0 / math.sqrt(forward * forward + v * v)
    along, aside = forward * per_speed, v * per_speed  # cosine and sine of the slip angle
    side_u, side_v = -aside * u * per_speed * per_speed, along * along * per_speed
    slide, slide_u, slide_v, slide_w = 0.0, 0.0, 0.0, 0.0
    if driven_by_motor:
        slip, turning = u - surface_speed, abs(surface_speed)
        if forward >= turning:
            scale = ratio * per_speed
            slide, slide_w = scale * slip, -scale
            slide_u = scale - slide * u * per_speed * per_speed
        else:
            scale = ratio * along / turning
            slide, slide_w = scale * slip, -scale * u / surface_speed
            slide_u = scale * (1.0 + slip * u * aside * aside / (forward * forward))
        slide_v = -slide * aside * per_speed
    sigma = math.sqrt(aside * aside + slide * slide)
    if sigma < 1e-12:
        stiff_x, stiff_y = grip_x * shape_x * steep_x, grip_y * shape_y * steep_y
        return (
            *(-slide * stiff_x, -aside * stiff_y),
            *(-slide_u * stiff_x, -slide_v * stiff_x, -side_u * stiff_y, -side_v * stiff_y),
            *(-slide_w * stiff_x, 0.0),
        )
    per_sigma = 1.0 / sigma
    gain_u = (aside * side_u + slide * slide_u) * per_sigma
    gain_v = (aside * side_v + slide * slide_v) * per_sigma
    gain_w = slide * slide_w * per_sigma
    pull, pull_by = _secant(sigma, per_sigma, grip_x, steep_x, shape_x, decrease)
    push, push_by = pull, pull_by
    if grip_x != grip_y or shape_x != shape_y:
        push, push_by = _secant(sigma, per_sigma, grip_y, steep_y, shape_y, decrease)
    return (
        *(-slide * pull, -aside * push),
        *(-slide_u * pull - slide * pull_by * gain_u, -slide_v * pull - slide * pull_by * gain_v),
        *(-side_u * push - aside * push_by * gain_u, -side_v * push - aside * push_by * gain_v),
        *(-slide_w * pull - slide * pull_by * gain_w, -aside * push_by * gain_w),
    )


@compiled(inline="always")
def _secant(
    sigma: float, per_sigma: float, grip: float, steep: float, shape: float, decrease: float
) -> tuple[float, float]:
    """Friction over sigma, and its derivative by sigma."""
    level = per_sigma - decrease
    if level <= 0.0:
        return 0.0, 0.0
    bent = steep * sigma
    angle = shape * math.atan(bent)
    sine = grip * math.sin(angle)
    bend = grip * math.cos(angle) * shape * steep / (1.0 + bent * bent)
    return sine * level, bend * level - sine * per_sigma * per_sigma
