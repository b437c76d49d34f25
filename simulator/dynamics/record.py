"""The record that the kernels see of a robot: its numbers, and how many of each. Units: simulator.dynamics.scale."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

MOST_TERMS = 40
WHEELS = "wheels"  # stands for a number per wheel
NO_COMMAND = 2
SIDES = {"left": 0, "right": 1, "none": NO_COMMAND}

# What effects may change; filled in one go, in this order.
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
    "mix": 8,  # added to the left, then to the right command, per rpm of left, right and their sizes
    "sliding": 1,  # share of friction that opposes the velocity at which a wheel slides
    "limits": 3,  # rpm, of each wheel, of what both sides have in common, and of half of their difference
    "ramps": 2,  # s per rpm: how long the last two take at least to change by one; 0 where nothing limits them
}
# Numbers of the slip law of one wheel, in the order above.
LAW = (
    *("grip_x", "grip_y", "steep_x", "steep_y", "ratio", "shape_x", "shape_y", "decrease"),
    "stiffness_follows_load",
)
# In the slots beyond the wheels there is no grip, and nothing that friction is divided by is 0.
EMPTY = dict.fromkeys(("steep_x", "steep_y", "ratio", "shape_x", "shape_y", "stiffness_follows_load"), 1.0)


@cache
def model_type(slots: int) -> np.dtype[np.void]:
    """Type of the record of a robot of up to so many wheels.

    It is a np.record, so that kernels that are not compiled find its fields by the same names.
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
            ("axle_x", float, 2),  # of the front and the rear axle, where axles give way
            ("wheels", np.int64),  # how many there are; the slots beyond have no grip
            ("general", np.int64),  # 0: friction of the wheels is nominal
            ("wheels_feel", np.int64),  # 1: what terms change about a wheel depends on the velocity
            ("body_feels", np.int64),  # 1: forces of terms on the body do
            ("varies", np.int64),  # 1: forces change along a steady turn
            ("wheels_vary", np.int64),  # 1: friction does
            ("body_terms", np.int64),  # the first so many terms act on the body, the next on the wheels
            ("wheel_terms", np.int64),
            ("side", np.int64, slots),  # command that drives it: 0 left, 1 right, or NO_COMMAND
            ("axle", np.int64, slots),  # 0 front, 1 rear, or none of them; where axles give way
            ("channel", np.int64, MOST_TERMS),
            ("basis", np.int64, MOST_TERMS),
            ("coefficient", float, MOST_TERMS),
            ("point_x", float, MOST_TERMS),
            ("point_y", float, MOST_TERMS),
            ("falloff", float, MOST_TERMS),
            ("pattern", float, (MOST_TERMS, slots)),
        ],
        align=True,
    )
    return np.dtype((np.record, fields))
