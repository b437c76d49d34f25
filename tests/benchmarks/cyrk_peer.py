"""CyRK as a peer: its LSODA in C++ with the paper's equations as a compiled callback, restarted at a reversal."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.robot import Robot

Array = NDArray[np.float64]
AVAILABLE = importlib.util.find_spec("CyRK") is not None


def wheel_table(robot: Robot) -> Array:
    """Rows of x, y, grip along and across, steepness along and across, and 1 for a driving wheel; (4, 7)."""
    slip, attraction = robot.slip, robot.magnetic_attraction
    rows = []
    for number, (x, y) in enumerate(robot.wheel_positions_mm()):
        weight = robot.weight_uN / 4
        load = weight + 1000 * (attraction.driving_wheel_mN if number < 2 else attraction.driven_wheel_mN)
        stiffness = slip.lateral_stiffness * (load if slip.stiffness_basis == "load" else weight)
        grips = slip.longitudinal_friction * load, slip.lateral_friction * load
        rows.append([x, y, *grips, stiffness / grips[0], stiffness / grips[1], float(number < 2)])
    return np.array(rows)


def lsoda(robot: Robot, left_rpm: float, right_rpm: float) -> Callable[[Array, float, float], Array]:
    """A call (times, rtol, atol) -> states (n, 6) of a run from rest whose command is reversed at half time."""
    import numba
    from CyRK import cyjit, nbsolve2_ivp

    table, slip, rest = wheel_table(robot), robot.slip, 1e-4
    mass, inertia, ratio = (
        robot.body.mass_g,
        robot.yaw_inertia_g_mm2,
        slip.longitudinal_stiffness / slip.lateral_stiffness,
    )
    shape_x, shape_y, decrease = slip.longitudinal_shape, slip.lateral_shape, slip.friction_decrease

    def rates(out: Any, _time: float, state: Any, surface: Any) -> None:
        u, v, r = state[3], state[4], state[5]
        along, across, moment = 0.0, 0.0, 0.0
        for wheel in range(4):
            x, y = table[wheel, 0], table[wheel, 1]
            wheel_u, wheel_v = u - r * y, v + r * x
            forward = math.sqrt(wheel_u * wheel_u + rest * rest)
            speed = math.sqrt(forward * forward + wheel_v * wheel_v)
            side, pull = wheel_v / speed, 0.0
            if wheel < 2:
                turning = surface[wheel]
                pull = ratio * (wheel_u - turning) / max(forward, abs(turning)) * forward / speed
            sigma = math.sqrt(side * side + pull * pull) + 1e-300
            level = (1.0 - decrease * sigma) / sigma
            force_x = -pull * level * table[wheel, 2] * math.sin(shape_x * math.atan(table[wheel, 4] * sigma))
            force_y = -side * level * table[wheel, 3] * math.sin(shape_y * math.atan(table[wheel, 5] * sigma))
            along += force_x
            across += force_y
            moment += x * force_y - y * force_x
        cos, sin = math.cos(state[2]), math.sin(state[2])
        out[0], out[1], out[2] = cos * u - sin * v, sin * u + cos * v, r
        out[3], out[4], out[5] = along / mass + r * v, across / mass - r * u, moment / inertia

    address = cyjit(rates).address
    per_rpm = 2 * math.pi * robot.wheels.radius_mm / 60
    surface = per_rpm * np.array([left_rpm, right_rpm])

    @numba.njit
    def solve(begin: float, end: float, start: Array, times: Array, args: Array, rtol: float, atol: float) -> Array:
        found = nbsolve2_ivp(
            address, (begin, end), start, method="LSODA", t_eval=times, args=args, rtol=rtol, atol=atol
        )
        states = found.y.copy()
        found.free()
        return states

    def run(times: Array, rtol: float, atol: float) -> Array:
        middle = times[-1] / 2
        first = times[times <= middle]
        before = solve(0.0, middle, np.zeros(6), first, surface, rtol, atol)
        after = solve(middle, times[-1], before[:, -1].copy(), times[times >= middle], -surface, rtol, atol)
        return np.concatenate([before, after[:, 1:]], axis=1).T

    return run
