"""Forces, contacts and marks of a robot with an effect at one instant, for laws that are checked on paper.

Units: mm, s, g, µN, rad, as in the kernels. Body frame: forward, to the left, counter-clockwise.
"""

from __future__ import annotations

import math

import numpy as np

from simulator.compilation import compiled
from simulator.dynamics.body import loads
from simulator.dynamics.contact import update_contacts
from simulator.dynamics.model import compile_robot
from simulator.dynamics.wheel import fresh_contacts
from simulator.effects.entry import EffectEntry
from simulator.observation import view_of
from simulator.robot import Robot, load_robot

Pose = tuple[float, float, float]  # x, y, heading
REST_SPEED = 1e-6  # far below the velocities of the tests


@compiled()
def _loads(u, v, r, place, rest, model):  # noqa: ANN001, ANN202
    return loads(u, v, r, place, rest, model)


@compiled()
def _touch(u, v, r, drive, place, rest, model, contacts):  # noqa: ANN001, ANN202
    update_contacts(u, v, r, drive, place, rest, model, contacts)


def affected(robot: Robot, id_: str, **values: object) -> Robot:
    """The robot with one more effect."""
    return robot.model_copy(update={"effect": (*robot.effect, EffectEntry.model_validate({"id": id_, **values}))})


def with_effects(robot: Robot | str, *effects: dict[str, object]) -> Robot:
    """A robot, or a shipped one by name, with these effects and no others."""
    robot = load_robot(robot) if isinstance(robot, str) else robot
    return robot.model_copy(update={"effect": tuple(EffectEntry.model_validate(item) for item in effects)})


def _place(pose: Pose) -> tuple[float, ...]:
    x, y, heading = pose
    return x, y, math.cos(heading), math.sin(heading), 1.0


def body_force(robot: Robot, pose: Pose = (0.0, 0.0, 0.0), velocity: Pose = (0.0, 0.0, 0.0)) -> np.ndarray:
    """Force forward, to the left (µN) and moment (µN·mm) on the body, the inertia of the turning frame among them."""
    return np.array(_loads(*velocity, _place(pose), REST_SPEED, compile_robot(robot)[0]))


def contacts(
    robot: Robot, pose: Pose = (0.0, 0.0, 0.0), velocity: Pose = (0.0, 0.0, 0.0), rpm: tuple[float, float] = (0.0, 0.0)
) -> np.ndarray:
    """Contacts (ROWS, 4) of the wheels, see simulator.dynamics.wheel."""
    found = fresh_contacts()
    _touch(*velocity, (*rpm, 0.0, 0.0), _place(pose), REST_SPEED, compile_robot(robot)[0], found)
    return found


def wheel_loads(robot: Robot) -> np.ndarray:
    """Load of each wheel, µN."""
    return compile_robot(robot)[0]["grip_y"] / robot.slip.lateral_friction


def marks(robot: Robot, pose: Pose) -> np.ndarray:
    """Measured green and yellow mark (2, 2) of a robot at a pose."""
    return np.array(view_of(robot).marks(*pose))


def turned(angle: float) -> np.ndarray:
    """Matrix that turns vectors counter-clockwise."""
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
