"""Viscous creep coefficients with which another simulator reproduces a steady turn.

MuJoCo has no slip curve: a contact creeps in proportion to its force, until it slides. For one steady turn this is
exact: each wheel gets the longitudinal and lateral coefficients at which creep gives the forces of the slip law at the
slip of that turn. The turn then has the same radius in both simulators. Wheel frame: along, across.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simulator.dynamics.terms import UN_PER_MN
from simulator.effects.draft import Draft
from simulator.errors import SimulationError
from simulator.nominal_robot import Wheel
from simulator.robot import Robot
from simulator.steady import SteadyTurn, steady_turn

MN_PER_N = 1e3
RAD_S_PER_RPM = 2 * np.pi / 60


@dataclass(frozen=True)
class Contact:
    """A wheel on the plate in the turn: load and attraction, N; rpm: its command, None where it rolls freely.

    force: of friction along and across, N; creep: of the contact over the plate, mm/s; both (along, across).
    """

    wheel: Wheel
    load_N: float
    attraction_N: float
    force_N: tuple[float, float]
    creep_mm_s: tuple[float, float]
    rpm: float | None


def contacts_in_turn(robot: Robot, left_rpm: float, right_rpm: float) -> tuple[SteadyTurn, tuple[Contact, ...]]:
    """The steady turn at a command, and every wheel's contact in it.

    Raises SimulationError for a robot with effects, which other simulators do not have, and if it does not settle.
    """
    if robot.effect:
        names = ", ".join(entry.id for entry in robot.effect)
        raise SimulationError(f"{robot.name}: other simulators lack {names}; export the robot without effects")
    turn, (_, loads) = steady_turn(robot, left_rpm, right_rpm), Draft(robot).loads_uN()
    rpm = {"left": left_rpm, "right": right_rpm}
    contacts = []
    for number, (wheel, load_uN) in enumerate(zip(robot.all_wheels, loads.tolist(), strict=True)):
        command = rpm.get(wheel.driven_by)
        along = turn.u_mm_s - turn.yaw_rate_rad_s * wheel.y_mm
        across = turn.v_mm_s + turn.yaw_rate_rad_s * wheel.x_mm
        surface = along if command is None else command * RAD_S_PER_RPM * wheel.radius_mm
        force_mN = turn.wheels.longitudinal_force_mN[number], turn.wheels.lateral_force_mN[number]
        contacts.append(
            Contact(
                wheel,
                load_uN / UN_PER_MN / MN_PER_N,
                wheel.attraction_mN / MN_PER_N,
                (float(force_mN[0]) / MN_PER_N, float(force_mN[1]) / MN_PER_N),
                (along - surface, across),
                command,
            )
        )
    return turn, tuple(contacts)
