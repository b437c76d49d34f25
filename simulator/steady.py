"""The velocity at which all forces balance: a steady turn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulator.dynamics import accelerations, jacobian, solve3
from simulator.errors import SimulationError
from simulator.model import compile_robot
from simulator.robot import Robot
from simulator.run import WheelStates
from simulator.wheels import wheel_states

# Where Newton starts: yaw rate as a share of that without slip, and how far ahead of the centre the robot pivots as a
# share of half the wheelbase. The first suits rear wheels that grip, the others rear wheels that slip (sharp turns).
STARTS = ((0.3, 0.0), (0.9, 0.9), (0.9, 0.0), (0.1, 0.5))


@dataclass(frozen=True)
class SteadyTurn:
    """A steady turn; curvature_per_mm is positive counter-clockwise driving forward, 0 on a straight line.

    radius_mm: signed radius of the circle of the robot's centre, 1/curvature_per_mm; infinite on a straight line.
    stable: whether a small disturbance dies out.
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
    """Solve the force balance at constant commands. Raises SimulationError where no balance is found."""
    model = compile_robot(robot)[0]
    per_rpm = 2 * np.pi * robot.wheels.radius_mm / 60
    left, right = left_rpm * per_rpm, right_rpm * per_rpm
    for yaw_share, pivot_share in STARTS:
        yaw_rate = yaw_share * (right - left) / robot.wheels.track_mm
        lateral = -pivot_share * yaw_rate * robot.wheels.wheelbase_mm / 2
        found = _balanced(model, np.array([(left + right) / 2, lateral, yaw_rate]), left, right)
        if found is not None:
            return _turn(model, *found, left, right)
    raise SimulationError(f"no steady turn found at {left_rpm} / {right_rpm} rpm")


def _balanced(
    model: np.void, velocity: NDArray[np.float64], left: float, right: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Velocity at which the forces balance and the derivative there, by damped Newton steps; None where they stall."""
    derivative = np.empty((3, 3))
    for _ in range(60):
        u, v, r = velocity
        residual = np.array(accelerations(u, v, r, left, right, model))
        jacobian(u, v, r, left, right, model, derivative)
        step = np.array(solve3(derivative, *-residual))
        share = 1.0
        while share > 1e-3:
            u, v, r = velocity + share * step
            trial = np.array(accelerations(u, v, r, left, right, model))
            if np.linalg.norm(trial) < np.linalg.norm(residual):
                break
            share /= 2
        velocity = velocity + share * step
        if np.abs(step).max() < 1e-11 * max(abs(left), abs(right), 1e-3):
            return velocity, derivative
    return None


def _turn(
    model: np.void, velocity: NDArray[np.float64], derivative: NDArray[np.float64], left: float, right: float
) -> SteadyTurn:
    u, v, r = (float(value) for value in velocity)
    direction = 1.0 if u >= 0 else -1.0
    wheels = wheel_states(model, velocity[None], np.array([[left, right]]))
    stable = bool(np.linalg.eigvals(derivative).real.max() < 0)
    return SteadyTurn(u, v, r, direction * r / np.hypot(u, v), stable, wheels)
