"""A robot compiled for the kernels: one flat record of numbers, in mm, s, g, µN and rad.

The record is all that the kernels see. A batch is an array of records; a fit fills one record again and again.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.robot import Robot
from simulator.slip.law import REST_SPEED_MM_S

UN_PER_MN = 1000.0

MODEL = np.dtype(
    [
        ("mass", float),
        ("inertia", float),  # yaw, about the robot's centre
        ("wheel_x", float, 4),
        ("wheel_y", float, 4),
        ("radius", float),
        ("load", float, 4),  # f_z
        ("grip_x", float, 4),  # mu0_x·f_z
        ("grip_y", float, 4),
        ("steep_x", float, 4),  # K_y/(mu0_x·f_z), the b of Eq. (6)
        ("steep_y", float, 4),
        ("ratio", float),  # K_x/K_y
        ("shape_x", float),
        ("shape_y", float),
        ("decrease", float),  # K_mu
        ("rest_speed", float),
    ],
    align=True,
)


def compile_robot(robot: Robot, rest_speed_mm_s: float = REST_SPEED_MM_S) -> NDArray[np.void]:
    """The record of a robot, shape (1,) of dtype MODEL."""
    model = np.zeros(1, MODEL)
    record: Any = model[0]
    slip, attraction = robot.slip, robot.magnetic_attraction
    weight = np.full(4, robot.weight_uN / 4)
    attracted = UN_PER_MN * np.array([attraction.driving_wheel_mN] * 2 + [attraction.driven_wheel_mN] * 2)
    load = weight + attracted
    stiffness = slip.lateral_stiffness * (load if slip.stiffness_basis == "load" else weight)
    record["mass"], record["inertia"] = robot.body.mass_g, robot.yaw_inertia_g_mm2
    record["wheel_x"], record["wheel_y"] = robot.wheel_positions_mm().T
    record["radius"], record["load"] = robot.wheels.radius_mm, load
    for axis, friction in (("x", slip.longitudinal_friction), ("y", slip.lateral_friction)):
        record[f"grip_{axis}"] = friction * load
        record[f"steep_{axis}"] = stiffness / (friction * load)
    record["ratio"] = slip.longitudinal_stiffness / slip.lateral_stiffness
    record["shape_x"], record["shape_y"] = slip.longitudinal_shape, slip.lateral_shape
    record["decrease"], record["rest_speed"] = slip.friction_decrease, rest_speed_mm_s
    return model
