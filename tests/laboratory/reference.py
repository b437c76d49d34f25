"""Forces on a skid-steered robot with four wheels, written from the equations of the paper.

Source: Section 2 of the paper, Eqs. (3) to (8), in the reading of the project's notes on the model.
Body frame: x forward, y left, origin midway between the axles. Plate frame: x right, y up, heading counter-clockwise.
Units: mm, s, g, mN, rad (1 mN = 1000 g mm/s²). Arrays hold one column per run, and one row per wheel in the order
front left, front right, rear left, rear right. The front wheels are driven by motors, the rear wheels roll freely.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
GRAVITY_M_S2 = 9.8  # the paper's W = 0.5 g × 9.8 m/s² = 4.9 mN
MM_S_PER_RPM_MM = 2 * np.pi / 60  # surface speed of a wheel of 1 mm radius at 1 rpm


@dataclass(frozen=True)
class Robot:
    """A robot with the fields of robot.toml; marks are (x, y) in the body frame."""

    mass_g: float = 0.5
    length_mm: float = 5.0
    width_mm: float = 9.0
    wheelbase_mm: float = 4.0
    track_mm: float = 4.0
    wheel_radius_mm: float = 0.5
    driving_attraction_mN: float = 22.05
    driven_attraction_mN: float = 2.45
    friction_x: float = 0.15
    friction_y: float = 0.25
    friction_decrease: float = 0.2
    shape_x: float = 1.0
    shape_y: float = 0.80
    stiffness_x: float = 1.643
    stiffness_y: float = 5.113
    stiffness_basis: str = "load"
    green_mm: tuple[float, float] = (-1.55, 1.83)
    yellow_mm: tuple[float, float] = (-1.55, -1.83)

    @property
    def wheels_mm(self) -> Array:
        """Wheel centres in the body frame, (4, 2)."""
        x, y = self.wheelbase_mm / 2, self.track_mm / 2
        return np.array([[x, y], [x, -y], [-x, y], [-x, -y]])

    @property
    def yaw_inertia_g_mm2(self) -> float:
        """A uniform box about its centre."""
        return self.mass_g * (self.length_mm**2 + self.width_mm**2) / 12

    @property
    def weight_mN(self) -> float:
        """Mass times gravity."""
        return self.mass_g * GRAVITY_M_S2


@dataclass(frozen=True)
class Now:
    """What a law may depend on at one instant: pose in the plate frame, velocities in the body frame, per run."""

    time_s: Array  # since the motors were switched on, (runs,)
    x_mm: Array
    y_mm: Array
    heading_rad: Array
    start_heading_rad: Array
    travelled_mm: Array
    u_mm_s: Array
    v_mm_s: Array
    yaw_rate_rad_s: Array
    last_drive_mN: Array  # longitudinal force of the wheels one step earlier, (4, runs)


@dataclass(frozen=True)
class Sliding:
    """Where wheels are on the plate and how they slide over it, (4, runs); direction in the plate frame."""

    x_mm: Array
    y_mm: Array
    speed_mm_s: Array
    direction_rad: Array


Pull = Callable[[Now, "World"], tuple[Array, Array, Array]]  # force x, y in the body frame (mN) and moment (mN mm)
FrictionFactor = Callable[[Now, Sliding], Array]  # (4, runs)
CommandChange = Callable[[Array], Array]  # (2, runs) rpm to rpm; rows: left, right
LoadChange = Callable[[Now, Array, "World"], Array]  # (4, runs) mN to mN


@dataclass(frozen=True)
class World:
    """A robot and all physics added to it. The defaults add nothing."""

    robot: Robot = Robot()
    rest_mm_s: float = 1e-4  # below this speed Eq. (3) is 0/0; ten times more or less moves no path by 1e-5 mm (tested)
    commands: tuple[CommandChange, ...] = ()
    dead_time_s: float = 0.0
    lags_s: tuple[float, ...] = ()  # first-order lags of the motors, one after the other
    backlash_rad: tuple[float, float] = (0.0, 0.0)  # left, right
    ripple: tuple[float, float] = (0.0, 0.0)  # amplitude, phase in rad
    droop_rpm_per_uN_mm: float = 0.0
    attraction: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)  # factors per wheel
    toe_rad: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)  # counter-clockwise
    compliance_rad_per_mN: float = 0.0
    rolling_drag: float = 0.0
    scrub_radius_mm: float = 0.0
    centre_of_gravity_mm: tuple[float, float] = (0.0, 0.0)
    pulls: tuple[Pull, ...] = ()
    frictions: tuple[FrictionFactor, ...] = ()
    loads: tuple[LoadChange, ...] = ()
    friction_of_run: tuple[float, ...] = ()  # factor per run; empty: 1


def weight_shares_mN(world: World) -> Array:
    """Weight on each wheel: equal, and shifted so that the moments of an off-centre weight balance, (4,)."""
    robot, (x, y) = world.robot, world.centre_of_gravity_mm
    wheels = robot.wheels_mm
    lever_x, lever_y = robot.wheelbase_mm / 2, robot.track_mm / 2
    return robot.weight_mN / 4 * (1 + x * wheels[:, 0] / lever_x**2 + y * wheels[:, 1] / lever_y**2)


def wheel_loads_mN(world: World, now: Now) -> Array:
    """Vertical force on each wheel: weight share + magnetic attraction, (4, runs)."""
    robot = world.robot
    attraction = np.repeat([robot.driving_attraction_mN, robot.driven_attraction_mN], 2) * world.attraction
    loads = np.repeat((weight_shares_mN(world) + attraction)[:, None], len(now.x_mm), axis=1)
    for change in world.loads:
        loads = change(now, loads, world)
    return np.maximum(loads, 1e-3)


def slip_forces_mN(
    robot: Robot, u: Array, v: Array, surface: Array, load: Array, basis: Array, factor: Array | float, rest_mm_s: float
) -> tuple[Array, Array]:
    """Force on wheels along and across, Eqs. (3) to (8).

    u, v: velocity of the wheel centre in wheel axes; surface: r·phi', NaN for a wheel that rolls freely (mm/s).
    load: f_z; basis: the force that the stiffnesses multiply (mN); factor: of both friction coefficients.
    rest_mm_s rounds off the corner at rest.
    """
    speed = np.sqrt(u**2 + v**2 + rest_mm_s**2)
    sin_alpha = v / speed
    cos_alpha = np.sqrt(1 - sin_alpha**2)
    slip = np.where(
        np.isnan(surface), 0.0, (u - surface) / np.sqrt(np.fmax(u**2, surface**2) + rest_mm_s**2)
    )  # s, Eq. (3), in the convention that reproduces Figures 9 and 10
    kappa = robot.stiffness_x / robot.stiffness_y
    sigma = np.sqrt(sin_alpha**2 + (kappa * slip * cos_alpha) ** 2) + 1e-12  # Eq. (4)
    fading = 1 - robot.friction_decrease * sigma  # Eq. (5)

    def per_sigma(friction: float, shape: float) -> Array:
        limit = friction * factor * load
        bend = np.sin(shape * np.arctan(robot.stiffness_y * basis / limit * sigma))
        return fading * limit * bend / sigma  # Eq. (6)

    along = -kappa * slip * cos_alpha * per_sigma(robot.friction_x, robot.shape_x)  # Eq. (7)
    across = -sin_alpha * per_sigma(robot.friction_y, robot.shape_y)
    return along, across


@dataclass(frozen=True)
class Balance:
    """Sum of all forces in the body frame, and what the coupled unknowns need."""

    force_x_mN: Array
    force_y_mN: Array
    moment_mN_mm: Array
    along_mN: Array  # per wheel, in wheel axes, (4, runs)
    across_mN: Array


def forces(world: World, now: Now, surface_mm_s: Array, axle_turn_rad: Array | None = None) -> Balance:
    """All forces on the robot. surface_mm_s: of the two front wheels, (2, runs); axle_turn_rad: front, rear, (2, runs).

    Moments are about the origin of the body frame.
    """
    robot, runs = world.robot, len(now.x_mm)
    position = robot.wheels_mm
    px, py = position[:, :1], position[:, 1:]
    turn = np.repeat(np.asarray(world.toe_rad)[:, None], runs, axis=1)
    if axle_turn_rad is not None:
        turn = turn + np.repeat(axle_turn_rad, 2, axis=0)
    cos, sin = np.cos(turn), np.sin(turn)
    body_u = now.u_mm_s - now.yaw_rate_rad_s * py
    body_v = now.v_mm_s + now.yaw_rate_rad_s * px
    u, v = cos * body_u + sin * body_v, cos * body_v - sin * body_u
    surface = np.vstack([surface_mm_s, np.full((2, runs), np.nan)])
    load = wheel_loads_mN(world, now)
    basis = load if robot.stiffness_basis == "load" else weight_shares_mN(world)[:, None]
    factor = np.asarray(world.friction_of_run)[None, :] if world.friction_of_run else 1.0
    if world.frictions:
        slide_u = np.where(np.isnan(surface), 0.0, u - surface)
        direction = np.arctan2(v, slide_u) + turn + now.heading_rad
        c, s = np.cos(now.heading_rad), np.sin(now.heading_rad)
        where = now.x_mm + c * px - s * py, now.y_mm + s * px + c * py
        sliding = Sliding(where[0], where[1], np.hypot(slide_u, v), direction)
        for law in world.frictions:
            factor = factor * law(now, sliding)
    along, across = slip_forces_mN(robot, u, v, surface, load, basis, factor, world.rest_mm_s)
    if world.rolling_drag:
        resist = world.rolling_drag * load * u / np.sqrt(u**2 + world.rest_mm_s**2)
        along = along - np.where(np.isnan(surface), resist, 0.0)
    force_x, force_y = cos * along - sin * across, sin * along + cos * across
    moment = (px * force_y - py * force_x).sum(axis=0)
    if world.scrub_radius_mm:  # Coulomb: against the sense of the spin, whatever its rate
        rate = now.yaw_rate_rad_s
        moment = moment - world.scrub_radius_mm * load.sum(axis=0) * rate / np.sqrt(rate**2 + 1e-4**2)
    total_x, total_y = force_x.sum(axis=0), force_y.sum(axis=0)
    for pull in world.pulls:
        x, y, m = pull(now, world)
        total_x, total_y, moment = total_x + x, total_y + y, moment + m
    return Balance(total_x, total_y, moment, along, across)


def inertia_mN(world: World, rate: Array, velocity: Array) -> Array:
    """Mass times acceleration: force x, y (mN) and moment about the origin (mN mm), (3, runs).

    rate: time derivatives of velocity; velocity: u, v, yaw rate in the body frame, (3, runs). Eqs. (1) and (2).
    """
    robot, (x, y) = world.robot, world.centre_of_gravity_mm
    u, v, spin = velocity
    a_x = rate[0] - v * spin - rate[2] * y - spin**2 * x
    a_y = rate[1] + u * spin + rate[2] * x - spin**2 * y
    moment = robot.yaw_inertia_g_mm2 * rate[2] + robot.mass_g * (x * a_y - y * a_x)
    return np.stack([robot.mass_g * a_x, robot.mass_g * a_y, moment]) / 1000
