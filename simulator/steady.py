"""Steady turns: velocities at which all forces balance, for one command or a grid of commands."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simulator.dynamics.model import compile_robot
from simulator.dynamics.motors import held_drive
from simulator.dynamics.scale import state_units
from simulator.errors import SimulationError
from simulator.integrator.balance import newton
from simulator.integrator.batch import TOLERANCE_MM, integrate_one
from simulator.integrator.run_kernel import DONE, MOST_STEPS
from simulator.integrator.stability import is_stable
from simulator.robot import Robot
from simulator.run import WheelStates
from simulator.wheel_states import wheel_states

Array = NDArray[np.float64]
# Initial values of Newton's method. Forward speed: shares of the surface speeds left and right (if they are opposite,
# the robot may follow either). Yaw rate: share of that without slip. Pivot: distance ahead of the centre over half the
# wheelbase.
FORWARD = [(0.5, 0.5), (0.25, 0.25), (0.0, 0.0), (-0.25, -0.25), (0.95, 0.0), (0.0, 0.95)]
STARTS = [(u, r, p) for u in FORWARD for r in (0.9, 0.5, 0.3, 0.1, 0.0, -0.3) for p in (0.0, 0.5, 0.9)]
# For the paper's robot: relaxation takes milliseconds, from near standstill tenths of a second.
SETTLING_S = np.array([0.0, 2.0])
SAME = 1e-6  # equilibria closer than this share of the largest surface speed are one


@dataclass(frozen=True, repr=False)
class SteadyTurn:
    """A steady turn; curvature_per_mm is positive for a centre to the robot's left, 0 on a straight line.

    radius_mm: signed radius of the circle of the robot's centre, 1/curvature_per_mm; infinite on a straight line.
    stable: whether a small disturbance dies out. wheels: arrays of (w,), in the order of the robot's wheels.
    """

    u_mm_s: float
    v_mm_s: float
    yaw_rate_rad_s: float
    curvature_per_mm: float
    stable: bool
    wheels: WheelStates

    def __repr__(self) -> str:
        """One line: signed radius, speed and yaw rate."""
        unstable = "" if self.stable else ", unstable"
        return (
            f"SteadyTurn(radius {self.radius_mm:.4g} mm, {self.speed_mm_s:.4g} mm/s, "
            f"{np.degrees(self.yaw_rate_rad_s):.4g} deg/s{unstable})"
        )

    @property
    def speed_mm_s(self) -> float:
        """Speed of the robot's centre."""
        return float(np.hypot(self.u_mm_s, self.v_mm_s))

    @property
    def radius_mm(self) -> float:
        """Signed radius of the circle of the robot's centre."""
        return 1 / self.curvature_per_mm if self.curvature_per_mm else float("inf")


@dataclass(frozen=True)
class SteadyMap:
    """Steady turns over left rpm (n,) and ratio right/left (m,); arrays (n, m), NaN if the robot does not settle."""

    left_rpm: Array
    ratio: Array
    u_mm_s: Array
    v_mm_s: Array
    yaw_rate_rad_s: Array
    curvature_per_mm: Array


def steady_turn(robot: Robot, left_rpm: float, right_rpm: float) -> SteadyTurn:
    """The turn on which the robot settles from rest at constant commands; else an unstable equilibrium (stable: False).

    Forces that vary with position, heading or time are evaluated at the origin of the plate, heading 0, time 0. With
    wheels that turn against each other, the tire robot has two stable turns, and an arbitrarily small disturbance at
    rest decides between them; steady_turns gives both. Raises SimulationError if no equilibrium is found.
    """
    models: Any = _frozen(robot)
    velocity, linear = np.zeros(3), np.zeros((4, 3))
    if settled(models[0], left_rpm, right_rpm, velocity, linear):
        return _turn(models[0], left_rpm, right_rpm, velocity, linear)
    found = steady_turns(robot, left_rpm, right_rpm)
    if not found:
        raise SimulationError(f"no steady turn found at {left_rpm} / {right_rpm} rpm")
    return min(found, key=lambda turn: not turn.stable)


def steady_turns(robot: Robot, left_rpm: float, right_rpm: float) -> list[SteadyTurn]:
    """All equilibria found, stable or not, by yaw rate: the one reached from rest, and those of Newton's method."""
    models: Any = _frozen(robot)
    units, linear = _units(models[0]), np.zeros((4, 3))
    per_rpm = float(models[0]["speed"].mean()) * units[0] * float(models[0]["time_unit"])
    largest = per_rpm * max(abs(left_rpm), abs(right_rpm), 1e-6)
    length, width = robot.extent_mm
    found: list[tuple[Array, SteadyTurn]] = []
    rested = np.zeros(3)
    if settled(models[0], left_rpm, right_rpm, rested, linear):
        found.append((rested, _turn(models[0], left_rpm, right_rpm, rested, linear)))
    for forward, yaw_share, ahead in STARTS:
        yaw_rate = yaw_share * per_rpm * (right_rpm - left_rpm) / width
        sideways = -ahead * yaw_rate * length / 2
        velocity = np.array([per_rpm * (forward[0] * left_rpm + forward[1] * right_rpm), sideways, yaw_rate])
        if balanced(models[0], left_rpm, right_rpm, velocity, linear):
            distances = [np.abs(velocity - known).max() for known, _ in found]
            if min(distances, default=np.inf) > SAME * largest:
                found.append((velocity, _turn(models[0], left_rpm, right_rpm, velocity, linear)))
    return [turn for _, turn in sorted(found, key=lambda pair: float(pair[0][2]))]


def steady_map(robot: Robot, left_rpm: ArrayLike, ratios: ArrayLike) -> SteadyMap:
    """Steady turns for left rpm (n,) and ratios right/left (m,); negative ratios set the wheels against each other.

    Sort the ratios: each turn starts from its neighbour; if that fails, the robot starts from rest.
    """
    left, ratio = np.atleast_1d(np.asarray(left_rpm, dtype=float)), np.atleast_1d(np.asarray(ratios, dtype=float))
    found, model = np.full((len(left), len(ratio), 3), np.nan), _frozen(robot)[0]
    linear = np.zeros((4, 3))
    for row, rpm in enumerate(left):
        velocity, known = np.zeros(3), False
        for column, right in enumerate(ratio * rpm):
            known = known and balanced(model, rpm, right, velocity, linear) and bool(is_stable(linear))
            known = known or settled(model, rpm, right, velocity, linear)
            if known:
                found[row, column] = velocity
    u, v, yaw_rate = np.moveaxis(found, -1, 0)
    return SteadyMap(left, ratio, u, v, yaw_rate, _curvature(u, v, yaw_rate))


def settled(model: Any, left: float, right: float, velocity: Array, linear: Array) -> bool:
    """Simulate from rest and refine the final velocity (3) with Newton's method; False if the robot does not settle.

    model: a record whose varies is 0; linear: (4, 3), receives the derivative by velocity in rows 1 to 3, in the units
    of the kernels.
    """
    state, out = np.zeros(6), np.empty((2, 6))
    knots = np.array([[0.0, left, right]])
    settling_s = SETTLING_S * float(model["time_unit"])
    done, _, _ = integrate_one(model, knots, state, settling_s, out, TOLERANCE_MM, MOST_STEPS)
    velocity[:] = state[3:]
    return bool(done == DONE and balanced(model, left, right, velocity, linear) and is_stable(linear))


def balanced(model: Any, left: float, right: float, velocity: Array, linear: Array) -> bool:
    """Newton's method from the velocity (3), mm/s and rad/s; if it returns True, velocity is the equilibrium."""
    units, time = _units(model), float(model["time_unit"])
    velocity /= units
    turning = held_drive(left * time, right * time, model)
    found = bool(newton(model, *turning, velocity, linear))
    velocity *= units
    return found


def _units(model: Any) -> Array:
    """Units of a velocity (3,) of the kernels, in mm/s and rad/s."""
    return state_units(float(model["time_unit"]))[3:]


def _frozen(robot: Robot) -> NDArray[np.void]:
    """The record of a robot with varying forces fixed at their values at the origin."""
    models = compile_robot(robot)
    models["varies"] = 0
    return models


def _curvature(u: Array, v: Array, yaw_rate: Array) -> Array:
    """Curvature of the centre's path, positive for a centre to the robot's left; NaN at rest."""
    speed = np.hypot(u, v)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(speed > 0, np.where(u < 0, -1.0, 1.0) * yaw_rate / speed, np.nan)


def _turn(model: Any, left: float, right: float, velocity: Array, linear: Array) -> SteadyTurn:
    u, v, r = (float(value) for value in velocity)
    curvature = float(_curvature(velocity[:1], velocity[1:2], velocity[2:])[0])
    knots = np.array([[0.0, left, right]])
    wheels = wheel_states(model, knots, np.array([0.0, 1.0]), np.tile([0.0, 0.0, 0.0, u, v, r], (2, 1)))
    first = WheelStates(*(getattr(wheels, item.name)[0] for item in fields(wheels)))
    return SteadyTurn(u, v, r, curvature, bool(np.linalg.eigvals(linear[1:4]).real.max() < 0), first)
