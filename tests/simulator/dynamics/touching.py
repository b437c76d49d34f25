"""A robot that touches the plate at an instant, by the kernels in plain Python."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from simulator.dynamics.model import compile_robot
from simulator.dynamics.terms import Term
from simulator.robot import Robot, load_robot
from tests.simulator.effect_probe import affected
from tests.simulator.plain import plain

REST = 1e-4
PER_RPM = 2 * math.pi * 0.5 / 60  # surface speed of a wheel of 0.5 mm, mm/s
Vector = tuple[float, float, float]
STILL = (0.0, 0.0, 0.0)
WHEEL_X, WHEEL_Y = np.array([2.0, 2.0, -2.0, -2.0]), np.array([2.0, -2.0, 2.0, -2.0])


def touched(
    robot: Robot,
    *added: Term,
    velocity: Vector = STILL,
    rpm: tuple[float, float] = (60.0, 60.0),
    turned: tuple[float, float] = (0.0, 0.0),
    pose: Vector = STILL,
    surface: float = 0.0,
) -> tuple[Any, Any]:
    """The record, and the contacts of a robot at an instant; surface: where the search of drooping speeds begins."""
    model, contacts = compile_robot(robot, extra=added)[0], np.zeros((plain("wheel").ROWS, 4))
    plain("wheel").reset_contacts(contacts)
    contacts[plain("wheel").SURFACE] = surface
    place = pose[0], pose[1], math.cos(pose[2]), math.sin(pose[2]), 1.0
    plain("contact").update_contacts(*velocity, (*rpm, *turned), place, REST, model, contacts)
    return model, contacts


def barrel(**slip: object) -> Robot:
    robot = load_robot("barrel")
    return robot.model_copy(update={"slip": robot.slip.model_copy(update=slip)})


def factors(robot: Robot, *added: Term) -> list[float]:
    """Factors of the first wheel's grip along and across and of its steepness along and across."""
    wheel = plain("wheel")
    contacts = touched(robot, *added)[1]
    return [float(contacts[row, 0]) for row in (wheel.GRIP_X, wheel.GRIP_Y, wheel.STEEP_X, wheel.STEEP_Y)]


POSE = (10.0, -20.0, math.radians(30.0))


def forces_of(model: Any, contacts: Any, velocity: Vector) -> np.ndarray:
    return np.array(plain("contact").friction(*velocity, contacts, REST, model))


EFFECTS: dict[str, dict[str, float]] = {
    "wheel-toe": {"left_deg": 4.0, "right_deg": -3.0},
    "motor-droop": {"rpm_per_uN_mm": 2e-3},
    "rolling-drag": {"coefficient": 0.05},
    "mass-offset": {"x_mm": 0.3, "y_mm": -0.2},
    "viscous-drag": {"force_mN_s_mm": 0.05, "moment_uN_mm_s": 3.0},
}
COMPLIANT: dict[str, dict[str, float]] = {**EFFECTS, "axle-compliance": {"deg_per_mN": 4.0}}
MOVING = [(1.2, 0.1, -0.3), (-0.8, -0.2, 0.25), (0.3, 0.4, 0.1)]


def with_all(effects: dict[str, dict[str, float]], robot: Robot | None = None) -> Robot:
    robot = robot or barrel()
    for id_, values in effects.items():
        robot = affected(robot, id_, **values)
    return robot
