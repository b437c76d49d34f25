"""State of every wheel along a run: slip ratio, slip angle, friction."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from simulator.compilation import compiled
from simulator.dynamics.contact import update_contacts
from simulator.dynamics.motors import END, command_segments, drive_at
from simulator.dynamics.scale import scaled_knots, scaled_states
from simulator.dynamics.terms import UN_PER_MN
from simulator.dynamics.wheel import COS_STEER, DRAG_FORCE, SIN_STEER, SURFACE, law, reset_contacts
from simulator.integrator.workspace import new_work
from simulator.run import WheelStates
from simulator.slip.law import slip_ratio


def wheel_states(model: Any, knots: Any, times_s: Any, states: Any) -> WheelStates:
    """Wheel states of a robot's record for states (n, 6) at times_s (n,) under a command's knots."""
    slots, unit = len(model["wheel_x"]), float(model["time_unit"])
    table = np.empty((4, len(times_s), slots))
    # Copies are writable: kernels are compiled anew for arrays that are not.
    _fill(model, scaled_knots(knots, unit), np.asarray(times_s) / unit, scaled_states(states, unit), table)
    table = table[:, :, : int(model["wheels"])]
    table[2:] /= UN_PER_MN
    table.setflags(write=False)
    return WheelStates(*table)


@compiled()
def _fill(model: Any, knots: Any, times: Any, states: Any, table: Any) -> None:
    segments = command_segments(knots, times[0], times[-1], model)
    holder = new_work(model)
    contacts = holder[0].contacts
    reset_contacts(contacts)
    number = 0
    for row in range(len(times)):
        # At a jump the later value counts.
        while number < len(segments) - 1 and times[row] >= segments[number, END]:
            number += 1
        drive = drive_at(segments[number], times[row], model.lag)
        x, y, heading, u, v, r = states[row]
        place, rest = (x, y, math.cos(heading), math.sin(heading), times[row]), model.rest_speed
        update_contacts(u, v, r, drive, place, rest, model, contacts)
        for wheel in range(len(model.wheel_x)):
            body_u, body_v = u - r * model.wheel_y[wheel], v + r * model.wheel_x[wheel]
            turned_cos, turned_sin = contacts[COS_STEER, wheel], contacts[SIN_STEER, wheel]
            wheel_u = turned_cos * body_u + turned_sin * body_v
            wheel_v = turned_cos * body_v - turned_sin * body_u
            force_x, force_y = law(wheel_u, wheel_v, wheel, contacts, rest, model)
            table[0, row, wheel] = 0.0
            if model.driving[wheel] != 0.0:
                table[0, row, wheel] = slip_ratio(wheel_u, contacts[SURFACE, wheel], rest)
            table[1, row, wheel] = math.atan2(wheel_v, math.sqrt(wheel_u * wheel_u + rest * rest))
            table[2, row, wheel], table[3, row, wheel] = force_x + contacts[DRAG_FORCE, wheel], force_y
