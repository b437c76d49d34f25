"""A robot compiled for the kernels: one flat record of numbers, in mm, s, g, µN and rad.

The record is all that the kernels see: the nominal robot, and the terms that effects have added. A batch is an array
of records; a fit fills records again and again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.errors import SimulationError
from simulator.robot import Robot
from simulator.slip.law import REST_SPEED_MM_S
from simulator.terms import FRICTION, Term

UN_PER_MN = 1000.0
MOST_TERMS = 40
Array = NDArray[np.float64]

MODEL = np.dtype(
    [
        ("mass", float),
        ("inertia", float),  # yaw, about the robot's centre
        ("inverse_mass", float, (3, 3)),  # of (u, v, r), with the centre of gravity where it is
        ("gravity_x", float),  # centre of gravity in the body frame
        ("gravity_y", float),
        ("wheel_x", float, 4),
        ("wheel_y", float, 4),
        ("grip_x", float, 4),  # mu0_x·f_z
        ("grip_y", float, 4),
        ("steep_x", float, 4),  # K_y/(mu0_x·f_z), the b of Eq. (6)
        ("steep_y", float, 4),
        ("ratio", float),  # K_x/K_y
        ("shape_x", float),
        ("shape_y", float),
        ("decrease", float),  # K_mu
        ("rest_speed", float),
        ("speed", float, 2),  # surface speed per rpm, left and right
        ("dead_band", float),  # rpm
        ("dead_time", float),
        ("lag", float),
        ("droop", float),  # loss of surface speed per µN of driving force
        ("compliance", float),  # rad per µN
        ("steer", float, 4),
        ("stiffness_follows_load", float),  # 1 or 0
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
        ("pattern", float, (MOST_TERMS, 4)),
    ],
    align=True,
)


def _ones() -> Array:
    return np.ones(4)


@dataclass
class Draft:
    """What effects may change before a robot is compiled: factors over the wheels, offsets, and added terms.

    Arrays over wheels are in the order of WHEELS. run_index counts the runs of a session from 0.
    """

    robot: Robot
    run_index: int = 0
    attraction_factor: Array = field(default_factory=_ones)
    friction_factor: Array = field(default_factory=_ones)
    speed_factor: Array = field(default_factory=lambda: np.ones(2))
    toe_rad: Array = field(default_factory=lambda: np.zeros(4))
    gravity_mm: tuple[float, float] = (0.0, 0.0)
    dead_band_rpm: float = 0.0
    dead_time_s: float = 0.0
    lag_s: float = 0.0
    droop_rpm_per_uN_mm: float = 0.0
    compliance_rad_per_mN: float = 0.0
    terms: list[Term] = field(default_factory=list)
    last: list[Callable[[Draft], None]] = field(default_factory=list)

    def add(self, *terms: Term) -> None:
        """Add terms; those with coefficient 0 are dropped, so that an absent effect costs nothing."""
        self.terms += [term for term in terms if term.coefficient]

    def finally_do(self, act: Callable[[Draft], None]) -> None:
        """Let an effect act once all others have, where it needs the loads or the centre of gravity they leave."""
        self.last.append(act)

    def loads_uN(self) -> tuple[Array, Array]:
        """Weight share and load f_z of each wheel; the weight is shared by the levers of the centre of gravity."""
        robot, attraction = self.robot, self.robot.magnetic_attraction
        forward = 2 * self.gravity_mm[0] / robot.wheels.wheelbase_mm
        left = 2 * self.gravity_mm[1] / robot.wheels.track_mm
        if max(abs(forward), abs(left)) >= 1:
            raise SimulationError(f"{robot.name}: a centre of gravity at {self.gravity_mm} mm is outside the wheels")
        front, side = np.array([1 + forward, 1 - forward]), np.array([1 + left, 1 - left])
        weight = robot.weight_uN / 4 * np.repeat(front, 2) * np.tile(side, 2)
        attracted = UN_PER_MN * np.array([attraction.driving_wheel_mN] * 2 + [attraction.driven_wheel_mN] * 2)
        return weight, weight + attracted * self.attraction_factor

    def record(self, rest_speed_mm_s: float = REST_SPEED_MM_S) -> NDArray[np.void]:
        """The compiled robot, shape (1,) of dtype MODEL."""
        for act in self.last:
            act(self)
        self.last.clear()
        model = np.zeros(1, MODEL)
        row: Any = model[0]
        _fill_body(row, self)
        _fill_wheels(row, self)
        row["rest_speed"] = rest_speed_mm_s
        _fill_terms(row, self.terms)
        row["general"] = bool(row["wheel_terms"] or row["droop"] or row["compliance"] or self.toe_rad.any())
        return model


def compile_robot(
    robot: Robot, run_index: int = 0, extra: Sequence[Term] = (), rest_speed_mm_s: float = REST_SPEED_MM_S
) -> NDArray[np.void]:
    """The record of a robot with its effects, shape (1,) of dtype MODEL.

    run_index: number of the run within its session, from 0; extra: further terms of the grammar, for physics without
    a name. Raises SimulationError for effects that the catalogue does not know or that cannot act on this robot.
    """
    draft = Draft(robot, run_index)
    if robot.effect:
        from simulator.effects.catalogue import apply_effects

        apply_effects(draft)
    draft.add(*extra)
    return draft.record(rest_speed_mm_s)


def _fill_body(row: Any, draft: Draft) -> None:
    robot = draft.robot
    mass, (x, y) = robot.body.mass_g, draft.gravity_mm
    # The stated yaw inertia is about the centre of gravity's nominal place; an offset adds m·d² (parallel axes).
    inertia = robot.yaw_inertia_g_mm2 + mass * (x * x + y * y)
    row["mass"], row["inertia"], row["gravity_x"], row["gravity_y"] = mass, inertia, x, y
    matrix = np.array([[mass, 0.0, -mass * y], [0.0, mass, mass * x], [-mass * y, mass * x, inertia]])
    row["inverse_mass"] = np.linalg.inv(matrix)


def _fill_wheels(row: Any, draft: Draft) -> None:
    robot, slip = draft.robot, draft.robot.slip
    weight, load = draft.loads_uN()
    if not (load > 0).all() or not (draft.friction_factor > 0).all():
        raise SimulationError(f"{robot.name}: every wheel needs a positive load and friction; loads are {load} µN")
    stiffness = slip.lateral_stiffness * (load if slip.stiffness_basis == "load" else weight)
    row["wheel_x"], row["wheel_y"] = robot.wheel_positions_mm().T
    for axis, friction in (("x", slip.longitudinal_friction), ("y", slip.lateral_friction)):
        row[f"grip_{axis}"] = grip = friction * draft.friction_factor * load
        row[f"steep_{axis}"] = stiffness / grip
    row["ratio"] = slip.longitudinal_stiffness / slip.lateral_stiffness
    row["shape_x"], row["shape_y"] = slip.longitudinal_shape, slip.lateral_shape
    row["decrease"] = slip.friction_decrease
    row["stiffness_follows_load"] = slip.stiffness_basis == "load"
    per_rpm = 2 * math.pi * robot.wheels.radius_mm / 60
    row["speed"] = per_rpm * draft.speed_factor
    row["dead_band"], row["dead_time"], row["lag"] = draft.dead_band_rpm, draft.dead_time_s, draft.lag_s
    row["droop"] = per_rpm * draft.droop_rpm_per_uN_mm * robot.wheels.radius_mm
    row["compliance"], row["steer"] = draft.compliance_rad_per_mN / UN_PER_MN, draft.toe_rad


def _fill_terms(row: Any, terms: list[Term]) -> None:
    # Friction comes last: where it depends on the direction of sliding, speed and toe must be known.
    ordered = sorted(terms, key=lambda term: (term.acts_on_wheels, term.channel == FRICTION))
    if len(ordered) > MOST_TERMS:
        raise SimulationError(f"{len(ordered)} terms of added physics; at most {MOST_TERMS} act at once")
    row["body_terms"] = sum(not term.acts_on_wheels for term in ordered)
    row["wheel_terms"] = sum(term.acts_on_wheels for term in ordered)
    feels = [term for term in ordered if term.depends_on_velocity]
    row["body_feels"] = any(not term.acts_on_wheels for term in feels)
    row["wheels_feel"] = bool(row["compliance"]) or any(term.acts_on_wheels for term in feels)
    row["varies"] = any(term.varies for term in ordered)
    row["wheels_vary"] = any(term.varies and term.acts_on_wheels for term in ordered)
    for number, term in enumerate(ordered):
        row["channel"][number], row["basis"][number] = term.channel, term.basis
        row["coefficient"][number], row["pattern"][number] = term.coefficient, term.pattern
        row["point_x"][number], row["point_y"][number] = term.point_mm
