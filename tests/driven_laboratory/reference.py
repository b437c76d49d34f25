"""Motion of a wheeled skid-steered robot with four driven wheels, written from the equations of the paper.

Source: Section 2 of the paper, Eqs. (1) to (8), with the weight of the robot in place of its magnets. Nothing is
imported from turnscope. SI units; body frame: x forward, y left, origin midway between the axles; wheels in the order
front left, front right, rear left, rear right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
GRAVITY = 9.8  # m/s², as in the paper
STEP_S = 2e-5
REST_M_S = 2e-4  # rounds off the corner of friction at rest; ten times less moves paths of 25 s by 0.1 mm


@dataclass(frozen=True)
class Robot:
    """What is true of a robot; each effect is absent by default."""

    mass_kg: float
    wheelbase_m: float
    track_m: float
    radius_m: float
    length_m: float
    width_m: float
    friction_x: float
    friction_y: float
    stiffness_x: float
    stiffness_y: float
    friction_decrease: float = 0.1
    slides: bool = True  # friction opposes the sliding of the contact; else the paper's slip ratio and slip angle
    centre_of_gravity_m: tuple[float, float] = (0.0, 0.0)
    left_radius: float = 1.0  # radii of the left wheels over radius_m
    slope: tuple[float, float] = (0.0, 0.0)  # downhill force over weight, along x and y of the world
    viscous_N_s_m: float = 0.0  # force against the motion of the origin, over its speed
    towed_N: float = 0.0  # force against the motion of the origin, of something towed along there
    scrub_m: float = 0.0  # moment against the spin over the load
    fading: float = 0.0  # share of friction lost over metres slid: outside the catalogue
    fading_m: float = 30.0
    flat: float = 0.0  # share of its load that one wheel (front left) loses once a turn: outside
    torque_Nm: float = np.inf  # over which the left axle slips: outside
    caster_N: float = 0.0  # side force of a caster that swings round at the rear after a reversal: outside

    @property
    def inertia_kg_m2(self) -> float:
        """Of a uniform box about its centre."""
        return self.mass_kg * (self.length_m**2 + self.width_m**2) / 12


def drive(robot: Robot, friction: float, surface_rad_s: Array, start: Array) -> Array:
    """Poses (steps, 3) of a robot at rest at first, at every STEP_S.

    friction: factor of the recording. surface_rad_s: speeds of the left and right wheels at every step, (steps, 2).
    start: x, y (m), heading (rad).
    """
    x, y = robot.wheelbase_m / 2, robot.track_m / 2
    gx, gy = robot.centre_of_gravity_m
    wheels = np.array([[x, y], [x, -y], [-x, y], [-x, -y]])
    weight = robot.mass_kg * GRAVITY
    loads = weight / 4 * (1 + gx * wheels[:, 0] / x**2 + gy * wheels[:, 1] / y**2)
    radii = robot.radius_m * np.array([robot.left_radius, 1.0, robot.left_radius, 1.0])
    law = np.array([
        robot.friction_x * friction, robot.friction_y * friction, robot.stiffness_x, robot.stiffness_y,
        robot.friction_decrease, float(robot.slides),
    ])  # fmt: skip
    outer = np.array([
        robot.mass_kg, robot.inertia_kg_m2, gx, gy, weight * robot.slope[0],
        weight * robot.slope[1], robot.viscous_N_s_m, robot.towed_N, robot.scrub_m, robot.fading,
        robot.fading_m, robot.flat, robot.torque_Nm, robot.caster_N, weight,
    ])  # fmt: skip
    return _drive(wheels, loads, radii, law, outer, surface_rad_s, start.astype(float))


@njit(cache=False)
def _drive(wheels, loads, radii, law, outer, surface, start):  # noqa: ANN001, ANN202
    steps = len(surface)
    poses = np.empty((steps, 3))
    state = np.array([start[0], start[1], start[2], 0.0, 0.0, 0.0])
    rate, middle = np.empty(6), np.empty(6)
    slid, angle, swing = 0.0, 0.0, 1.0
    for k in range(steps):
        poses[k] = state[:3]
        _rates(rate, state, wheels, loads, radii, law, outer, surface[k], slid, angle, swing)
        middle[:] = state + STEP_S / 2 * rate
        _rates(rate, middle, wheels, loads, radii, law, outer, surface[k], slid, angle, swing)
        state += STEP_S * rate
        slid += STEP_S * abs(state[5]) * abs(wheels[0, 0])
        angle += STEP_S * surface[k, 0]
        ahead = state[3] / (abs(state[3]) + 0.02)
        swing += STEP_S * abs(state[3]) * (ahead - swing) / 0.15
    return poses


@njit(cache=False)
def _rates(rate, state, wheels, loads, radii, law, outer, surface, slid, angle, swing):  # noqa: ANN001, ANN202
    """Time derivatives of x, y, heading, u, v, yaw rate, written to rate."""
    mass, inertia, gx, gy = outer[0], outer[1], outer[2], outer[3]
    heading, u, v, spin = state[2], state[3], state[4], state[5]
    cos, sin = np.cos(heading), np.sin(heading)
    mu_x, mu_y, stiff_x, stiff_y, decrease, slides = law
    kappa = stiff_x / stiff_y
    fade = 1 - outer[9] * (1 - np.exp(-slid / outer[10]))
    force_x = cos * outer[4] + sin * outer[5]
    force_y = -sin * outer[4] + cos * outer[5]
    moment = gx * force_y - gy * force_x
    for w in range(4):
        load = loads[w]
        if w == 0 and outer[11] > 0:
            load = load * (1 - outer[11] * np.exp(-((((angle / (2 * np.pi)) % 1.0) - 0.5) ** 2) / 0.02))
        wu, wv = u - spin * wheels[w, 1], v + spin * wheels[w, 0]
        speed = np.sqrt(wu * wu + wv * wv + REST_M_S**2)
        sin_a = wv / speed
        cos_a = np.sqrt(1 - sin_a * sin_a)
        roll = surface[w % 2] * radii[w]
        for _ in range(2):
            if slides:  # theoretical slip: Pacejka (2012), Tire and Vehicle Dynamics, section 4.2
                fastest = max(speed, abs(roll))
                ahead, side = kappa * (wu - roll) / fastest, wv / fastest
            else:
                ahead = kappa * cos_a * (wu - roll) / np.sqrt(max(wu * wu, roll * roll) + REST_M_S**2)
                side = sin_a
            sigma = np.sqrt(side * side + ahead * ahead) + 1e-12
            limit_x, limit_y = mu_x * fade * load, mu_y * fade * load
            per_x = (1 - decrease * sigma) * limit_x * np.sin(np.arctan(stiff_y * load / limit_x * sigma)) / sigma
            per_y = (1 - decrease * sigma) * limit_y * np.sin(np.arctan(stiff_y * load / limit_y * sigma)) / sigma
            along, across = -ahead * per_x, -side * per_y
            most = outer[12] / radii[w]
            if w % 2 == 0 and abs(along) > most:  # the axle slips: the wheel turns slower until it carries its torque
                roll = roll * (most / abs(along)) ** 0.5
            else:
                break
        force_x += along
        force_y += across
        moment += wheels[w, 0] * across - wheels[w, 1] * along
    moment -= outer[8] * outer[14] * spin / np.sqrt(spin * spin + 1e-4)
    going = np.sqrt(u * u + v * v + REST_M_S**2)
    force_x -= (outer[7] / going + outer[6]) * u
    force_y -= (outer[7] / going + outer[6]) * v
    push = outer[13] * (1 - swing * u / (abs(u) + 0.02)) / 2  # full while the caster still points the old way
    force_y += push
    moment += -wheels[0, 0] * 1.3 * push
    # mass (a + spin × v) = force at the centre of gravity, written for the origin
    right_x = force_x / mass + v * spin + spin * spin * gx
    right_y = force_y / mass - u * spin + spin * spin * gy
    spin_rate = (moment - gx * force_y + gy * force_x) / inertia  # about the centre of gravity
    rate[0], rate[1], rate[2] = u * cos - v * sin, u * sin + v * cos, spin
    rate[3], rate[4], rate[5] = right_x + gy * spin_rate, right_y - gx * spin_rate, spin_rate
