"""A robot compiled for the kernels: one flat record of numbers, in mm, s, g, µN and rad.

The record is all that the kernels see: the nominal robot, and the terms that effects have added. A batch is an array
of records; a fit fills records again and again.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import repeat
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.dynamics.record import EMPTY, LAW, MOST_TERMS, NUMBERS, WHEELS
from simulator.dynamics.scale import POINT_DEPTH_MM, most_slots, scaled_coefficient
from simulator.dynamics.terms import FRICTION, UN_PER_MN, Term, pattern_weights
from simulator.effects import free_form
from simulator.effects.catalogue import EFFECTS, effect_values, faults_of_effects
from simulator.effects.draft import Draft
from simulator.effects.entry import EffectEntry
from simulator.errors import SimulationError
from simulator.nominal_robot import NominalRobot, Slip, Wheel
from simulator.robot import Robot
from simulator.slip.law import REST_SPEED_MM_S

NO_AXLE = 2  # 0: the front axle, 1: the rear axle
# Numbers of LAW for a wheel without friction.
NO_FRICTION = (0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 1.0)


def room_for(robots: Iterable[NominalRobot]) -> int:
    """Slots of a record in which each of the robots fits."""
    return most_slots([len(robot.wheel_names) for robot in robots])


def record_of(draft: Draft, rest_speed_mm_s: float = REST_SPEED_MM_S, slots: int | None = None) -> NDArray[np.void]:
    """The robot of a draft compiled for the kernels, shape (1,) of dtype model_type(slots).

    rest_speed_mm_s: for a robot of the paper's size, see simulator.dynamics.scale; slots: number of wheels the record
    has room for, so that robots with different numbers of wheels fit in one batch. Raises SimulationError if no forces
    on the wheels can balance the weight, if a wheel has no friction, or if there are more than MOST_TERMS terms.
    """
    draft.finish()
    layout, unit = draft.layout, draft.layout.time_unit_s
    slots = slots or most_slots([len(layout.wheels)])
    empty = slots - len(layout.wheels)
    model = layout.record(slots)
    row: Any = model[0]
    numbers = _numbers_of_body(draft, unit) | _numbers_of_wheels(draft) | _numbers_of_motors(draft, unit)
    numbers["rest_speed"] = (rest_speed_mm_s,)
    flat: list[float] = []
    for name, count in NUMBERS.items():
        flat += numbers[name]
        if count == WHEELS and empty:
            flat += [EMPTY.get(name, 0.0)] * empty
    model.view(np.float64)[: len(flat)] = flat  # one assignment: a fit fills records by the thousand
    _fill_terms(row, draft, unit)
    if draft.compliance_rad_per_mN != 0:  # axles turn under the forces on the body, which may vary
        _fill_axles(row, draft, unit)
        row["wheels_vary"] = row["varies"]
    changed = draft.droop_rpm_per_uN_mm or draft.compliance_rad_per_mN or draft.toe_rad.any()
    row["general"] = bool(row["wheel_terms"] or changed)
    return model


def apply_effects(draft: Draft, entries: Sequence[EffectEntry]) -> None:
    """Apply the effects of a robot to its draft. Raises SimulationError for faulty entries."""
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
    robot: Robot,
    run_index: int = 0,
    extra: Sequence[Term] = (),
    rest_speed_mm_s: float = REST_SPEED_MM_S,
    slots: int | None = None,
) -> NDArray[np.void]:
    """The record of a robot with its effects, shape (1,); see record_of.

    run_index: number of the run within its session, from 0; extra: further terms, for physics that is not in the
    catalogue. Raises SimulationError for effects that the catalogue does not know or that cannot act on this robot.
    """
    draft = Draft(robot, run_index)
    apply_effects(draft, robot.effect)
    draft.add(*extra)
    return record_of(draft, rest_speed_mm_s, slots)


def lifted_wheels(robot: Robot) -> tuple[str, ...]:
    """Names of the wheels that carry no load; raises SimulationError where the robot would tip.

    Casters and balls do not count: of two, one is lifted, and weight above an axle needs none.
    """
    draft = Draft(robot)
    apply_effects(draft, robot.effect)
    draft.finish()
    _, loads = draft.loads_uN()
    supports = zip(robot.wheel_names, robot.all_wheels, loads, strict=True)
    return tuple(name for name, wheel, load in supports if load == 0 and wheel.grips)


def _numbers_of_body(draft: Draft, unit: float) -> dict[str, Sequence[float]]:
    robot, length = draft.robot, unit * unit
    mass, inertia = robot.body.mass_g, robot.yaw_inertia_g_mm2 / (length * length)
    x, y = draft.gravity_mm[0] / length, draft.gravity_mm[1] / length
    # The stated yaw inertia is about the centre of gravity; about the robot's centre it is more by m·d² (parallel
    # axes). The mass matrix [[m, 0, -m·y], [0, m, m·x], [-m·y, m·x, inertia + m·d²]] has its inverse in closed form.
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
    robot = draft.robot
    weights, loads = (values.tolist() for values in draft.loads_uN())
    frictions = draft.friction_factor.tolist()
    if not min(frictions) > 0:
        raise SimulationError(f"{robot.name}: every wheel needs a positive friction; the factors are {frictions}")
    across = [draft.across_factor * friction for friction in frictions]
    rows = map(_friction_of, draft.layout.wheels, repeat(robot.slip), weights, loads, frictions, across)
    numbers: dict[str, Sequence[float]] = dict(zip(LAW, zip(*rows, strict=True), strict=True))
    numbers["steer"] = draft.toe_rad.tolist()
    return numbers


def _friction_of(
    wheel: Wheel, common: Slip, weight: float, load: float, along: float, across: float
) -> tuple[float, ...]:
    """Numbers of the slip law of one wheel, by the names of LAW.

    weight and load in µN; along, across: factors of its coefficients of friction.
    """
    slip = wheel.slip or common
    if load <= 0 or wheel.support != "wheel":
        return NO_FRICTION
    follows = slip.stiffness_basis == "load"
    stiffness = slip.lateral_stiffness * (load if follows else max(weight, 0.0))
    grip_x, grip_y = slip.longitudinal_friction * along * load, slip.lateral_friction * across * load
    return (
        grip_x,
        grip_y,
        stiffness / grip_x,
        stiffness / grip_y,
        slip.longitudinal_stiffness / slip.lateral_stiffness,
        slip.longitudinal_shape,
        slip.lateral_shape,
        slip.friction_decrease,
        follows,
    )


def _numbers_of_motors(draft: Draft, unit: float) -> dict[str, Sequence[float]]:
    """Numbers of the motors; commands are in revolutions per minute of the kernels' time unit (dynamics.scale)."""
    left, right = draft.speed_factor.tolist()
    droop, turning = draft.droop_rpm_per_uN_mm / unit, draft.layout.turning
    by_left = [per_rpm * left if on else 0.0 for per_rpm, on, _, _ in turning]
    by_right = [per_rpm * right if on else 0.0 for per_rpm, _, on, _ in turning]
    return {
        "speed": (max(by_left), max(by_right)),
        "by_left": by_left,
        "by_right": by_right,
        "droop": [per_rpm * droop * moment_arm for per_rpm, _, _, moment_arm in turning],
        "dead_band": (draft.dead_band_rpm * unit,),
        "dead_time": (draft.dead_time_s / unit,),
        "lag": (draft.lag_s / unit,),
        "compliance": (draft.compliance_rad_per_mN / UN_PER_MN,),
        "mix": draft.mix.ravel().tolist(),
        "sliding": (draft.sliding_share,),
        "limits": [limit * unit for limit in draft.limits_rpm],
        "ramps": [ramp / unit**2 for ramp in draft.ramps_s_per_rpm],
    }


def _fill_axles(row: Any, draft: Draft, unit: float) -> None:
    """Assign wheels to axles: those with equal x share one. Raises SimulationError unless there are two axles."""
    places = sorted({wheel.x_mm for wheel in draft.layout.wheels if wheel.grips}, reverse=True)
    if len(places) != 2:
        raise SimulationError(
            f"{draft.robot.name}: axle-compliance needs two axles; found wheels at {len(places)} positions of x"
        )
    row["axle"] = NO_AXLE
    for number, wheel in enumerate(draft.layout.wheels):
        if wheel.grips:
            row["axle"][number] = places.index(wheel.x_mm)
    row["axle_x"] = [place / (unit * unit) for place in places]


def _fill_terms(row: Any, draft: Draft, unit: float) -> None:
    terms, wheels = draft.terms, draft.layout.wheels
    if not terms:
        return
    # Friction comes last: its terms may depend on the direction of sliding, which needs speed and toe.
    ordered = sorted(terms, key=lambda term: (term.acts_on_wheels, term.channel == FRICTION))
    count = len(ordered)
    if count > MOST_TERMS:
        raise SimulationError(f"{count} terms of effects; at most {MOST_TERMS} are possible")
    on_wheels = [term for term in ordered if term.acts_on_wheels]
    on_body = ordered[: count - len(on_wheels)]
    row["body_terms"], row["wheel_terms"] = len(on_body), len(on_wheels)
    row["body_varies_with_velocity"] = any(term.depends_on_velocity for term in on_body)
    row["wheels_vary_with_velocity"] = any(term.depends_on_velocity for term in on_wheels)
    row["wheels_vary"] = any(term.varies for term in on_wheels)
    row["varies"] = row["wheels_vary"] or any(term.varies for term in on_body)
    row["channel"][:count] = [term.channel for term in ordered]
    row["basis"][:count] = [term.basis for term in ordered]
    row["coefficient"][:count] = [scaled_coefficient(term, unit) for term in ordered]
    points = np.array([term.point_mm for term in ordered]) / (unit * unit)
    row["point_x"][:count], row["point_y"][:count] = points.T
    row["falloff"][:count] = [term.falloff for term in ordered]
    row["point_depth"] = POINT_DEPTH_MM / (unit * unit)
    grips = np.array([wheel.grips for wheel in wheels])
    for number, term in enumerate(on_wheels, len(on_body)):
        row["pattern"][number, : len(wheels)] = grips * pattern_weights(term.pattern, wheels)
