"""Forces on the robot and the derivative of its velocity: Eqs. (1) and (2) in the plane, in the body frame.

Units: mm, s, g, µN = g·mm/s², rad. The velocity is (u, v, r): forward, to the left, yaw rate of the robot's centre.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from simulator.compiled import compiled
from simulator.slip.law import slip_ratio, wheel_force


@compiled()
def forces(u: float, v: float, r: float, left: float, right: float, model: Any) -> tuple[float, float, float]:
    """Force and moment left over on the robot: friction minus the inertia of its turning frame; 0, 0, 0 when steady.

    left, right: surface speeds of the driving wheels, mm/s.
    """
    along, across, moment = 0.0, 0.0, 0.0
    for wheel in range(4):
        x, y = model.wheel_x[wheel], model.wheel_y[wheel]
        wheel_u, wheel_v = u - r * y, v + r * x
        slip = 0.0
        if wheel < 2:
            slip = slip_ratio(wheel_u, left if wheel == 0 else right, model.rest_speed)
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
    return along + model.mass * r * v, across - model.mass * r * u, moment


@compiled()
def accelerations(u: float, v: float, r: float, left: float, right: float, model: Any) -> tuple[float, float, float]:
    """Rate of change of (u, v, r)."""
    along, across, moment = forces(u, v, r, left, right, model)
    return along / model.mass, across / model.mass, moment / model.inertia


@compiled()
def jacobian(u: float, v: float, r: float, left: float, right: float, model: Any, out: Any) -> None:
    """Derivative of `accelerations` by (u, v, r) into out (3, 3), by central differences far below the rest speed."""
    step = 1e-2 * model.rest_speed
    for column in range(3):
        du, dv, dr = step * (column == 0), step * (column == 1), step * (column == 2)
        up = accelerations(u + du, v + dv, r + dr, left, right, model)
        down = accelerations(u - du, v - dv, r - dr, left, right, model)
        for row in range(3):
            out[row, column] = (up[row] - down[row]) / (2 * step)


@compiled()
def solve3(a: Any, b0: float, b1: float, b2: float) -> tuple[float, float, float]:
    """Solve the 3 × 3 system a·x = b by Cramer's rule; NaN where a is singular."""
    c00 = a[1, 1] * a[2, 2] - a[1, 2] * a[2, 1]
    c01 = a[1, 2] * a[2, 0] - a[1, 0] * a[2, 2]
    c02 = a[1, 0] * a[2, 1] - a[1, 1] * a[2, 0]
    determinant = a[0, 0] * c00 + a[0, 1] * c01 + a[0, 2] * c02
    if determinant == 0.0:
        return np.nan, np.nan, np.nan
    c10 = a[0, 2] * a[2, 1] - a[0, 1] * a[2, 2]
    c11 = a[0, 0] * a[2, 2] - a[0, 2] * a[2, 0]
    c12 = a[0, 1] * a[2, 0] - a[0, 0] * a[2, 1]
    c20 = a[0, 1] * a[1, 2] - a[0, 2] * a[1, 1]
    c21 = a[0, 2] * a[1, 0] - a[0, 0] * a[1, 2]
    c22 = a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]
    return (
        (c00 * b0 + c10 * b1 + c20 * b2) / determinant,
        (c01 * b0 + c11 * b1 + c21 * b2) / determinant,
        (c02 * b0 + c12 * b1 + c22 * b2) / determinant,
    )
