"""The velocity at which all forces balance: a steady turn."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from simulator.compiled import compiled
from simulator.dynamics import accelerations
from simulator.errors import SimulationError
from simulator.model import compile_robot
from simulator.robot import Robot
from simulator.rosenbrock import invert3
from simulator.run import WheelStates
from simulator.wheels import wheel_states

# Where Newton starts: yaw rate as a share of that without slip, and how far ahead of the centre the robot pivots as a
# share of half the wheelbase. The first suits rear wheels that grip, the others rear wheels that slip (sharp turns).
STARTS = ((0.3, 0.0), (0.9, 0.9), (0.9, 0.0), (0.1, 0.5))


@dataclass(frozen=True)
class SteadyTurn:
    """A steady turn; curvature_per_mm is positive counter-clockwise driving forward, 0 on a straight line.

    radius_mm: signed radius of the circle of the robot's centre, 1/curvature_per_mm; infinite on a straight line.
    stable: whether a small disturbance dies out. wheels: arrays of (4,), in the order of WHEELS.
    """

    u_mm_s: float
    v_mm_s: float
    yaw_rate_rad_s: float
    curvature_per_mm: float
    stable: bool
    wheels: WheelStates

    @property
    def speed_mm_s(self) -> float:
        """Speed of the robot's centre."""
        return float(np.hypot(self.u_mm_s, self.v_mm_s))

    @property
    def radius_mm(self) -> float:
        """Signed radius of the circle of the robot's centre."""
        return 1 / self.curvature_per_mm if self.curvature_per_mm else float("inf")


def steady_turn(robot: Robot, left_rpm: float, right_rpm: float) -> SteadyTurn:
    """Solve the force balance at constant commands. Raises SimulationError where no balance is found.

    Forces that vary with place, heading or time are taken at the origin of the plate, heading 0, time 0.
    """
    model: Any = compile_robot(robot)[0]
    velocity, derivative = np.zeros(3), np.zeros((3, 3))
    if not any(_solved_from(start, model, left_rpm, right_rpm, velocity, derivative, robot) for start in STARTS):
        raise SimulationError(f"no steady turn found at {left_rpm} / {right_rpm} rpm")
    u, v, r = (float(value) for value in velocity)
    curvature = float((1.0 if u >= 0 else -1.0) * r / np.hypot(u, v)) if u or v else float("nan")
    knots = np.array([[0.0, left_rpm, right_rpm]])
    wheels = wheel_states(model, knots, np.array([0.0, 1.0]), np.tile([0.0, 0.0, 0.0, u, v, r], (2, 1)))
    first = WheelStates(*(getattr(wheels, item.name)[0] for item in fields(wheels)))
    return SteadyTurn(u, v, r, curvature, bool(np.linalg.eigvals(derivative).real.max() < 0), first)


def _solved_from(
    start: tuple[float, float], model: Any, left: float, right: float, velocity: Any, derivative: Any, robot: Robot
) -> bool:
    """Whether Newton's method finds the balance from a start of STARTS; the root into velocity (3)."""
    yaw_share, pivot_share = start
    per_rpm = 2 * np.pi * robot.wheels.radius_mm / 60
    yaw_rate = yaw_share * per_rpm * (right - left) / robot.wheels.track_mm
    velocity[:] = per_rpm * (left + right) / 2, -pivot_share * yaw_rate * robot.wheels.wheelbase_mm / 2, yaw_rate
    return bool(solve_balance(model, left, right, velocity, derivative))


@compiled()
def balance(model: Any, left: float, right: float, velocity: Any, out: Any) -> None:
    """Accelerations at rest at the origin of the plate into out (3)."""
    u, v, r = velocity[0], velocity[1], velocity[2]
    out[0], out[1], out[2] = accelerations(u, v, r, left, right, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, model)


@compiled()
def solve_balance(model: Any, left: float, right: float, velocity: Any, derivative: Any) -> bool:
    """Newton's method with backtracking from the velocity (3) handed in, which becomes the root."""
    size = model.speed[0] * max(abs(left), abs(right), 1e-6)
    inverse, residual, trial, shifted = np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(3)
    balance(model, left, right, velocity, residual)
    for _ in range(200):
        for column in range(3):
            shifted[:] = velocity
            shifted[column] += 1e-8
            balance(model, left, right, shifted, trial)
            for row in range(3):
                derivative[row, column] = (trial[row] - residual[row]) / 1e-8
        if not invert3(derivative, inverse):
            return False
        step = -inverse @ residual
        if np.abs(step).max() < 1e-12 * size:
            return True
        before, share = np.sqrt((residual**2).sum()), 1.0
        while True:
            shifted[:] = velocity + share * step
            balance(model, left, right, shifted, trial)
            if np.sqrt((trial**2).sum()) < before or share < 1e-6:
                break
            share /= 2
        if share < 1e-6:
            return bool(np.abs(step).max() < 1e-9 * size)
        velocity[:] = shifted
        residual[:] = trial
    return False
