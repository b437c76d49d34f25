"""Simulated motions of a robot with changed parameters or effects, fast enough for sliders."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from evaluator.errors import InputError
from evaluator.files import explain, read_with
from simulator.command import Command
from simulator.effects.catalogue import BUILT_IN, EFFECTS
from simulator.effects.free_form import ID as FREE_FORM
from simulator.effects.parameter import UNITS, Parameter
from simulator.observation import seen_of_run, view_of
from simulator.own_effects.files import load_beside
from simulator.robot import Robot, load_robot, shipped_robot_text, shipped_robots
from simulator.run import Run
from simulator.simulation import simulate

Array = NDArray[np.float64]
RATE_HZ = 20.0  # of a drawn path: its chords are 0.1 mm long
STEPS = 40  # steps to either side of absent, unless the catalogue has narrower bounds
SLIDER_STEPS = 200  # as many as a slider on a screen has pixels
MOST_RUNS, LONGEST_S = 60, 60.0  # of a request
SETTLED = 0.8  # share of a run after which its turn is evaluated
STRAIGHT_PER_MM = 1e-5  # a circle of 100 m

# Nominal values with sliders: key, words, unit; from half of nominal to twice of it.
NOMINAL = (
    ("body.mass_g", "mass", "g"),
    ("wheels.wheelbase_mm", "wheelbase", "mm"),
    ("wheels.track_mm", "track", "mm"),
    ("wheels.radius_mm", "wheel radius", "mm"),
    ("magnetic_attraction.driving_wheel_mN", "attraction of driving wheels", "mN"),
    ("magnetic_attraction.driven_wheel_mN", "attraction of driven wheels", "mN"),
    ("slip.longitudinal_friction", "longitudinal friction", ""),
    ("slip.lateral_friction", "lateral friction", ""),
    ("slip.longitudinal_stiffness", "longitudinal stiffness", ""),
    ("slip.lateral_stiffness", "lateral stiffness", ""),
)


@dataclass(frozen=True)
class Slider:
    """A slider: key, label, unit, bounds, step and initial value."""

    key: str
    words: str
    unit: str
    low: float
    high: float
    step: float
    value: float


@dataclass(frozen=True)
class EffectSliders:
    """An effect of the catalogue with a slider for each parameter."""

    id: str
    name: str
    sentence: str
    law: str
    kind: str
    sliders: tuple[Slider, ...]


def effect_sliders(experiment: Path | None = None) -> list[EffectSliders]:
    """Sliders of all effects of the catalogue and of those beside an experiment, initially at their defaults."""
    own = () if experiment is None else load_beside(experiment.parent)
    return [
        EffectSliders(e.id, e.name, e.sentence, e.law, e.kind, tuple(_slider(parameter) for parameter in e.parameters))
        for e in (*BUILT_IN.values(), *(EFFECTS[id_] for id_ in own))
    ]


def robot_names() -> tuple[str, ...]:
    """The shipped robots."""
    return shipped_robots()


def body_mm(robot: Path | str) -> dict[str, float]:
    """Length and width of a robot, mm, for its outline in drawings."""
    body = _robot(robot).body
    return {"length_mm": body.length_mm, "width_mm": body.width_mm}


def robot_sliders(robot: Path | str) -> list[Slider]:
    """Sliders of the nominal values that a robot has."""
    described = _robot(robot).model_dump(mode="json")
    found = []
    for key, words, unit in NOMINAL:
        table, name = key.split(".")
        value = (described.get(table) or {}).get(name)
        if isinstance(value, int | float) and value > 0:
            found.append(Slider(key, words, unit, value / 2, 2 * value, 1.5 * value / SLIDER_STEPS, value))
    return found


def sandbox_motions(
    robot: Path | str,
    commands: Sequence[tuple[float, float]],
    *,
    nominal: Mapping[str, float],
    effects: Mapping[str, Mapping[str, float]],
    duration_s: float,
) -> list[dict[str, Any]]:
    """Simulated path of every command (left, right rpm) from rest at the origin, for a changed robot.

    nominal: values by dotted key; effects: parameters by id, added to those of the robot or replacing them. Returns
    x_mm, y_mm as they would be measured, radius_mm (None if straight), speed_mm_s.
    Raises InputError for invalid values, SimulationError for a motion that cannot be simulated.
    """
    if not (0 < duration_s <= LONGEST_S) or len(commands) > MOST_RUNS:
        raise InputError(f"at most {MOST_RUNS} runs of {LONGEST_S:g} s are drawn")
    changed = _changed(_robot(robot), nominal, effects)
    times = np.arange(round(duration_s * RATE_HZ) + 1) / RATE_HZ
    return [_motion(changed, left, right, times) for left, right in commands]


def _motion(robot: Robot, left: float, right: float, times: np.ndarray) -> dict[str, Any]:
    run = simulate(robot, Command.constant(left, right), times)
    seen_x, seen_y = _seen(robot, run)
    late = run.time_s >= SETTLED * run.time_s[-1]
    speed = float(np.mean(np.hypot(run.u_mm_s[late], run.v_mm_s[late])))
    curvature = float(np.mean(run.yaw_rate_rad_s[late])) / speed if speed > 0 else 0.0
    return {
        "left_rpm": left,
        "right_rpm": right,
        "x_mm": np.round(seen_x, 4).tolist(),
        "y_mm": np.round(seen_y, 4).tolist(),
        "radius_mm": abs(1 / curvature) if abs(curvature) > STRAIGHT_PER_MM else None,
        "speed_mm_s": speed,
        "yaw_rate_deg_s": float(np.degrees(np.mean(run.yaw_rate_rad_s[late]))),
    }


def _seen(robot: Robot, run: Run) -> tuple[Array, Array]:
    """Measured position of the centre, which errors of the observed marks displace like a point of the robot."""
    (place,) = seen_of_run(view_of(robot, [(0.0, 0.0)]), run)
    return place[:, 0], place[:, 1]


def _changed(robot: Robot, nominal: Mapping[str, float], effects: Mapping[str, Mapping[str, float]]) -> Robot:
    content = robot.model_dump(mode="json", exclude_unset=True, exclude={"effect"})
    for key, value in nominal.items():
        table, _, name = key.partition(".")
        if not isinstance(content.get(table), dict) or name not in content[table]:
            raise InputError(f"{key}: this robot has no such value")
        content[table][name] = value
    kept = [entry for entry in robot.effect if entry.id not in effects or entry.id == FREE_FORM]
    content["effect"] = [{"id": entry.id, **entry.given} for entry in kept]
    content["effect"] += [{"id": id_, **values} for id_, values in effects.items()]
    try:
        return Robot.model_validate(content)
    except ValidationError as error:
        raise InputError(explain(error, load_robot)) from error


def _robot(robot: Path | str) -> Robot:
    if isinstance(robot, Path):
        found: Robot = read_with(load_robot, robot)
        return found
    return Robot.model_validate(tomllib.loads(shipped_robot_text(robot)))


def _slider(parameter: Parameter) -> Slider:
    reach = max(2 * abs(parameter.shown_value - parameter.absent), STEPS * parameter.step)
    low = max(parameter.low, parameter.at_least, parameter.absent - reach)
    high = min(parameter.high, parameter.absent + reach)
    unit = UNITS[parameter.unit]
    words = parameter.name.removesuffix(unit.ending).rstrip("_") or parameter.name
    step = (high - low) / SLIDER_STEPS
    return Slider(parameter.name, words.replace("_", " "), unit.shown, low, high, step, parameter.absent)
