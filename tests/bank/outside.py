"""A second simulator, with physics that the catalogue does not hold; written apart from the first.

Quasi-static: at every instant the velocity of the robot balances the forces of the four wheels, because inertia is
1e-4 of friction (time scales of the model notes). Units: mm, s, µN, rad. Kinds of hidden physics are numbered in KINDS.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simulator.robot import Robot

# name: (number, smallest, largest size)
KINDS: dict[str, tuple[int, float, float]] = {
    "quadratic drag": (1, 0.03, 0.15),  # mN/(mm/s)²
    "torque over three headings": (2, 300.0, 1500.0),  # µN·mm
    "sticking at low speed": (3, 0.5, 2.0),  # mN
    "friction changing within a run": (4, 0.02, 0.06),  # 1/s
    "another slip law on one wheel": (5, 0.4, 0.8),  # share of a dry-friction law
    "a slippery spot": (6, 0.2, 0.5),  # relative loss of friction within 6 mm of a place
    "motors fading within a run": (7, 0.004, 0.015),  # 1/s
    "slower backward": (8, 0.02, 0.08),  # relative
    "torque growing with speed": (9, 50.0, 250.0),  # µN·mm/(mm/s)
    "image creeping": (10, 0.01, 0.05),  # mm/s
    "cubic drag sideways": (11, 5.0, 40.0),  # mN/(mm/s)³
}
Array = NDArray[np.float64]


def marks_of(robot: Robot, kind: int, size: float, rpm: tuple[float, float], start_s: float, time_s: Array,
             pose: tuple[float, float, float]) -> Array:  # fmt: skip
    """Marks (n, 4) of one run from rest at a pose (mm, mm, rad)."""
    slip, attraction = robot.slip, robot.magnetic_attraction
    record = np.array(
        [
            robot.weight_uN / 4, attraction.driving_wheel_mN * 1e3, attraction.driven_wheel_mN * 1e3,
            slip.longitudinal_friction, slip.lateral_friction, slip.friction_decrease, slip.longitudinal_shape,
            slip.lateral_shape, slip.longitudinal_stiffness, slip.lateral_stiffness, robot.wheels.wheelbase_mm / 2,
            robot.wheels.track_mm / 2, robot.wheels.radius_mm, float(slip.stiffness_basis == "load"),
        ]
    )  # fmt: skip
    poses = _run(record, kind, size, *rpm, start_s, time_s, np.array(pose))
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    marks = [
        part
        for x, y in (robot.marks.green_mm, robot.marks.yellow_mm)
        for part in (poses[:, 0] + cos * x - sin * y, poses[:, 1] + sin * x + cos * y)
    ]
    seen = np.stack(marks, axis=1)
    if kind == 10:
        seen[:, ::2] += size * time_s[:, None]
    return seen


@njit(cache=True)
def _wheel(u: float, v: float, surface: float, drives: bool, load: float, share: float, dry: float, p: Any) -> Any:
    slip = (u - surface) / max(abs(u), abs(surface), 1e-3) if drives else 0.0
    speed = math.sqrt(u * u + v * v + 1e-8)
    along, across = p[8] / p[9] * slip * abs(u) / speed, v / speed
    total = math.sqrt(along * along + across * across + 1e-16)
    basis = load if p[13] > 0.5 else p[0]
    fade = load * (1 - p[5] * total)
    x = fade * p[3] * share * math.sin(p[6] * math.atan(p[9] * basis / (p[3] * share * load) * total))
    y = fade * p[4] * share * math.sin(p[7] * math.atan(p[9] * basis / (p[4] * share * load) * total))
    if dry > 0:
        x = (1 - dry) * x + dry * load * p[3] * math.tanh(25 * total)
        y = (1 - dry) * y + dry * load * p[3] * math.tanh(25 * total)
    return -along / total * x, -across / total * y


@njit(cache=True)
def _balance(q: Any, x: float, y: float, heading: float, t: float, left: float, right: float, kind: int, size: float,
             p: Any, out: Any) -> None:  # fmt: skip
    u, v, r = q
    speed = math.sqrt(u * u + v * v)
    out[:] = 0.0
    if kind == 1:
        out[0], out[1] = -1e3 * size * speed * u, -1e3 * size * speed * v
    elif kind == 2:
        out[2] = size * math.sin(3 * heading)
    elif kind == 3:
        out[0] = -1e3 * size * math.exp(-speed / 1.2) * math.tanh(u / 0.02)
    elif kind == 9:
        out[2] = size * u
    elif kind == 11:
        out[1] = -1e3 * size * v**3
    share = 1.0
    if kind == 4:
        share = max(1 - size * t, 0.1)
    elif kind == 6:
        share = 1 - size * math.exp(-((x - 4) ** 2 + (y + 2) ** 2) / 72)
    for wheel in range(4):
        arm_x, arm_y = p[10] if wheel < 2 else -p[10], p[11] if wheel % 2 == 0 else -p[11]
        load = p[0] + (p[1] if wheel < 2 else p[2])
        surface = left if wheel == 0 else right
        dry = size if kind == 5 and wheel == 0 else 0.0
        along, across = _wheel(u - r * arm_y, v + r * arm_x, surface, wheel < 2, load, share, dry, p)
        out[0] += along
        out[1] += across
        out[2] += arm_x * across - arm_y * along


@njit(cache=True)
def _velocity(q: Any, x: float, y: float, heading: float, t: float, left: float, right: float, kind: int, size: float,
              p: Any, first: bool) -> None:  # fmt: skip
    """Move q to the balance: implicit steps of growing length from the first guess, then Newton's method."""
    force, moved, probe, slope = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros((3, 3))
    for step in range(45):
        _balance(q, x, y, heading, t, left, right, kind, size, p, force)
        for column in range(3):
            probe[:] = q
            probe[column] += 1e-5
            _balance(probe, x, y, heading, t, left, right, kind, size, p, moved)
            slope[:, column] = (moved - force) / 1e-5
        if first and step < 25:
            rate = 1 / (2e-5 * 1.8**step)
            slope[0, 0] -= 0.5 * rate
            slope[1, 1] -= 0.5 * rate
            slope[2, 2] -= 4.4 * rate
        change = np.linalg.solve(slope, -force)
        largest = np.abs(change).max()
        cap = 0.25 * (abs(left) + abs(right)) + 0.05
        q += change * min(1.0, cap / (largest + 1e-30))
        if largest < 1e-7 and (not first or step >= 25):
            break


@njit(cache=True)
def _run(
    p: Any, kind: int, size: float, left_rpm: float, right_rpm: float, start_s: float, time: Any, pose: Any
) -> Any:
    out = np.zeros((len(time), 3))
    scale = 2 * math.pi / 60 * p[12]
    left, right = left_rpm * scale, right_rpm * scale
    if kind == 8 and left + right < 0:
        left, right = left * (1 - size), right * (1 - size)
    q = np.array([0.45 * (left + right), 0.0, 0.05 * (right - left) / p[11]])
    rate, middle = np.zeros(3), np.zeros(3)
    at, now, first = pose.copy(), start_s, True
    for row in range(len(time)):
        while now < time[row] - 1e-12:
            step = min(1 / 30, time[row] - now)
            for half in range(2):  # midpoint rule
                place, moment = (at, now) if half == 0 else (middle, now + step / 2)
                fade = 1 - size * (moment - start_s) if kind == 7 else 1.0
                x, y, heading = place
                _velocity(q, x, y, heading, moment - start_s, left * fade, right * fade, kind, size, p, first)
                first = False
                cos, sin = math.cos(place[2]), math.sin(place[2])
                rate[0], rate[1], rate[2] = cos * q[0] - sin * q[1], sin * q[0] + cos * q[1], q[2]
                middle[:] = at + rate * step / 2
            at += rate * step
            now += step
        out[row] = at
    return out
