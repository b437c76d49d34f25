"""An independent simulator, written from the paper's equations in plain Python, for tests and benchmarks only.

Nothing is shared with the kernels but the robot file: Eqs. (1) to (8) in the reading of the model notes, integrated by
scipy from break to break of the command.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from simulator.robot import Robot

Array = NDArray[np.float64]
Rates = Callable[[float, Array], list[float]]


def plain_rates(robot: Robot, left_rpm: float, right_rpm: float, rest_speed: float = 1e-4) -> Rates:
    """Derivative of (x, y, heading, u, v, yaw rate) in plain Python."""
    mass, inertia, slip = robot.body.mass_g, robot.yaw_inertia_g_mm2, robot.slip
    weight = robot.weight_uN / 4
    ratio = slip.longitudinal_stiffness / slip.lateral_stiffness
    wheels = []
    for number, (x, y) in enumerate(robot.wheel_positions_mm().tolist()):
        driving = number < 2
        attraction = robot.magnetic_attraction
        load = weight + 1000 * (attraction.driving_wheel_mN if driving else attraction.driven_wheel_mN)
        stiffness = slip.lateral_stiffness * (load if slip.stiffness_basis == "load" else weight)
        rpm = (left_rpm, right_rpm)[number] if driving else None
        surface = None if rpm is None else 2 * math.pi * robot.wheels.radius_mm * rpm / 60
        wheels.append((x, y, load, stiffness, surface))

    def rates(_time: float, state: Array) -> list[float]:
        heading, u, v, r = (float(value) for value in state[2:])
        along = across = moment = 0.0
        for x, y, load, stiffness, surface in wheels:
            wheel_u, wheel_v = u - r * y, v + r * x
            forward = math.sqrt(wheel_u**2 + rest_speed**2)
            angle = math.atan2(wheel_v, forward)
            s = 0.0 if surface is None else (wheel_u - surface) / max(forward, abs(surface))
            pull = ratio * s * math.cos(angle)
            sigma = math.sqrt(math.sin(angle) ** 2 + pull**2)
            if sigma == 0.0:
                continue
            forces = []
            for share, friction, shape in (
                (pull, slip.longitudinal_friction, slip.longitudinal_shape),
                (math.sin(angle), slip.lateral_friction, slip.lateral_shape),
            ):
                level = friction * (1 - slip.friction_decrease * sigma) * load
                curve = math.sin(shape * math.atan(stiffness / (friction * load) * sigma))
                forces.append(-share / sigma * level * curve)
            along += forces[0]
            across += forces[1]
            moment += x * forces[1] - y * forces[0]
        cos, sin = math.cos(heading), math.sin(heading)
        turning = [along / mass + r * v, across / mass - r * u, moment / inertia]
        return [cos * u - sin * v, sin * u + cos * v, r, *turning]

    return rates


def integrated(
    pieces: list[tuple[float, float, Rates]], times: Array, rtol: float, atol: float, method: str = "LSODA"
) -> Array:
    """States (n, 6) at times from rest at the origin; pieces: (begin, end, rates), each integrated by itself."""
    states = np.zeros((len(times), 6))
    state = np.zeros(6)
    for begin, end, rates in pieces:
        inside = (times > begin) & (times <= end)
        asked = np.unique(np.append(times[inside], end))
        found = solve_ivp(rates, (begin, end), state, method, asked, rtol=rtol, atol=atol)
        states[inside] = found.y.T[: int(inside.sum())]
        state = found.y[:, -1]
    return states
