"""State of every wheel along a run: slip ratio, slip angle, friction."""

from __future__ import annotations

from typing import Any

import numpy as np

from simulator.compiled import compiled
from simulator.model import UN_PER_MN
from simulator.run import WheelStates
from simulator.slip.law import slip_ratio, wheel_force


def wheel_states(model: Any, velocity: Any, surface_speed: Any) -> WheelStates:
    """Wheel states for velocities (n, 3) in mm/s, rad/s and surface speeds (n, 2) in mm/s of the driving wheels."""
    table = np.empty((4, len(velocity), 4))
    _fill(model, velocity, surface_speed, table)
    table[2:] /= UN_PER_MN
    table.setflags(write=False)
    return WheelStates(*table)


@compiled()
def _fill(model: Any, velocity: Any, surface_speed: Any, table: Any) -> None:
    for row in range(len(velocity)):
        u, v, r = velocity[row]
        for wheel in range(4):
            wheel_u, wheel_v = u - r * model.wheel_y[wheel], v + r * model.wheel_x[wheel]
            slip = 0.0
            if wheel < 2:
                slip = slip_ratio(wheel_u, surface_speed[row, wheel], model.rest_speed)
            table[0, row, wheel] = slip
            table[1, row, wheel] = np.arctan2(wheel_v, np.sqrt(wheel_u**2 + model.rest_speed**2))
            table[2, row, wheel], table[3, row, wheel] = wheel_force(
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
