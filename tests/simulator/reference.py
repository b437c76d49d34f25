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
Pull = Callable[[float, float, float], tuple[float, float]]
Pace = Callable[[float, float], float]


def plain_rates(
    robot: Robot,
    left_rpm: float,
    right_rpm: float,
    rest_speed: float = 1e-4,
    pull: Pull | None = None,
    pace: Pace | None = None,
) -> Rates:
    """Derivative of (x, y, heading, u, v, yaw rate) in plain Python.

    pull: a force on the centre in the plate frame, µN, of x, y, heading; pace: a factor of the surface speeds, of the
    time and the rpm.
    """
    mass, inertia, slip = robot.body.mass_g, robot.yaw_inertia_g_mm2, robot.slip
    weight = robot.weight_uN / len(robot.all_wheels)  # of layouts that are symmetric about the centre of gravity
    ratio = slip.longitudinal_stiffness / slip.lateral_stiffness
    wheels = []
    for wheel in robot.all_wheels:
        load = weight + 1000 * wheel.attraction_mN
        stiffness = slip.lateral_stiffness * (load if slip.stiffness_basis == "load" else weight)
        rpm = {"left": left_rpm, "right": right_rpm}.get(wheel.driven_by)
        surface = None if rpm is None else (2 * math.pi * wheel.radius_mm * rpm / 60, rpm)
        grips = (slip.longitudinal_friction * load, slip.lateral_friction * load)
        wheels.append((wheel.x_mm, wheel.y_mm, *grips, stiffness / grips[0], stiffness / grips[1], surface))

    sqrt, sin, atan, shape_x, shape_y = math.sqrt, math.sin, math.atan, slip.longitudinal_shape, slip.lateral_shape
    decrease, rest = slip.friction_decrease, rest_speed * rest_speed

    def rates(time: float, state: Array) -> list[float]:
        at_x, at_y, heading, u, v, r = state.tolist()
        along = across = moment = 0.0
        for x, y, grip_x, grip_y, steep_x, steep_y, turning in wheels:
            wheel_u, wheel_v = u - r * y, v + r * x
            forward = sqrt(wheel_u * wheel_u + rest)
            speed = sqrt(forward * forward + wheel_v * wheel_v)
            side, grasp = wheel_v / speed, 0.0
            if turning is not None:
                surface = turning[0] if pace is None else turning[0] * pace(time, turning[1])
                grasp = ratio * (wheel_u - surface) / max(forward, abs(surface)) * forward / speed
            sigma = sqrt(side * side + grasp * grasp) or 1e-300
            level = (1 - decrease * sigma) / sigma
            force_x = -grasp * level * grip_x * sin(shape_x * atan(steep_x * sigma)) if grasp else 0.0
            force_y = -side * level * grip_y * sin(shape_y * atan(steep_y * sigma))
            along += force_x
            across += force_y
            moment += x * force_y - y * force_x
        cos, sine = math.cos(heading), sin(heading)
        if pull is not None:
            pull_x, pull_y = pull(at_x, at_y, heading)
            along, across = along + cos * pull_x + sine * pull_y, across - sine * pull_x + cos * pull_y
        gained = [along / mass + r * v, across / mass - r * u, moment / inertia]
        return [cos * u - sine * v, sine * u + cos * v, r, *gained]

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
