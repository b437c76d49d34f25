"""Values of the bases of simulator.dynamics.terms, for the kernels. Units: mm, s, rad."""

from __future__ import annotations

import math

from simulator.compilation import compiled
from simulator.dynamics.terms import (
    ABS_U,
    ABS_YAW,
    COS,
    COS2,
    COS_ANGLE,
    SIGN_U,
    SIGN_V,
    SIN,
    SIN2,
    SIN_ANGLE,
    SLIDE_COS2,
    TIME,
    TOWARD_X,
    U_ABS,
    V_ABS,
    YAW,
    YAW_ABS,
    U,
    V,
    X,
    Y,
)

# Smoothing width of the sign of the yaw rate: far below any yaw rate that is measured (0.06 degrees over 10 s).
REST_YAW_RATE_RAD_S = 1e-4
REFERENCE_MM = 10.0  # distance at which an attraction that falls off has its stated force


@compiled()
def sign(value: float, rest: float) -> float:
    """Sign of a value, smoothed over the width rest."""
    return value / math.sqrt(value * value + rest * rest)


@compiled()
def velocity_basis(basis: int, u: float, v: float, r: float, rest_speed: float) -> float:
    """Bases of the velocity, in mm/s and rad/s."""
    if basis == U:
        return u
    if basis == V:
        return v
    if basis == YAW:
        return r
    if basis == U_ABS:
        return u * abs(u)
    if basis == V_ABS:
        return v * abs(v)
    if basis == YAW_ABS:
        return r * abs(r)
    if basis == ABS_U:
        return abs(u)
    if basis == ABS_YAW:
        return abs(r)
    if basis == SIGN_U:
        return sign(u, rest_speed)
    if basis == SIGN_V:
        return sign(v, rest_speed)
    return sign(r, REST_YAW_RATE_RAD_S)


@compiled()
def place_basis(
    basis: int,
    x: float,
    y: float,
    cos: float,
    sin: float,
    time: float,
    angle: float,
    point: tuple[float, float, float, float],
) -> float:
    """Bases of position (mm), heading (its cosine and sine), time (s) and wheel angle (rad).

    point: x, y (mm), fall-off and depth (mm) of the bases toward a point.
    """
    if basis == COS:
        return cos
    if basis == SIN:
        return sin
    if basis == COS2:
        return cos * cos - sin * sin
    if basis == SIN2:
        return 2 * sin * cos
    if basis == X:
        return x
    if basis == Y:
        return y
    if basis == TIME:
        return time
    if basis == COS_ANGLE:
        return math.cos(angle)
    if basis == SIN_ANGLE:
        return math.sin(angle)
    to_x, to_y, falloff, depth = point
    away_x, away_y = to_x - x, to_y - y
    distance = math.sqrt(away_x * away_x + away_y * away_y + depth * depth)
    size: float = 1.0 if falloff == 0.0 else (REFERENCE_MM / distance) ** falloff
    return size * away_x / distance if basis == TOWARD_X else size * away_y / distance


@compiled()
def slide_basis(basis: int, slide_x: float, slide_y: float, rest_speed: float) -> float:
    """Cosine or sine of twice the direction of a sliding velocity in the plate frame, mm/s; 0 at rest."""
    square = slide_x * slide_x + slide_y * slide_y + rest_speed * rest_speed
    if basis == SLIDE_COS2:
        return (slide_x * slide_x - slide_y * slide_y) / square
    return 2 * slide_x * slide_y / square
