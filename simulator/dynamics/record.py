"""The record of a robot for the kernels: names, shapes and meaning of its fields. Units: simulator.dynamics.scale."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

MOST_TERMS = 40  # all effects of the catalogue at once have 22
WHEELS = "wheels"  # stands for a number per wheel
NO_COMMAND = 2
SIDES = {"left": 0, "right": 1, "none": NO_COMMAND}

# Fields that effects may change; filled in one assignment, in this order.
NUMBERS: dict[str, int | str] = {
    "mass": 1,
    "inertia": 1,  # yaw, about the robot's centre
    "inverse_mass": 9,  # (3, 3), of (u, v, r), with the centre of gravity where it is
    "gravity_x": 1,  # centre of gravity in the body frame
    "gravity_y": 1,
    "grip_x": WHEELS,  # mu0_x·f_z; 0 for casters and where a wheel has lifted off
    "grip_y": WHEELS,
    "steep_x": WHEELS,  # K_y/(mu0_x·f_z), the b of Eq. (6)
    "steep_y": WHEELS,
    "ratio": WHEELS,  # K_x/K_y
    "shape_x": WHEELS,
    "shape_y": WHEELS,
    "decrease": WHEELS,  # K_mu
    "stiffness_follows_load": WHEELS,  # 1 or 0
    "by_left": WHEELS,  # surface speed per rpm of the left command, 0 where another drives it
    "by_right": WHEELS,
    "droop": WHEELS,  # loss of surface speed per µN of driving force
    "steer": WHEELS,
    "rest_speed": 1,
    "speed": 2,  # largest surface speed per rpm, left and right
    "dead_band": 1,  # rpm
    "dead_time": 1,
    "lag": 1,
    "compliance": 1,  # rad per µN
    "mix": 8,  # added to the left, then to the right command, per rpm of left, right, |left| and |right|
    "sliding": 1,  # share of friction that opposes the sliding velocity of the wheel
    "limits": 3,  # rpm: of each wheel, of the mean of both sides, and of half of their difference
    "ramps": 3,  # s per rpm: least time in which mean, half difference and wheel change by 1 rpm; 0 without a limit
}
# Numbers of the slip law of one wheel, in the order above.
LAW = (
    *("grip_x", "grip_y", "steep_x", "steep_y", "ratio", "shape_x", "shape_y", "decrease"),
    "stiffness_follows_load",
)
# Values in the slots beyond the wheels: no grip, and no division by 0.
EMPTY = dict.fromkeys(("steep_x", "steep_y", "ratio", "shape_x", "shape_y", "stiffness_follows_load"), 1.0)


@cache
def model_type(slots: int) -> np.dtype[np.void]:
    """Type of the record of a robot with up to `slots` wheels.

    It is a np.record, so that uncompiled kernels can use its fields as attributes, too.
    """
    changing: list[tuple[Any, ...]] = []
    for name, count in NUMBERS.items():
        shape = {"inverse_mass": (3, 3)}.get(name, slots if count == WHEELS else count)
        changing.append((name, float) if shape == 1 else (name, float, shape))
    fields = np.dtype(
        [
            *changing,
            ("time_unit", float),  # s; the unit of length is its square in mm
            ("wheel_x", float, slots),
            ("wheel_y", float, slots),
            ("driving", float, slots),  # 1, or 0 for a wheel that rolls freely
            ("axle_x", float, 2),  # of the front and the rear axle, where axles are compliant
            ("wheels", np.int64),  # number of wheels; the slots beyond have no grip
            ("general", np.int64),  # 0: friction of the wheels is nominal
            ("wheels_vary_with_velocity", np.int64),  # 1: terms on the wheels depend on the velocity
            ("body_varies_with_velocity", np.int64),  # 1: terms on the body depend on the velocity
            ("varies", np.int64),  # 1: forces change along a steady turn
            ("wheels_vary", np.int64),  # 1: friction changes along a steady turn
            ("body_terms", np.int64),  # number of terms on the body, which come first; those on the wheels follow
            ("wheel_terms", np.int64),
            ("side", np.int64, slots),  # command that drives the wheel: 0 left, 1 right, or NO_COMMAND
            ("axle", np.int64, slots),  # 0 front, 1 rear, or NO_AXLE; where axles are compliant
            ("channel", np.int64, MOST_TERMS),
            ("basis", np.int64, MOST_TERMS),
            ("coefficient", float, MOST_TERMS),
            ("point_x", float, MOST_TERMS),
            ("point_y", float, MOST_TERMS),
            ("falloff", float, MOST_TERMS),
            ("point_depth", float),  # of these points below the plane of the robot's centre
            ("pattern", float, (MOST_TERMS, slots)),
        ],
        align=True,
    )
    return np.dtype((np.record, fields))
