"""A robot compiled for the kernels: one flat record of numbers, in mm, s, g, µN and rad.

The record is all that the kernels see: the nominal robot, and the terms that effects have added. A batch is an array
of records; a fit fills records again and again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.dynamics.terms import FRICTION, UN_PER_MN, Term
from simulator.effects import free_form
from simulator.effects.catalogue import EFFECTS, effect_values, faults_of_effects
from simulator.effects.draft import Draft
from simulator.effects.entry import EffectEntry
from simulator.errors import SimulationError
from simulator.robot import Robot
from simulator.slip.law import REST_SPEED_MM_S

MOST_TERMS = 40

# Numbers of a record, and how many of each.
NUMBERS = {
    "mass": 1,
    "inertia": 1,  # yaw, about the robot's centre
    "inverse_mass": 9,  # (3, 3), of (u, v, r), with the centre of gravity where it is
    "gravity_x": 1,  # centre of gravity in the body frame
    "gravity_y": 1,
    "wheel_x": 4,
    "wheel_y": 4,
    "grip_x": 4,  # mu0_x·f_z
    "grip_y": 4,
    "steep_x": 4,  # K_y/(mu0_x·f_z), the b of Eq. (6)
    "steep_y": 4,
    "ratio": 1,  # K_x/K_y
    "shape_x": 1,
    "shape_y": 1,
    "decrease": 1,  # K_mu
    "rest_speed": 1,
    "speed": 2,  # surface speed per rpm, left and right
    "dead_band": 1,  # rpm
    "dead_time": 1,
    "lag": 1,
    "droop": 1,  # loss of surface speed per µN of driving force
    "compliance": 1,  # rad per µN
    "steer": 4,
    "stiffness_follows_load": 1,  # 1 or 0
}
SHAPES: dict[str, int | tuple[int, int]] = {**NUMBERS, "inverse_mass": (3, 3)}
MODEL = np.dtype(
    [
        *((name, float) if shape == 1 else (name, float, shape) for name, shape in SHAPES.items()),
        ("general", np.int64),  # 0: friction of the wheels is nominal
        ("wheels_feel", np.int64),  # 1: what terms change about a wheel depends on the velocity
        ("body_feels", np.int64),  # 1: forces of terms on the body do
        ("varies", np.int64),  # 1: forces change along a steady turn
        ("wheels_vary", np.int64),  # 1: friction does
        ("body_terms", np.int64),  # the first so many terms act on the body, the next on the wheels
        ("wheel_terms", np.int64),
        ("channel", np.int64, MOST_TERMS),
        ("basis", np.int64, MOST_TERMS),
        ("coefficient", float, MOST_TERMS),
        ("point_x", float, MOST_TERMS),
        ("point_y", float, MOST_TERMS),
        ("falloff", float, MOST_TERMS),
        ("pattern", float, (MOST_TERMS, 4)),
    ],
    align=True,
)


def record_of(draft: Draft, rest_speed_mm_s: float = REST_SPEED_MM_S) -> NDArray[np.void]:
    """The robot of a draft compiled for the kernels, shape (1,) of dtype MODEL.

    Raises SimulationError where a wheel is left without load or friction, or where more terms act than fit.
    """
    draft.finish()
    model = np.zeros(1, MODEL)
    row: Any = model[0]
    numbers = _numbers_of_body(draft) | _numbers_of_wheels(draft) | _numbers_of_motors(draft)
    numbers["rest_speed"] = (rest_speed_mm_s,)
    flat = [number for name in NUMBERS for number in numbers[name]]
    model.view(np.float64)[: len(flat)] = flat  # one assignment: a fit fills records by the thousand
    _fill_terms(row, draft.terms)
    if draft.compliance_rad_per_mN != 0:  # axles give way to what the body presses them with
        row["wheels_vary"] = row["varies"]
    changed = draft.droop_rpm_per_uN_mm or draft.compliance_rad_per_mN or draft.toe_rad.any()
    row["general"] = bool(row["wheel_terms"] or changed)
    return model


def apply_effects(draft: Draft, entries: Sequence[EffectEntry]) -> None:
    """Let the effects of a robot act on its draft. Raises SimulationError for faulty entries."""
    if faults := faults_of_effects(entries):
        raise SimulationError(f"{draft.robot.name}: {'; '.join(faults)}")
    for entry in entries:
        if entry.id == free_form.ID:
            term = free_form.term_of(entry.given)
            if not term.is_seen_only:
                draft.add(term)
        elif act := EFFECTS[entry.id].act:
            act(draft, effect_values(entry))


def compile_robot(
    robot: Robot, run_index: int = 0, extra: Sequence[Term] = (), rest_speed_mm_s: float = REST_SPEED_MM_S
) -> NDArray[np.void]:
    """The record of a robot with its effects, shape (1,) of dtype MODEL.

    run_index: number of the run within its session, from 0; extra: further terms of the grammar, for physics without
    a name. Raises SimulationError for effects that the catalogue does not know or that cannot act on this robot.
    """
    draft = Draft(robot, run_index)
    apply_effects(draft, robot.effect)
    draft.add(*extra)
    return record_of(draft, rest_speed_mm_s)


def _numbers_of_body(draft: Draft) -> dict[str, Sequence[float]]:
    robot = draft.robot
    mass, inertia, (x, y) = robot.body.mass_g, robot.yaw_inertia_g_mm2, draft.gravity_mm
    # The stated yaw inertia is about the centre of gravity's nominal place; an offset adds m·d² (parallel axes). The
    # mass matrix [[m, 0, -m·y], [0, m, m·x], [-m·y, m·x, inertia + m·d²]] has its inverse in closed form.
    return {
        "mass": (mass,),
        "inertia": (inertia + mass * (x * x + y * y),),
        "inverse_mass": (
            *(1 / mass + y * y / inertia, -x * y / inertia, y / inertia),
            *(-x * y / inertia, 1 / mass + x * x / inertia, -x / inertia),
            *(y / inertia, -x / inertia, 1 / inertia),
        ),
        "gravity_x": (x,),
        "gravity_y": (y,),
    }


def _numbers_of_wheels(draft: Draft) -> dict[str, Sequence[float]]:
    robot, slip = draft.robot, draft.robot.slip
    weights, loads = (values.tolist() for values in draft.loads_uN())
    frictions = draft.friction_factor.tolist()
    if not min(loads) > 0 or not min(frictions) > 0:
        raise SimulationError(f"{robot.name}: every wheel needs a positive load and friction; loads are {loads} µN")
    x, y = robot.wheels.wheelbase_mm / 2, robot.wheels.track_mm / 2
    follows = slip.stiffness_basis == "load"
    stiffness = [slip.lateral_stiffness * value for value in (loads if follows else weights)]
    grip_x, grip_y = (
        [level * friction * load for friction, load in zip(frictions, loads, strict=True)]
        for level in (slip.longitudinal_friction, slip.lateral_friction)
    )
    return {
        "wheel_x": (x, x, -x, -x),
        "wheel_y": (y, -y, y, -y),
        "grip_x": grip_x,
        "grip_y": grip_y,
        "steep_x": [stiff / grip for stiff, grip in zip(stiffness, grip_x, strict=True)],
        "steep_y": [stiff / grip for stiff, grip in zip(stiffness, grip_y, strict=True)],
        "ratio": (slip.longitudinal_stiffness / slip.lateral_stiffness,),
        "shape_x": (slip.longitudinal_shape,),
        "shape_y": (slip.lateral_shape,),
        "decrease": (slip.friction_decrease,),
        "stiffness_follows_load": (float(follows),),
    }


def _numbers_of_motors(draft: Draft) -> dict[str, Sequence[float]]:
    per_rpm = 2 * math.pi * draft.robot.wheels.radius_mm / 60
    return {
        "speed": [per_rpm * factor for factor in draft.speed_factor.tolist()],
        "dead_band": (draft.dead_band_rpm,),
        "dead_time": (draft.dead_time_s,),
        "lag": (draft.lag_s,),
        "droop": (per_rpm * draft.droop_rpm_per_uN_mm * draft.robot.wheels.radius_mm,),
        "compliance": (draft.compliance_rad_per_mN / UN_PER_MN,),
        "steer": draft.toe_rad.tolist(),
    }


def _fill_terms(row: Any, terms: list[Term]) -> None:
    if not terms:
        return
    # Friction comes last: where it depends on the direction of sliding, speed and toe must be known.
    ordered = sorted(terms, key=lambda term: (term.acts_on_wheels, term.channel == FRICTION))
    count = len(ordered)
    if count > MOST_TERMS:
        raise SimulationError(f"{count} terms of added physics; at most {MOST_TERMS} act at once")
    on_wheels = [term for term in ordered if term.acts_on_wheels]
    on_body = ordered[: count - len(on_wheels)]
    row["body_terms"], row["wheel_terms"] = len(on_body), len(on_wheels)
    row["body_feels"] = any(term.depends_on_velocity for term in on_body)
    row["wheels_feel"] = any(term.depends_on_velocity for term in on_wheels)
    row["wheels_vary"] = any(term.varies for term in on_wheels)
    row["varies"] = row["wheels_vary"] or any(term.varies for term in on_body)
    row["channel"][:count] = [term.channel for term in ordered]
    row["basis"][:count] = [term.basis for term in ordered]
    row["coefficient"][:count] = [term.coefficient for term in ordered]
    row["point_x"][:count], row["point_y"][:count] = zip(*(term.point_mm for term in ordered), strict=True)
    row["falloff"][:count] = [term.falloff for term in ordered]
    row["pattern"][:count] = [term.pattern for term in ordered]
