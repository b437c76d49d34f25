"""Viscous creep coefficients with which another simulator reproduces a steady turn.

MuJoCo has no slip curve: a contact creeps in proportion to its force, until it slides. For one steady turn this is
exact: each wheel gets the longitudinal and lateral coefficients at which creep gives the forces of the slip law at the
slip of that turn. The turn then has the same radius in both simulators. Wheel frame: along, across.

Effects that change only loads, friction and speeds of the wheels are in these numbers, exactly at that turn. Those with
other forces, or with wheels that turn about the vertical, cannot be exported.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from simulator.dynamics.model import apply_effects, record_of
from simulator.dynamics.motors import held_drive
from simulator.dynamics.terms import UN_PER_MN
from simulator.effects.draft import Draft
from simulator.effects.entry import EffectEntry
from simulator.errors import SimulationError
from simulator.nominal_robot import Wheel
from simulator.robot import Robot
from simulator.steady import steady_turn

MN_PER_N = 1e3
RAD_S_PER_RPM = 2 * np.pi / 60
SMALL_MM = 100.0  # extent from which a robot is described in metres, where solvers of other simulators are at home
LIMIT = 3.0  # friction limit of a contact over the robot's, so that it creeps and does not slide


def moments_g_mm2(robot: Robot) -> tuple[float, float]:
    """Moments of inertia about the vertical, and about the horizontal axes, which a planar model does not define.

    About the horizontal ones it is that of a box, and large enough for a real body of that moment about the vertical.
    """
    body, yaw = robot.body, robot.yaw_inertia_g_mm2
    box = body.mass_g * (max(body.length_mm, body.width_mm) ** 2 + body.height_mm**2) / 12
    return yaw, max(box, 0.51 * yaw)


@dataclass(frozen=True)
class Contact:
    """A wheel on the plate in the turn: load and attraction, N; rpm: its speed, None where it rolls freely.

    force: of friction along and across, N; creep: of the contact over the plate, mm/s; both (along, across).
    """

    wheel: Wheel
    load_N: float
    attraction_N: float
    force_N: tuple[float, float]
    creep_mm_s: tuple[float, float]
    rpm: float | None

    def friction(self, robot: Robot) -> float:
        """Coefficient of friction that the wheel at least has: that of its law, or more if an effect increases it."""
        slip = self.wheel.slip or robot.slip
        used = np.hypot(*self.force_N) / self.load_N if self.load_N > 0 else 0.0
        return max(slip.longitudinal_friction, slip.lateral_friction, float(used))


def contacts_in_turn(robot: Robot, left_rpm: float, right_rpm: float) -> tuple[Robot, tuple[Contact, ...]]:
    """The robot without effects, its weight where these move it, and every wheel's contact in the turn with them.

    Raises SimulationError for effects that other simulators do not have, and if the robot does not settle.
    """
    if beyond := [entry.id for entry in robot.effect if not _is_in_contacts(robot, entry)]:
        them = "it" if len(beyond) == 1 else "them"
        raise SimulationError(
            f"{robot.name}: other simulators lack {', '.join(beyond)}; export the robot without {them}"
        )
    turn, draft = steady_turn(robot, left_rpm, right_rpm), _draft(robot, robot.effect)
    _, loads = draft.loads_uN()
    rpm = _wheel_speeds_rpm(draft, left_rpm, right_rpm)
    contacts = []
    for number, (wheel, load_uN) in enumerate(zip(robot.all_wheels, loads.tolist(), strict=True)):
        speed = rpm.get(wheel.driven_by)
        along = turn.u_mm_s - turn.yaw_rate_rad_s * wheel.y_mm
        across = turn.v_mm_s + turn.yaw_rate_rad_s * wheel.x_mm
        surface = along if speed is None else speed * RAD_S_PER_RPM * wheel.radius_mm
        force_mN = turn.wheels.longitudinal_force_mN[number], turn.wheels.lateral_force_mN[number]
        contacts.append(
            Contact(
                wheel,
                load_uN / UN_PER_MN / MN_PER_N,
                wheel.attraction_mN * float(draft.attraction_factor[number]) / MN_PER_N,
                (float(force_mN[0]) / MN_PER_N, float(force_mN[1]) / MN_PER_N),
                (along - surface, across),
                speed,
            )
        )
    body = robot.body.model_copy(update={"center_of_gravity_mm": draft.gravity_mm})
    return robot.model_copy(update={"body": body, "effect": ()}), tuple(contacts)


def is_in_turn(robot: Robot, entry: EffectEntry) -> bool:
    """Whether an effect changes a steady turn: not one of the measurement, and no delay of the motors."""
    with_it, without = _draft(robot, [entry]), _draft(robot, ())
    names = ("attraction_factor", "friction_factor", "gravity_mm", "speed_factor", "mix", "limits_rpm")
    changed = any(np.not_equal(getattr(with_it, name), getattr(without, name)).any() for name in names)
    alone = (with_it.dead_band_rpm, with_it.sliding_share, with_it.across_factor - 1)
    return changed or any(alone) or not _is_in_contacts(robot, entry)


def _is_in_contacts(robot: Robot, entry: EffectEntry) -> bool:
    """Whether the forces of an effect are those between wheels and plate alone, without changes along a turn."""
    draft = _draft(robot, [entry])
    turned = draft.toe_rad.any() or draft.compliance_rad_per_mN
    return not (draft.terms or turned or draft.droop_rpm_per_uN_mm)


def _draft(robot: Robot, entries: Sequence[EffectEntry]) -> Draft:
    draft = Draft(robot)
    apply_effects(draft, entries)
    draft.finish()
    return draft


def _wheel_speeds_rpm(draft: Draft, left_rpm: float, right_rpm: float) -> dict[str, float]:
    """Speeds of the wheels of either side in the turn, after gains, mixing and limits of the drive."""
    model: Any = record_of(draft)[0]
    unit = float(model["time_unit"])
    held = held_drive(left_rpm * unit, right_rpm * unit, model)
    sides = zip(("left", "right"), held, draft.speed_factor.tolist(), strict=True)
    return {side: rpm / unit * factor for side, rpm, factor in sides}
