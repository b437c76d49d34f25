"""State of every wheel along a run: slip ratio, slip angle, friction."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from simulator.compiled import compiled
from simulator.dynamics import wheel_state
from simulator.model import UN_PER_MN
from simulator.run import WheelStates
from simulator.segments import END, command_segments, drive_at


def wheel_states(model: Any, knots: Any, times_s: Any, states: Any) -> WheelStates:
    """Wheel states of a record of dtype MODEL for states (n, 6) at times_s (n,) under a command's knots."""
    table = np.empty((4, len(times_s), 4))
    _fill(model, knots, times_s, states, table)
    table[2:] /= UN_PER_MN
    table.setflags(write=False)
    return WheelStates(*table)


@compiled()
def _fill(model: Any, knots: Any, times: Any, states: Any, table: Any) -> None:
    segments = command_segments(knots, times[0], times[-1], model)
    number = 0
    for row in range(len(times)):
        # At a jump the later value counts.
        while number < len(segments) - 1 and times[row] >= segments[number, END]:
            number += 1
        left, right, left_angle, right_angle = drive_at(segments[number], times[row], model.lag)
        x, y, heading, u, v, r = states[row]
        cos, sin = math.cos(heading), math.sin(heading)
        for wheel in range(4):
            rpm, angle = (left, left_angle) if wheel == 0 else (right, right_angle)
            found = wheel_state(wheel, u, v, r, rpm, angle, x, y, cos, sin, times[row], model)
            for item in range(4):
                table[item, row, wheel] = found[2 + item]
