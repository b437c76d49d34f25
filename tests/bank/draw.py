"""Experiments with hidden effects: marks and commands for the diagnosis, labels for the scorer alone."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from simulator.command import Command
from simulator.effects.entry import EffectEntry
from simulator.observation import marks_of_run, view_of
from simulator.robot import Robot, load_robot
from simulator.run import State
from simulator.simulation import simulate
from tests.bank.outside import KINDS, marks_of

Array = NDArray[np.float64]

# Sizes from just detectable to large; a sign or a direction is drawn where it has one.
SIZES: dict[str, dict[str, tuple[float, float]]] = {
    "drive-speed-mismatch": {"left_over_right": (0.01, 0.08)},
    "drive-speed-scale": {"factor": (0.01, 0.08)},
    "motor-droop": {"rpm_per_uN_mm": (5e-4, 5e-3)},
    "command-lag": {"dead_time_s": (0.02, 0.2), "time_constant_s": (0.02, 0.3)},
    "speed-ripple": {"amplitude": (0.01, 0.1), "phase_deg": (-180, 180)},
    "speed-drift": {"per_run": (0.001, 0.005)},
    "magnet-imbalance": {"left_over_right": (0.05, 0.4)},
    "magnet-strength": {"driving_factor": (0.05, 0.3), "driven_factor": (0.1, 0.6)},
    "friction-level": {"factor": (0.05, 0.3)},
    "wheel-toe": {"left_deg": (0.5, 4), "right_deg": (0.5, 4)},
    "rolling-drag": {"coefficient": (0.01, 0.1)},
    "scrub-torque": {"radius_mm": (0.02, 0.2)},
    "axle-compliance": {"deg_per_mN": (0.15, 1.2)},
    "mass-offset": {"x_mm": (0.3, 1.2), "y_mm": (0.3, 1.2)},
    "plate-tilt": {"angle_deg": (1.5, 10), "azimuth_deg": (-180, 180)},
    "tether-pull": {"x_mN": (0.2, 1.0), "y_mN": (0.1, 0.8)},
    "tether-spring": {"stiffness_mN_mm": (0.01, 0.06), "anchor_x_mm": (5, 25), "anchor_y_mm": (5, 25)},
    "viscous-drag": {"force_mN_s_mm": (0.05, 0.5), "moment_uN_mm_s": (500, 5000)},
    "friction-gradient": {"per_mm_x": (0.002, 0.01), "per_mm_y": (0.002, 0.01)},
    "friction-grain": {"amplitude": (0.04, 0.3), "direction_deg": (-90, 90)},
    "stray-magnet": {"force_mN": (0.15, 1.0), "x_mm": (5, 20), "y_mm": (5, 20)},
    "mark-offset": {"x_mm": (0.05, 0.4), "y_mm": (0.05, 0.4), "angle_deg": (0.3, 3)},
    "plane-scale": {"factor": (0.005, 0.04)},
    "time-base": {"factor": (0.01, 0.05)},
    "camera-tilt": {"per_mm_x": (2e-4, 1.5e-3), "per_mm_y": (2e-4, 1.5e-3)},
    "rolling-shutter": {"x_ms_per_mm": (0.1, 0.6), "y_ms_per_mm": (0.1, 0.6)},
}
SIGNED = {"per_run", "x_mm", "y_mm", "left_deg", "right_deg", "deg_per_mN", "x_mN", "y_mN", "anchor_x_mm",
          "anchor_y_mm", "per_mm_x", "per_mm_y", "angle_deg", "x_ms_per_mm", "y_ms_per_mm"}  # fmt: skip
COMMANDS = [(30, 30), (60, 60), (-30, -30), (-60, -60), (33.3, 14.4), (14.4, 33.3), (-33.3, -14.4), (-14.4, -33.3),
            (60, 40), (40, 60), (-60, -40), (-40, -60)]  # fmt: skip
PROPOSED_START_S = 0.5
TOLERANCE = {"slip.lateral_friction": 0.03, "slip.longitudinal_friction": 0.03}


@dataclass(frozen=True)
class Hidden:
    """What the runs of an experiment have in common and the diagnosis is not told."""

    robot: Robot  # with the effects in it
    outside: str  # kind of physics that is in no list
    size: float
    friction: float  # relative scatter from run to run, of friction and of the wheels' gains
    gain: float
    sigma_mm: float  # tracking noise and its correlation from frame to frame
    decay: float


@dataclass(frozen=True)
class Drawn:
    """An experiment's folder, the label that only the scorer reads, and what more runs would hide."""

    folder: Path
    label: dict[str, Any]
    hidden: Hidden


def draw(rng: np.random.Generator, kind: str, folder: Path, name: str = "") -> Drawn:
    """Write one experiment: kind is "clean", "single", "pair" or "outside"; name: of a single or outside effect."""
    ids = [name] if kind == "single" and name else []
    wanted = {"clean": 0, "single": 1, "pair": 2, "outside": 0}[kind]
    while len(ids) < wanted:
        ids = [str(item) for item in rng.choice(sorted(SIZES), size=wanted, replace=False)]
    effects = {item: sized(rng, item) for item in ids}
    outside, size = "", 0.0
    if kind == "outside":
        outside = name or str(rng.choice(sorted(KINDS)))
        _, low, high = KINDS[outside]
        size = float(np.exp(rng.uniform(np.log(low), np.log(high))))
    hidden, shifts = _write(rng, folder, effects, outside, size)
    scatter = np.array([hidden.friction, hidden.gain, hidden.gain])
    label = {"kind": kind, "effects": effects, "outside": outside, "size": size, "shifts": shifts, "scatter": scatter}
    return Drawn(folder, label, hidden)


def repeated(rng: np.random.Generator, drawn: Drawn, proposed: list[dict[str, Any]]) -> Drawn:
    """The experiment with runs appended, as its diagnosis proposed them, made by the same robot; proposed: the runs of
    next_experiment in diagnosis.json. People put a robot down to within a millimetre and a few degrees.
    """
    path = drawn.folder / "experiment.toml"
    text, shifts = path.read_text(encoding="utf-8"), {key: list(value) for key, value in drawn.label["shifts"].items()}
    for number, run in enumerate([item for item in proposed for _ in range(item["times"])], text.count("[[run]]")):
        moments = np.arange(int((run["duration_s"] + PROPOSED_START_S) * 60)) / 60
        place = np.array([run["x_mm"], run["y_mm"]]) + rng.normal(size=2)
        pose = (*place, np.radians(run["heading_deg"] + 3 * rng.normal()))
        command = (run["left_rpm"], run["right_rpm"])
        text += "\n" + _run(rng, drawn.folder, drawn.hidden, shifts, number, command, PROPOSED_START_S, moments, pose)
    path.write_text(text, encoding="utf-8")
    return Drawn(drawn.folder, {**drawn.label, "shifts": shifts}, drawn.hidden)


def sized(rng: np.random.Generator, effect: str, least: float = 0.0) -> dict[str, float]:
    """Parameters of an effect, even in the logarithm of their range; the share least of it is left out below."""
    values = {}
    for name, (lowest, high) in SIZES[effect].items():
        low = lowest if lowest < 0 else lowest * (high / lowest) ** least
        size = rng.uniform(low, high) if low < 0 else float(np.exp(rng.uniform(np.log(low), np.log(high))))
        sign = rng.choice([-1, 1])
        if name in ("left_over_right", "factor", "driving_factor", "driven_factor"):
            size = 1 + sign * size
        elif name in SIGNED and not (effect == "plate-tilt" and name == "angle_deg"):
            size = sign * size
        values[name] = float(size)
    return values


def _write(
    rng: np.random.Generator, folder: Path, effects: dict[str, Any], outside: str, size: float
) -> tuple[Hidden, dict[str, list[Array]]]:
    """Write an experiment; gives what it hides and, for the scorer, what each hidden effect does to the marks (n, 4)
    of every run, mm.
    """
    folder.mkdir(parents=True)
    shifts: dict[str, list[Array]] = {name: [] for name in (effects or ([outside] if outside else []))}
    nominal = load_robot("barrel")
    true = slip_changed(nominal, {key.split(".")[1]: 1 + rng.normal() * tol for key, tol in TOLERANCE.items()})
    true = true.model_copy(update={"effect": tuple(EffectEntry(id=key, **values) for key, values in effects.items())})
    runs, count = ['format = 1\nname = "drawn"\nrobot = "robot.toml"\n'], int(rng.integers(16, 25))
    sigma, decay = float(np.exp(rng.uniform(np.log(0.002), np.log(0.008)))), rng.uniform(0.3, 0.92)
    hidden = Hidden(true, outside, size, rng.uniform(0.005, 0.03), rng.uniform(0.001, 0.006), sigma, decay)
    for number in range(count):
        start, moments = round(float(rng.uniform(0.0, 0.6)), 3), np.arange(int(rng.uniform(6, 10) * 60)) / 60
        runs.append(_run(rng, folder, hidden, shifts, number, COMMANDS[number % len(COMMANDS)], start, moments))
    (folder / "experiment.toml").write_text("\n".join(runs), encoding="utf-8")
    (folder / "robot.toml").write_text(robot_text(), encoding="utf-8")
    return hidden, shifts


def _run(
    rng: np.random.Generator,
    folder: Path,
    hidden: Hidden,
    shifts: dict[str, list[Array]],
    number: int,
    command_rpm: tuple[float, float],
    start: float,
    time: Array,
    pose: tuple[float, float, float] | None = None,
) -> str:
    """Write the marks of one run, append to shifts; gives its table of experiment.toml. pose: drawn where not given."""
    share, gains = 1 + rng.normal() * hidden.friction, 1 + rng.normal(size=2) * hidden.gain
    own = slip_changed(hidden.robot, {"lateral_friction": share, "longitudinal_friction": share})
    if pose is None:
        pose = (rng.uniform(-12, 12), rng.uniform(-12, 12), rng.uniform(-np.pi, np.pi))
    left, right = command_rpm
    rpm = (left * gains[0], right * gains[1])
    if hidden.outside:
        kind = KINDS[hidden.outside][0]
        bare = marks_of(own, kind, 0.0, rpm, start, time, pose)
        marks = np.column_stack([time, marks_of(own, kind, hidden.size, rpm, start, time, pose)])
        shifts[hidden.outside].append(marks[:, 1:] - bare)
    else:
        command = Command.constant(*rpm, start)
        marks = seen(own, command, time, pose, number)
        for name, of_runs in shifts.items():
            less = own.model_copy(update={"effect": tuple(item for item in own.effect if item.id != name)})
            same_frames = marks[:, 0] / view_of(less).time_factor  # a wrong clock shows at the times it writes
            of_runs.append((marks - seen(less, command, same_frames, pose, number))[:, 1:])
    white = rng.normal(size=(len(time) + 300, 4)) * np.sqrt(1 - hidden.decay**2)
    marks[:, 1:] += hidden.sigma_mm * np.asarray(lfilter([1], [1, -hidden.decay], white, axis=0))[300:]
    header = "time_s,green_x_mm,green_y_mm,yellow_x_mm,yellow_y_mm"
    np.savetxt(folder / f"r{number:02d}.csv", marks, "%.6f", ",", header=header, comments="")
    return (f'[[run]]\nid = "r{number:02d}"\nleft_rpm = {left}\nright_rpm = {right}\nstart_s = {start}\n'
            f'marks = "r{number:02d}.csv"\n')  # fmt: skip


def seen(robot: Robot, command: Command, time_s: Array, pose: tuple[float, float, float], number: int) -> Array:
    """Time and marks, (n, 5), of a run of this number."""
    run = simulate(robot, command, time_s, State(*pose), run_index=number)
    return marks_of_run(robot, run).to_numpy(copy=True)


def slip_changed(robot: Robot, factors: dict[str, float]) -> Robot:
    """The robot with values of its slip law multiplied by factors."""
    slip = robot.slip.model_copy(update={key: getattr(robot.slip, key) * factor for key, factor in factors.items()})
    return robot.model_copy(update={"slip": slip})


def robot_text() -> str:
    """The robot file that the diagnosis gets: nominal values and the tolerances they were drawn from."""
    text = (Path(__file__).parents[2] / "simulator" / "robots" / "barrel.toml").read_text(encoding="utf-8")
    lines = [f"{json.dumps(key)} = {value}" for key, value in TOLERANCE.items()]
    return "\n".join([text, "[tolerance]", *lines, ""])
