"""Sizes of effects that matter: drawn large enough to move the marks beyond noise and beyond what the mess moves them.

At size 1 an effect is as large as a laboratory might still overlook; sizes in between scale its distance from nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tests.laboratory import outside
from tests.laboratory.effects import add_effect
from tests.laboratory.session import Session, rms_change_mm, true_marks

Parameters = dict[str, float]
AtSize = Callable[[float], Parameters]
NOISE_FLOORS = 5.0  # below that a fit with a handful of parameters may not see it
STEPS = (0.03, 0.06, 0.12, 0.25, 0.5, 1.0)


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _ring(rng: np.random.Generator, x: str, y: str, most: float) -> AtSize:
    way = rng.uniform(0, 2 * np.pi)
    return lambda size: {x: most * size * float(np.cos(way)), y: most * size * float(np.sin(way))}


def _factor(rng: np.random.Generator, name: str, most: float) -> AtSize:
    exponent = _sign(rng) * np.log(1 + most)
    return lambda size: {name: float(np.exp(exponent * size))}


def _value(name: str, most: float) -> AtSize:
    return lambda size: {name: most * size}


def at_size(effect: str, session: Session, rng: np.random.Generator) -> AtSize:
    """Draw what has no size (signs, directions, places); the rest follows the size."""
    angle, sign, other = float(rng.uniform(0, 360)), _sign(rng), float(rng.uniform(0.4, 1.0))
    speeds = np.unique(np.abs(session.said_rpm[session.said_rpm != 0]))
    band = float((speeds[0] + speeds[1]) / 2)  # stops the slowest motor and no other
    x, y = (float(v) for v in rng.uniform(-45, 45, 2))
    share = float(rng.uniform(0.3, 1.0))
    table: dict[str, Callable[[], AtSize]] = {
        "drive-speed-mismatch": lambda: _factor(rng, "left_over_right", 0.08),
        "drive-speed-scale": lambda: _factor(rng, "factor", 0.12),
        "motor-droop": lambda: _value("rpm_per_uN_mm", 0.002),
        "command-lag": lambda: lambda s: {"dead_time_s": 0.3 * s * share, "time_constant_s": 0.3 * s * (1.1 - share)},
        "speed-ripple": lambda: lambda s: {"amplitude": 0.2 * s, "phase_deg": angle},
        "dead-band": lambda: lambda _s: {"rpm": band},
        "speed-drift": lambda: lambda s: {"per_run": sign * 0.01 * s},
        "magnet-imbalance": lambda: _factor(rng, "left_over_right", 1.0),
        "magnet-strength": lambda: (
            lambda s: {
                "driving_factor": float(np.exp(0.6 * s * sign)),
                "driven_factor": float(np.exp(-1.0 * s * sign * other)),
            }
        ),
        "friction-level": lambda: _factor(rng, "factor", 1.0),
        "wheel-toe": lambda: _ring(rng, "left_deg", "right_deg", 5.0),
        "rolling-drag": lambda: _value("coefficient", 0.3),
        "scrub-torque": lambda: _value("radius_mm", 0.15),
        "axle-compliance": lambda: _value("deg_per_mN", 1.5),
        "mass-offset": lambda: _ring(rng, "x_mm", "y_mm", 1.8),
        "plate-tilt": lambda: lambda s: {"angle_deg": 12.0 * s, "azimuth_deg": angle},
        "tether-pull": lambda: _ring(rng, "x_mN", "y_mN", 1.5),
        "tether-spring": lambda: lambda s: {"stiffness_mN_mm": 0.05 * s, "anchor_x_mm": x, "anchor_y_mm": y},
        "viscous-drag": lambda: lambda s: {"force_mN_s_mm": 0.8 * s, "moment_uN_mm_s": 2000 * s * other},
        "friction-gradient": lambda: _ring(rng, "per_mm_x", "per_mm_y", 0.016),
        "friction-grain": lambda: lambda s: {"amplitude": 0.5 * s, "direction_deg": angle / 2},
        "stray-magnet": lambda: lambda s: {"force_mN": 4.0 * s, "x_mm": x * 0.8, "y_mm": y * 0.8, "exponent": 2.0},
        "mark-offset": lambda: lambda s: {**_ring_at(angle, 1.0 * s), "angle_deg": sign * 8.0 * s},
        "plane-scale": lambda: _factor(rng, "factor", 0.12),
        "time-base": lambda: _factor(rng, "factor", 0.12),
        "camera-tilt": lambda: _ring(rng, "per_mm_x", "per_mm_y", 0.003),
        "rolling-shutter": lambda: _ring(rng, "x_ms_per_mm", "y_ms_per_mm", 1.0),
    }
    return table[effect]()


def _ring_at(angle_deg: float, most: float) -> Parameters:
    way = np.deg2rad(angle_deg)
    return {"x_mm": most * float(np.cos(way)), "y_mm": most * float(np.sin(way))}


def with_effect(session: Session, effect: str, parameters: Parameters) -> Session:
    """The session with an effect of the contract."""
    world, view = add_effect(session.world, session.view, effect, parameters)
    return replace(session, world=world, view=view)


def sized(
    session: Session, tidied: Session, change: Callable[[float], Session], rng: np.random.Generator
) -> tuple[float, dict[str, float | bool]]:
    """A size at which the change matters, and what was measured: path changes of effect and mess in mm.

    session: with its mess; tidied: without; change: the messy session with the physics at a size.
    """
    plain = true_marks(session)
    on_same_frames = {name: getattr(session, name) for name in ("begin_s", "end_s", "stop_s", "pose")}
    mess = rms_change_mm(true_marks(replace(tidied, **on_same_frames)), plain)
    wanted = max(NOISE_FLOORS * session.noise.floor_mm, mess)
    size, moved = STEPS[0], 0.0
    for step in STEPS:
        try:
            larger = rms_change_mm(plain, true_marks(change(step)))
        except ArithmeticError:  # so large that the robot finds no balance
            break
        size, moved = step, larger
        if moved >= wanted:
            size = _grown(size, change, rng)
            break
    return size, {
        "moved_mm": moved,
        "mess_mm": mess,
        "floor_mm": session.noise.floor_mm,
        "above_noise": bool(moved >= NOISE_FLOORS * session.noise.floor_mm),
        "matters": bool(moved >= wanted),
    }


def _grown(size: float, change: Callable[[float], Session], rng: np.random.Generator) -> float:
    """Up to twice a size that matters, where the robot still finds a balance."""
    grown = min(float(rng.uniform(1.0, 2.0)) * size, 1.0)
    try:
        true_marks(change(grown))
    except ArithmeticError:
        return size
    return grown


def with_outside(session: Session, kind: str, size: float, angle_rad: float) -> Session:
    """The session with physics that no effect of the contract has."""
    return replace(session, world=outside.KINDS[kind](session.world, size, angle_rad))
