"""Motion from command: first version, a stiff integrator over every segment between command jumps."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from simulator.command import Command
from simulator.dynamics import accelerations
from simulator.errors import SimulationError
from simulator.model import compile_robot
from simulator.robot import Robot
from simulator.run import Run, State
from simulator.wheels import wheel_states


def simulate(robot: Robot, command: Command, times_s: ArrayLike, start: State | None = None) -> Run:
    """Integrate the full dynamics from start at times_s[0]; outputs at times_s (n,), increasing.

    Raises SimulationError for times that do not increase or are not finite.
    """
    from scipy.integrate import solve_ivp

    times = _checked_times(times_s)
    begin = start or State()
    model = compile_robot(robot)[0]
    circumference = 2 * np.pi * robot.wheels.radius_mm / 60

    def rhs(time: float, y: Any) -> list[float]:
        left, right = command.at(time)
        u, v, r = y[3:]
        cos, sin = np.cos(y[2]), np.sin(y[2])
        rates = accelerations(u, v, r, float(left) * circumference, float(right) * circumference, model)
        return [cos * u - sin * v, sin * u + cos * v, r, *rates]

    y = np.array([begin.x_mm, begin.y_mm, begin.heading_rad, begin.u_mm_s, begin.v_mm_s, begin.yaw_rate_rad_s])
    states = np.empty((len(times), 6))
    states[0] = y
    knots = command.time_s[(command.time_s > times[0]) & (command.time_s < times[-1])]
    edges = np.unique(np.concatenate([[times[0]], knots, [times[-1]]]))
    for t0, t1 in pairwise(edges):
        inside = (times > t0) & (times <= t1)
        end = np.nextafter(t1, t0)
        asked = np.append(np.minimum(times[inside], end), end)
        found = solve_ivp(rhs, (t0, end), y, "LSODA", np.unique(asked), rtol=1e-8, atol=1e-10)
        y = found.y[:, -1]
        states[inside] = found.y.T[: inside.sum()]
    left, right = command.at(times)
    wheels = wheel_states(model, states[:, 3:], np.stack([left, right], axis=1) * circumference)
    states.setflags(write=False)
    x, y_mm, heading, u, v, yaw_rate = states.T
    return Run(times, x, y_mm, heading, u, v, yaw_rate, wheels)


def _checked_times(times_s: ArrayLike) -> Any:
    times = np.array(times_s, dtype=float)
    if times.ndim != 1 or len(times) < 2 or not np.isfinite(times).all() or not (np.diff(times) > 0).all():
        raise SimulationError("times of a simulation must be at least two finite numbers that increase")
    times.setflags(write=False)
    return times
