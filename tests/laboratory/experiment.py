"""Experiments of the laboratory: drawn from a seeded generator, and written as the files that a diagnosis reads.

A drawn experiment holds a session, with its mess and physics, and the truth about it. `write` puts the files of the
contract into one folder and the truth into another; neither names nor files of the first folder say what is hidden.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tests.laboratory import mess, odd
from tests.laboratory.effects import PHYSICAL, SEEN, View
from tests.laboratory.reference import Array, Robot, World
from tests.laboratory.session import Session, recorded
from tests.laboratory.sizes import at_size, sized, with_effect, with_outside

EFFECTS = tuple(sorted([*PHYSICAL, *SEEN]))
ALIKE = ({"drive-speed-scale", "plane-scale", "time-base"}, {"tether-spring", "plate-tilt", "stray-magnet"})
TOLERANCES = {
    "slip.longitudinal_friction": 0.05,
    "slip.lateral_friction": 0.05,
    "slip.longitudinal_stiffness": 0.10,
    "slip.lateral_stiffness": 0.10,
    "slip.friction_decrease": 0.10,
    "magnetic_attraction.driving_wheel_mN": 0.10,
    "magnetic_attraction.driven_wheel_mN": 0.10,
    "body.mass_g": 0.02,
}
KNOWN_TO = {"start_common_s": 0.017, "start_per_run_s": 0.008, "time_base": 1e-4, "plane_scale": 1e-3}
ROBOT_KNOWN_TO = {"wheel_radius_mm": 0.0025, "mark_position_mm": 0.05, "plate_level_deg": 0.3}


@dataclass(frozen=True)
class Drawn:
    """A session and the truth about it, ready to be written."""

    session: Session
    truth: dict[str, Any]


def draw(kind: str, name: str, rng: np.random.Generator, *, pivots: bool = False) -> Drawn:
    """Draw an experiment. kind: "mess" (name: its kind), "odd", "single" (name: the effect), "pair" or "outside".

    pivots: three of its runs turn on the spot.
    """
    plain = ordinary_session(rng, pivots=pivots)
    return with_hidden(kind, name, plain, mess.KINDS[name if kind == "mess" else "everything"](plain, rng), rng)


def with_hidden(kind: str, name: str, plain: Session, messy: Session, rng: np.random.Generator) -> Drawn:
    """A session with its mess, and without, and what an experiment of this kind hides in it: see draw."""
    truth: dict[str, Any] = {"kind": kind, "name": name, "effects": {}, "outside": "", "odd": None, "sizes": {}}
    session = messy
    if kind == "single":
        session, truth["effects"], truth["sizes"] = _with_effects(messy, plain, [name], rng)
    elif kind == "pair":
        session, truth["effects"], truth["sizes"] = _with_effects(messy, plain, _two(rng), rng)
    elif kind == "outside":
        angle = float(rng.uniform(0, 2 * np.pi))
        size, measured = sized(messy, plain, lambda s: with_outside(messy, name, 3 * s, angle), rng)
        session, truth["outside"] = with_outside(messy, name, 3 * size, angle), name
        truth["sizes"] = {name: {**measured, "size": 3 * size}}
    elif kind == "odd":
        run = _run_for(name, messy, rng)
        session = odd.KINDS[name](messy, run, rng)
        runs = sorted({run, odd.other_run(messy, run)}) if name == "wrong-command" else [run]
        truth["odd"] = {"runs": [run_name(r) for r in runs], "kinds": sorted(odd.ACCEPTED[name])}
    return Drawn(session, truth)


def ordinary_session(rng: np.random.Generator, *, pivots: bool = False) -> Session:
    """16 to 24 tidy runs: straight, turns to both sides, forward and backward, some repeated, anywhere on the plate."""
    rpm = _commands(rng, int(rng.integers(16, 25)))
    if pivots:
        speed = float(rng.choice([15.0, 29.0, 45.0]))  # the last with wheels that are not equally fast
        turns = speed * np.array([[1.0, -1.0, 1.0], [-1.0, 1.0, -0.9]])
        rpm[:, rng.choice(rpm.shape[1], turns.shape[1], replace=False)] = turns
    runs = rpm.shape[1]
    start = np.round(0.5 + rng.uniform(-0.1, 0.1, runs), 3)
    last = rng.uniform(6, 10, runs)
    stop = np.where(rng.random(runs) < 0.25, np.round(start + last, 3), np.nan)
    robot = _robot(rng)
    return Session(
        world=World(robot),
        view=View(),
        said=robot,
        said_rpm=rpm,
        start_s=start,
        end_s=start + last + np.where(np.isnan(stop), 0.0, 0.5),
        stop_s=stop,
        pose=np.vstack([rng.uniform(-40, 40, (2, runs)), rng.uniform(0, 2 * np.pi, runs)]),
        rpm=rpm,
        gain=np.ones((2, runs)),
        late_s=np.zeros(runs),
        begin_s=np.zeros(runs),
        phase_s=rng.uniform(0, 1 / 60, runs),
    )


def write(drawn: Drawn, folder: Path, truth_folder: Path, rng: np.random.Generator, *, known_to: bool = False) -> None:
    """Write the files of the contract into `folder` and the truth as JSON, named alike, into `truth_folder`.

    known_to: also write what the laboratory knows about its starts, clock and lengths, as [known_to] tables.
    """
    session = drawn.session
    (folder / "marks").mkdir(parents=True)
    lines = ["format = 1", 'name = "session"', 'robot = "robot.toml"']
    for run, (times, marks) in enumerate(recorded(session, rng)):
        name = run_name(run)
        lines += ["", "[[run]]", f'id = "{name}"', *command_lines(session, run), f'marks = "marks/{name}.csv"']
        (folder / "marks" / f"{name}.csv").write_text(_marks_csv(times, marks), encoding="utf-8")
    if known_to:
        lines += ["", "[known_to]", *(f"{key} = {value}" for key, value in KNOWN_TO.items())]
    (folder / "experiment.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / "robot.toml").write_text(robot_toml(session.said, known_to=known_to), encoding="utf-8")
    truth_folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(drawn.truth, indent=1, default=float)
    (truth_folder / f"{folder.name}.json").write_text(text + "\n", encoding="utf-8")


def _commands(rng: np.random.Generator, count: int) -> Array:
    """Commands that a sensible plan would have: left, right rpm, (2, runs)."""
    slow, fast = float(rng.choice([6.0, 10.0, 15.0])), float(rng.choice([60.0, 75.0, 90.0]))
    straight = [(slow, slow), (30.0, 30.0), (fast, fast)]
    tight, wide = float(rng.choice([5.0, 10.0, 14.4])), float(rng.choice([22.0, 25.0, 29.0]))
    turns = [(33.3, tight), (33.3, wide), (fast, 0.6 * fast)]
    both = straight + turns + [(b, a) for a, b in turns]
    base = [(sign * a, sign * b) for a, b in both for sign in (1, -1)]  # 18 commands
    order = rng.permutation(len(base))
    must = [base[i] for i in order][: min(count, len(base))]
    again = [base[i] for i in rng.integers(0, len(base), max(count - len(base), 0))]
    commands = np.array(must + again)
    return np.array(rng.permutation(commands, axis=0).T)


def _robot(rng: np.random.Generator) -> Robot:
    """A robot of the paper's kind, its geometry and slip law not always the same."""
    return Robot(
        mass_g=round(float(rng.uniform(0.45, 0.6)), 3),
        wheelbase_mm=round(float(rng.uniform(3.6, 4.4)), 2),
        track_mm=round(float(rng.uniform(3.6, 4.6)), 2),
        driving_attraction_mN=round(float(rng.uniform(16, 26)), 2),
        driven_attraction_mN=round(float(rng.uniform(2, 5)), 2),
        friction_x=round(float(rng.uniform(0.14, 0.2)), 3),
        friction_y=round(float(rng.uniform(0.22, 0.32)), 3),
    )


def run_name(run: int) -> str:
    return f"r{run + 1:02d}"


def _run_for(name: str, session: Session, rng: np.random.Generator) -> int:
    """A run in which the mistake shows: one that turns, where sides or a mirror image are concerned.

    A late start shows where the recording begins before the motors: later frames hold the same motion at other places.
    """
    turning = np.abs(np.abs(session.said_rpm[0]) - np.abs(session.said_rpm[1])) > 4
    fits = turning if name in {"sides-swapped", "mirrored", "wrong-command"} else np.ones(session.runs, dtype=bool)
    if name == "late-start":
        fits = session.begin_s < session.start_s
    return int(rng.choice(np.flatnonzero(fits)))


def _two(rng: np.random.Generator) -> list[str]:
    while True:
        pair = [str(name) for name in rng.choice(EFFECTS, 2, replace=False)]
        if not any(set(pair) <= alike for alike in ALIKE):
            return pair


def _with_effects(
    messy: Session, plain: Session, effects: list[str], rng: np.random.Generator
) -> tuple[Session, dict[str, Any], dict[str, Any]]:
    session, truth, sizes = messy, {}, {}
    for effect in effects:
        at = at_size(effect, messy, rng)
        size, measured = sized(messy, plain, lambda s, e=effect, a=at: with_effect(messy, e, a(s)), rng)
        session = with_effect(session, effect, at(size))
        truth[effect], sizes[effect] = at(size), {**measured, "size": size}
    return session, truth, sizes


def command_lines(session: Session, run: int) -> list[str]:
    left, right = session.said_rpm[:, run]
    lines = [f"left_rpm = {left:.4g}", f"right_rpm = {right:.4g}", f"start_s = {session.start_s[run]:.3f}"]
    if np.isfinite(session.stop_s[run]):
        lines.append(f"stop_s = {session.stop_s[run]:.3f}")
    return lines


def _marks_csv(times: Array, marks: Array) -> str:
    rows = ["time_s,green_x_mm,green_y_mm,yellow_x_mm,yellow_y_mm"]
    for time, values in zip(times, marks.T, strict=True):
        cells = ["" if np.isnan(value) else f"{value:.8g}" if abs(value) < 1 else f"{value:.5f}" for value in values]
        rows.append(",".join([f"{time:.6f}".rstrip("0").rstrip("."), *cells]))
    return "\n".join(rows) + "\n"


def robot_toml(robot: Robot, *, known_to: bool) -> str:
    tables = {
        "body": {"mass_g": robot.mass_g, "length_mm": 5.0, "width_mm": 9.0, "height_mm": 6.5},
        "wheels": {
            "wheelbase_mm": robot.wheelbase_mm,
            "track_mm": robot.track_mm,
            "radius_mm": robot.wheel_radius_mm,
        },
        "magnetic_attraction": {
            "driving_wheel_mN": robot.driving_attraction_mN,
            "driven_wheel_mN": robot.driven_attraction_mN,
        },
        "slip": {
            "longitudinal_friction": robot.friction_x,
            "lateral_friction": robot.friction_y,
            "friction_decrease": robot.friction_decrease,
            "longitudinal_shape": robot.shape_x,
            "lateral_shape": robot.shape_y,
            "longitudinal_stiffness": robot.stiffness_x,
            "lateral_stiffness": robot.stiffness_y,
            "stiffness_basis": robot.stiffness_basis,
        },
        "marks": {
            "green_mm": list(robot.green_mm),
            "yellow_mm": list(robot.yellow_mm),
            "diameter_mm": 1.0,
            "height_mm": 6.5,
        },
        "tolerance": TOLERANCES,
    }
    if known_to:
        tables["known_to"] = ROBOT_KNOWN_TO
    lines = ["format = 1", 'name = "robot of the session"']
    for name, values in tables.items():
        lines += ["", f"[{name}]"]
        lines += [f"{json.dumps(k) if '.' in k else k} = {json.dumps(v)}" for k, v in values.items()]
    return "\n".join(lines) + "\n"
