"""Slip ratio, slip angle and friction force of one wheel: Eqs. (3) to (7) in the reading of the model notes.

Wheel frame: x along the wheel's rolling direction, y to its left. Forces act on the wheel.

Rest is regularised by one small speed: |u| is replaced by sqrt(u² + REST_SPEED²). A wheel at rest then has slip angle 0
and slip ratio 0; a wheel that starts to spin while the robot is at rest has slip ratio -1 and pulls forward.
"""

from __future__ import annotations

import math

from simulator.compilation import compiled
from simulator.slip.magic_formula import VECTORS, sine_and_cosine_of_atan, sine_of_atan

LEAST_SQUARE = 1e-200  # keeps sigma from 0, where sin(a·atan(b·sigma))/sigma is its limit a·b to rounding
REST_SPEED_MM_S = 1e-4  # far below the slowest speed in use (0.16 mm/s at 3 rpm); tests show that results hold


@compiled(forceinline=True, fastmath=VECTORS)
def slip_ratio(u: float, surface_speed: float, rest_speed: float) -> float:
    """Slip ratio s of Eq. (3): (u - r·phi') over the larger of |u| and |r·phi'|; arguments in mm/s."""
    return (u - surface_speed) / max(math.sqrt(u * u + rest_speed * rest_speed), abs(surface_speed))


@compiled(forceinline=True, fastmath=VECTORS)
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
    per_speed = 1.0 / math.sqrt(forward * forward + v * v)
    lateral, slide = v * per_speed, ratio * slip * forward * per_speed
    sigma = math.sqrt(lateral * lateral + slide * slide + LEAST_SQUARE)
    level = max(1.0 / sigma - decrease, 0.0)
    along, across = sine_of_atan(steep_x * sigma, shape_x), sine_of_atan(steep_y * sigma, shape_y)
    return -slide * level * grip_x * along, -lateral * level * grip_y * across


@compiled(forceinline=True, fastmath=VECTORS)
def wheel_slopes(
    u: float,
    v: float,
    surface_speed: float,
    driving: float,
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
    """Both forces of wheel_force and their derivatives: F_x, F_y, then F_x by u, by v, F_y by u, by v, both by w.

    w: surface speed, mm/s. driving: 1, or 0 for a wheel that rolls freely, whose slip ratio is 0.
    """
    forward = math.sqrt(u * u + rest_speed * rest_speed)
    per_speed = 1.0 / math.sqrt(forward * forward + v * v)
    along, lateral = forward * per_speed, v * per_speed  # cosine and sine of the slip angle
    side_u, side_v = -lateral * u * per_speed * per_speed, along * along * per_speed
    # The denominator of the slip ratio is the larger of both speeds, so its derivatives have two cases.
    turning, rolls = abs(surface_speed), forward >= abs(surface_speed)
    scale = driving * ratio * along / max(forward, turning)
    slide = scale * (u - surface_speed)
    slide_w = -scale * (1.0 if rolls else u / surface_speed)
    slide_u = scale - slide * u * (per_speed * per_speed if rolls else -lateral * lateral / (forward * forward))
    slide_v = -slide * lateral * per_speed
    slips = slide, lateral, slide_u, slide_v, slide_w, side_u, side_v, 0.0
    return _forces(*slips, grip_x, grip_y, steep_x, steep_y, shape_x, shape_y, decrease)


@compiled(forceinline=True, fastmath=VECTORS)
def sliding_slopes(
    u: float,
    v: float,
    surface_speed: float,
    driving: float,
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
    """Forces and derivatives in the order of wheel_slopes, for friction that opposes the sliding velocity of a wheel.

    Both slips have one denominator, the larger of the speeds of the wheel's centre and of its surface: they are
    (u - r·phi', v) over it. For a wheel that rolls freely or hardly slides sideways this equals wheel_slopes. For a
    wheel that slides sideways, as in a turn on the spot, the slip angle of wheel_slopes does not depend on the speed of
    the wheel's surface. Source: theoretical slip, Pacejka (2012), Tire and Vehicle Dynamics, section 4.2.
    """
    speed = math.sqrt(u * u + v * v + rest_speed * rest_speed)
    turning = driving * abs(surface_speed)
    rolls = speed >= turning
    per_speed = 1.0 / max(speed, turning)
    scale = driving * ratio * per_speed
    slide, lateral = scale * (u - surface_speed), v * per_speed
    by_u, by_v = (u * per_speed * per_speed, v * per_speed * per_speed) if rolls else (0.0, 0.0)
    by_w = 0.0 if rolls else (per_speed if surface_speed > 0.0 else -per_speed)
    slide_u, slide_v, slide_w = scale - slide * by_u, -slide * by_v, -scale - slide * by_w
    side_u, side_v, side_w = -lateral * by_u, per_speed - lateral * by_v, -lateral * by_w
    slips = slide, lateral, slide_u, slide_v, slide_w, side_u, side_v, side_w
    return _forces(*slips, grip_x, grip_y, steep_x, steep_y, shape_x, shape_y, decrease)


@compiled(forceinline=True, fastmath=VECTORS)
def _forces(
    slide: float,
    lateral: float,
    slide_u: float,
    slide_v: float,
    slide_w: float,
    side_u: float,
    side_v: float,
    side_w: float,
    grip_x: float,
    grip_y: float,
    steep_x: float,
    steep_y: float,
    shape_x: float,
    shape_y: float,
    decrease: float,
) -> tuple[float, float, float, float, float, float, float, float]:
    """Both forces against the slips slide (along, times K_x/K_y) and lateral, and their derivatives by u, v and w.

    slide_u, …, side_w: derivatives of the two slips. Order of wheel_slopes.
    """
    sigma = math.sqrt(lateral * lateral + slide * slide + LEAST_SQUARE)
    per_sigma = 1.0 / sigma
    gain_u = (lateral * side_u + slide * slide_u) * per_sigma
    gain_v = (lateral * side_v + slide * slide_v) * per_sigma
    gain_w = (lateral * side_w + slide * slide_w) * per_sigma
    pull, pull_by = _secant(sigma, per_sigma, grip_x, steep_x, shape_x, decrease)
    push, push_by = _secant(sigma, per_sigma, grip_y, steep_y, shape_y, decrease)
    return (
        *(-slide * pull, -lateral * push),
        *(-slide_u * pull - slide * pull_by * gain_u, -slide_v * pull - slide * pull_by * gain_v),
        *(-side_u * push - lateral * push_by * gain_u, -side_v * push - lateral * push_by * gain_v),
        *(-slide_w * pull - slide * pull_by * gain_w, -side_w * push - lateral * push_by * gain_w),
    )


@compiled(forceinline=True, fastmath=VECTORS)
def _secant(
    sigma: float, per_sigma: float, grip: float, steep: float, shape: float, decrease: float
) -> tuple[float, float]:
    """Friction force over sigma, and the derivative of this ratio by sigma."""
    level = per_sigma - decrease
    bent = steep * sigma
    sine, cosine = sine_and_cosine_of_atan(bent, shape)
    force, gain = grip * sine, grip * cosine * shape * steep / (1.0 + bent * bent)
    slope = gain * level - force * per_sigma * per_sigma
    return force * max(level, 0.0), slope if level > 0.0 else 0.0
