"""Recordings of a robot with a wheelbase of 0.15 to 0.7 m: what is true, what is written about it, and its logs.

Drawn from a seed alone. A recording is a log of commanded wheel speeds in steps of 1.5 to 5 s and poses at 10 to 50 Hz
with white and slow noise. Between recordings friction varies by 3 %; stamps of commands and poses agree to 15 ms, and
to 8 ms from recording to recording. A robot is measured to some tenths of a per cent. Its slip law is known to 5 %, and
its file says so, or exactly, in every other session.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

import numpy as np
import pandas as pd
from numba import njit

from tests.driven_laboratory.reference import GRAVITY, STEP_S, Array, Robot, drive

PART_S = 6.0  # of a recording, over which motions with and without what is missing are compared


@dataclass(frozen=True)
class Motors:
    """How the wheels follow their commands."""

    lag_s: float = 0.0
    dead_time_s: float = 0.0
    most_rad_s: float = np.inf
    most_rad_s2: float = np.inf


@dataclass(frozen=True)
class Noise:
    """Of the poses."""

    rate_hz: float
    white_m: float
    heading_rad: float
    slow_m: float


Drawn = dict[str, object]  # fields of Robot and of Motors


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _polar(rng: np.random.Generator, size: float) -> tuple[float, float]:
    angle = rng.uniform(0, 2 * np.pi)
    return float(size * np.cos(angle)), float(size * np.sin(angle))


def _lag(rng: np.random.Generator, robot: Robot, fastest: float) -> Drawn:
    del robot, fastest
    return {"lag_s": rng.uniform(0.1, 0.3), "dead_time_s": rng.uniform(0.0, 0.15)}


def _speed_limit(rng: np.random.Generator, robot: Robot, fastest: float) -> Drawn:
    del robot
    return {"most_rad_s": rng.uniform(0.6, 0.8) * fastest}


def _acceleration_limit(rng: np.random.Generator, robot: Robot, fastest: float) -> Drawn:
    del robot
    return {"most_rad_s2": rng.uniform(0.6, 1.5) * fastest}


def _left_wheels(rng: np.random.Generator, robot: Robot, fastest: float) -> Drawn:
    del robot, fastest
    return {"left_radius": 1 + _sign(rng) * rng.uniform(0.03, 0.06)}


def _payload(rng: np.random.Generator, robot: Robot, fastest: float) -> Drawn:
    del fastest
    ahead, aside = rng.uniform(0.1, 0.2) * robot.wheelbase_m, rng.uniform(0.0, 0.1) * robot.track_m
    return {"centre_of_gravity_m": (_sign(rng) * ahead, _sign(rng) * aside)}


def _slope(rng: np.random.Generator, robot: Robot, fastest: float) -> Drawn:
    del robot, fastest
    return {"slope": _polar(rng, np.sin(np.deg2rad(rng.uniform(2, 6))))}


def _across(rng: np.random.Generator, robot: Robot, fastest: float) -> Drawn:
    del fastest
    return {"friction_y": robot.friction_y * rng.uniform(0.6, 0.75)}


def _drag(rng: np.random.Generator, robot: Robot, fastest: float) -> Drawn:
    return {"viscous_N_s_m": rng.uniform(0.05, 0.12) * robot.mass_kg * GRAVITY / (fastest * robot.radius_m)}


def _towed(rng: np.random.Generator, robot: Robot, fastest: float) -> Drawn:
    del fastest
    return {"towed_N": rng.uniform(0.05, 0.12) * robot.mass_kg * GRAVITY}


def _scrub(rng: np.random.Generator, robot: Robot, fastest: float) -> Drawn:
    del fastest
    return {"scrub_m": rng.uniform(0.02, 0.05) * robot.track_m}


def _fading(rng: np.random.Generator, robot: Robot, fastest: float) -> Drawn:
    del robot, fastest
    return {"fading": rng.uniform(0.4, 0.6), "fading_m": rng.uniform(1, 3)}


def _flat(rng: np.random.Generator, robot: Robot, fastest: float) -> Drawn:
    del robot, fastest
    return {"flat": rng.uniform(0.6, 0.9)}


def _slipping_axle(rng: np.random.Generator, robot: Robot, fastest: float) -> Drawn:
    del fastest
    return {"torque_Nm": rng.uniform(0.03, 0.06) * robot.mass_kg * GRAVITY * robot.radius_m}


def _caster(rng: np.random.Generator, robot: Robot, fastest: float) -> Drawn:
    del fastest
    return {"caster_N": rng.uniform(0.05, 0.1) * robot.mass_kg * GRAVITY}


# Each kind: the effect that names what is missing ("": nothing, None: none does), and how its fields are drawn.
KINDS: dict[str, tuple[str | None, Callable[[np.random.Generator, Robot, float], Drawn]]] = {
    "none": ("", lambda *given: {}),  # noqa: ARG005
    "lag": ("command-lag", _lag),
    "speed-limit": ("speed-limit", _speed_limit),
    "acceleration-limit": ("acceleration-limit", _acceleration_limit),
    "left-wheels": ("drive-speed-mismatch", _left_wheels),
    "payload": ("mass-offset", _payload),
    "slope": ("plate-tilt", _slope),
    "across": ("friction-across", _across),
    "drag": ("viscous-drag", _drag),
    "scrub": ("scrub-torque", _scrub),
    "towed": (None, _towed),
    "fading": (None, _fading),
    "flat": (None, _flat),
    "slipping-axle": (None, _slipping_axle),
    "caster": (None, _caster),
}


@dataclass(frozen=True)
class Session:
    """One experiment with its truth."""

    kind: str
    said: Robot
    true: Robot
    bare: Robot  # the true robot without what is missing in its file
    motors: Motors
    noise: Noise
    commands: list[tuple[Array, Array]]  # of each recording: times (k,), rad/s (k, 2); the last row stops it
    friction: Array
    start: Array
    late_s: Array
    slip_is_exact: bool
    seed: int


def draw(kind: str, seed: int) -> Session:
    """A session of a kind."""
    rng = np.random.default_rng([seed, list(KINDS).index(kind)])
    said = _robot(rng)
    fastest = rng.uniform(0.8, 3.0) * np.sqrt(said.wheelbase_m) / said.radius_m * rng.uniform(0.3, 0.8)
    near = {
        name: getattr(said, name) * (1 + 0.003 * rng.standard_normal())
        for name in ("wheelbase_m", "track_m", "radius_m")
    }
    slips = ("friction_x", "friction_y", "stiffness_x", "stiffness_y")
    is_exact = bool(rng.random() < 0.5)
    near |= {name: getattr(said, name) * (1 + 0.05 * rng.standard_normal() * (not is_exact)) for name in slips}
    bare = replace(said, **near)
    hidden = KINDS[kind][1](rng, bare, fastest)
    of_motors = {field.name for field in fields(Motors)}
    true = replace(bare, **{key: value for key, value in hidden.items() if key not in of_motors})
    count = int(rng.integers(6, 13))
    rate = float(rng.choice([10.0, 20.0, 50.0]))
    return Session(
        kind=kind,
        said=said,
        true=true,
        bare=bare,
        motors=Motors(**{key: value for key, value in hidden.items() if key in of_motors}),
        noise=Noise(rate, rng.uniform(0.001, 0.006), rng.uniform(0.002, 0.008), rng.uniform(0, 0.004)),
        commands=[_commands(rng, fastest) for _ in range(count)],
        friction=1 + 0.03 * rng.standard_normal(count),
        start=np.column_stack([rng.uniform(-2, 2, (count, 2)), rng.uniform(-np.pi, np.pi, count)]),
        late_s=0.015 * rng.standard_normal() + 0.008 * rng.standard_normal(count),
        slip_is_exact=is_exact,
        seed=seed,
    )


def _robot(rng: np.random.Generator) -> Robot:
    size = 10 ** rng.uniform(np.log10(0.15), np.log10(0.7))
    track = size * rng.uniform(0.8, 1.3)
    friction = rng.uniform(0.4, 0.9)
    return Robot(
        mass_kg=float(60 * (size / 0.5) ** 3 * rng.uniform(0.5, 1.5)),
        wheelbase_m=float(size),
        track_m=float(track),
        radius_m=float(size * rng.uniform(0.2, 0.35)),
        length_m=float(1.8 * size),
        width_m=float(1.2 * track),
        friction_x=float(friction),
        friction_y=float(friction * rng.uniform(0.8, 1.1)),
        stiffness_x=float(rng.uniform(5, 14)),
        stiffness_y=float(rng.uniform(5, 14)),
        slides=bool(rng.random() < 0.7),
    )


def _commands(rng: np.random.Generator, fastest: float) -> tuple[Array, Array]:
    """Steps of a recording: straight, arcs, turns on the spot, both ways."""
    times, rows, now, lasts = [], [], 0.0, rng.uniform(10, 28)
    while now < lasts:
        ahead = rng.uniform(0.3, 1.0) * fastest * _sign(rng) * (rng.random() > 0.15)
        turn = rng.uniform(0.15, 0.9) * fastest * _sign(rng) * (rng.random() > 0.15)
        most = max(abs(ahead - turn), abs(ahead + turn), 1e-9)
        scale = min(1.0, fastest / most)
        times.append(now)
        rows.append([round(scale * (ahead - turn), 2), round(scale * (ahead + turn), 2)])
        now = round(now + rng.uniform(1.5, 5.0), 2)
    return np.array([*times, now]), np.array([*rows, [0.0, 0.0]])


def surface_rad_s(session: Session, run: int) -> Array:
    """Speeds of the wheels at every STEP_S from the start of the recording to its end, (steps, 2)."""
    times, rows = session.commands[run]
    motors, late = session.motors, session.late_s[run]
    clock = np.arange(0, times[-1] + 1.0, STEP_S)
    asked = np.zeros((len(clock), 2))
    index = np.searchsorted(times + late + motors.dead_time_s, clock, side="right") - 1
    asked[index >= 0] = rows[index[index >= 0]]
    asked = np.clip(asked, -motors.most_rad_s, motors.most_rad_s)
    if not motors.lag_s and np.isinf(motors.most_rad_s2):
        return asked
    share = 1 - np.exp(-STEP_S / motors.lag_s) if motors.lag_s else 1.0
    return _followed(asked, share, motors.most_rad_s2 * STEP_S)


@njit(cache=False)
def _followed(asked: Array, share: float, most: float) -> Array:
    """Speeds that follow asked ones (steps, 2) by a share of the difference a step, at most by so much."""
    result, speed = np.empty_like(asked), np.zeros(2)
    for k in range(len(asked)):
        speed += np.minimum(np.maximum(share * (asked[k] - speed), -most), most)
        result[k] = speed
    return result


def moves(session: Session) -> float:
    """How far what is missing moves the robot, in the noise of the poses: RMS of places or headings, the larger one.

    Parts of PART_S are compared after one is laid on the other, as a start pose is not known.
    """
    without = replace(session, true=session.bare, motors=Motors())
    size, part = round(PART_S / STEP_S), slice(None, None, round(0.02 / STEP_S))
    apart: list[tuple[float, float]] = []
    for run in range(len(session.commands)):
        with_it, bare = (
            drive(each.true, each.friction[run], surface_rad_s(each, run), each.start[run])
            for each in (session, without)
        )
        begins = range(0, len(bare) - size + 1, size)
        apart += [_apart(with_it[at : at + size][part], bare[at : at + size][part]) for at in begins]
    place_m, heading_rad = np.sqrt(np.mean(apart, axis=0))
    noise = session.noise
    return float(max(place_m / np.hypot(noise.white_m, noise.slow_m), heading_rad / noise.heading_rad))


def _apart(poses: Array, others: Array) -> tuple[float, float]:
    """Mean squares of the distances, m², and differences of heading, rad², of two paths laid on each other."""
    one, other = (each[:, 0] + 1j * each[:, 1] - np.mean(each[:, 0] + 1j * each[:, 1]) for each in (poses, others))
    turned = np.vdot(one, other)
    distance = other - one * (turned / abs(turned) if turned else 1.0)
    angle = others[:, 2] - poses[:, 2]
    return float(np.mean(abs(distance) ** 2)), float(np.var(angle))


def recorded(session: Session, rng: np.random.Generator) -> list[pd.DataFrame]:
    """Poses of every recording as in its file: SI units, heading wrapped."""
    tables, noise = [], session.noise
    for run in range(len(session.commands)):
        exact = drive(session.true, session.friction[run], surface_rad_s(session, run), session.start[run])
        times = np.arange(rng.uniform(0, 1) / noise.rate_hz, (len(exact) - 1) * STEP_S, 1 / noise.rate_hz)
        poses = exact[np.round(times / STEP_S).astype(int)].copy()
        slow = np.zeros((len(times), 2))
        decay = np.exp(-1 / noise.rate_hz / 2.0)
        for k in range(1, len(times)):
            slow[k] = decay * slow[k - 1] + noise.slow_m * np.sqrt(1 - decay**2) * rng.standard_normal(2)
        poses[:, :2] += slow + noise.white_m * rng.standard_normal((len(times), 2))
        poses[:, 2] += noise.heading_rad * rng.standard_normal(len(times))
        poses[:, 2] = (poses[:, 2] + np.pi) % (2 * np.pi) - np.pi
        tables.append(
            pd.DataFrame({"time_s": times, "x_m": poses[:, 0], "y_m": poses[:, 1], "heading_rad": poses[:, 2]})
        )
    return tables


def parameters(session: Session) -> dict[str, float]:
    """True values of what is missing, under the names of the contract; of limits of acceleration it has other ones."""
    true, motors = session.true, session.motors
    found = {
        "lag": {"time_constant_s": motors.lag_s, "dead_time_s": motors.dead_time_s},
        "speed-limit": {"wheel_rpm": motors.most_rad_s * 30 / np.pi},
        "left-wheels": {"left_over_right": true.left_radius},
        "payload": {"x_mm": 1000 * true.centre_of_gravity_m[0], "y_mm": 1000 * true.centre_of_gravity_m[1]},
        "slope": {
            "angle_deg": float(np.rad2deg(np.arcsin(np.hypot(*true.slope)))),
            "azimuth_deg": float(np.rad2deg(np.arctan2(true.slope[1], true.slope[0]))),
        },
        "across": {"factor": true.friction_y / session.said.friction_y},
        "drag": {"force_mN_s_mm": true.viscous_N_s_m},
        "scrub": {"radius_mm": 1000 * true.scrub_m},
    }
    return found.get(session.kind, {})


def write(session: Session, folder: Path, truth: Path) -> Path:
    """Write robot.toml, experiment.toml and the logs to a folder, and the truth elsewhere."""
    folder.mkdir(parents=True, exist_ok=True)
    said = session.said
    lines = ["format = 1", 'name = "robot"', "[body]", f"mass_kg = {said.mass_kg:.5f}"]
    lines += [f"length_m = {said.length_m:.5f}", f"width_m = {said.width_m:.5f}", f"height_m = {said.track_m / 2:.5f}"]
    for end, x in (("front", 0.5), ("rear", -0.5)):
        for side, y in (("left", 0.5), ("right", -0.5)):
            lines += ["[[wheel]]", f'name = "{end}_{side}"', f"x_m = {x * said.wheelbase_m:.5f}"]
            lines += [f"y_m = {y * said.track_m:.5f}", f"radius_m = {said.radius_m:.5f}", f'driven_by = "{side}"']
    lines += ["[slip]", f"longitudinal_friction = {said.friction_x:.5f}", f"lateral_friction = {said.friction_y:.5f}"]
    lines += [f"friction_decrease = {said.friction_decrease}", "longitudinal_shape = 1.0", "lateral_shape = 1.0"]
    lines += [f"longitudinal_stiffness = {said.stiffness_x:.5f}", f"lateral_stiffness = {said.stiffness_y:.5f}"]
    if not session.slip_is_exact:
        keys = [f"{way}_{what}" for way in ("longitudinal", "lateral") for what in ("friction", "stiffness")]
        lines += ["[tolerance]", *(f'"slip.{key}" = 0.05' for key in keys)]
    if said.slides:
        lines += ["[[effect]]", 'id = "sliding-friction"', "share = 1.0"]
    (folder / "robot.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    lines = ["format = 1", 'name = "logs"', 'robot = "robot.toml"']
    rng = np.random.default_rng([session.seed, 1, list(KINDS).index(session.kind)])
    for run, poses in enumerate(recorded(session, rng)):
        name = f"r{run + 1:02d}"
        poses.round(5).to_csv(folder / f"{name}.csv", index=False)
        times, rows = session.commands[run]
        log = pd.DataFrame({"time_s": times, "left_rad_s": rows[:, 0], "right_rad_s": rows[:, 1]})
        log.to_csv(folder / f"{name}_commands.csv", index=False)
        lines += ["[[run]]", f'id = "{name}"', f'poses = "{name}.csv"', f'commands = "{name}_commands.csv"']
    path = folder / "experiment.toml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    truth.mkdir(parents=True, exist_ok=True)
    content = {
        "kind": session.kind,
        "effect": KINDS[session.kind][0],
        "parameters": parameters(session),
        "true": asdict(session.true),
    }
    content |= {
        "moves": moves(session),
        "said": asdict(said),
        "motors": asdict(session.motors),
        "noise": asdict(session.noise),
    }
    content |= {"late_s": session.late_s.tolist(), "friction": session.friction.tolist()}
    (truth / "truth.json").write_text(json.dumps(content, indent=1), encoding="utf-8")
    return path
