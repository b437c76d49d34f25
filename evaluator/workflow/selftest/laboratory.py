"""Inputs of the self-test: scenes to render, and an experiment with a hidden effect and usual mistakes.

Random numbers come from a seed, so that a maintainer can reproduce the result of a user.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from evaluator.files import write_text
from evaluator.files.csv_tables import write_table
from evaluator.workflow.rendering import SceneOrder, read_scene
from evaluator.workflow.samples import sample_folder

if TYPE_CHECKING:
    from simulator.robot import Robot

TURN_RPM = (33.3, 14.4)  # the turn of the paper's Figure 19
TURN_S = 6.0  # two thirds of a full circle: enough for the radius, a third of the frames of a sample recording
HIDDEN, PARAMETER, SIZE = "axle-compliance", "deg_per_mN", 1.1  # as in the puzzle of the samples
LATE_S = 0.015  # of all starts in the file
SWAPPED = 3  # index of the run whose sides are exchanged in the file
NOISE_MM = 0.004  # of a mark's coordinate: 0.06 px at 16 px/mm
FRICTION, SPEED = 0.01, 0.003  # scatter between runs, relative
RUN_S, RATE_HZ, START_S = 5.0, 30, 0.3  # length of a run, frames a second, motors on
COMMANDS_RPM = (
    (33.3, 14.4), (14.4, 33.3), (-33.3, -14.4), (-14.4, -33.3), (33.0, 5.0), (5.0, 33.0), (-33.0, -5.0), (-5.0, -33.0),
    (40.0, 40.0), (-40.0, -40.0), (50.0, 21.6), (-50.0, -21.6),
)  # fmt: skip


@dataclass(frozen=True)
class HiddenEffect:
    """An experiment file, and the id of the run whose sides are exchanged in it."""

    experiment: Path
    swapped: str


def gauge_orders(folder: Path, seed: int) -> list[SceneOrder]:
    """The gauge images of the samples, with other noise."""
    recipes = sorted((sample_folder() / "recipes").glob("gauge-*.toml"))
    return [_order(recipe, folder, seed + number, {}) for number, recipe in enumerate(recipes)]


def turn_order(folder: Path, seed: int) -> SceneOrder:
    """A clip of one turn to the left, with other noise."""
    return _order(sample_folder() / "recipes" / "turn-33.3-14.4.toml", folder, seed + 100, {"duration_s": TURN_S})


def _order(recipe: Path, folder: Path, seed: int, changed: dict[str, object]) -> SceneOrder:
    order = read_scene(recipe)
    scene = order.scene.model_copy(update={"seed": seed, **changed})
    return replace(
        order, scene=scene, output=folder / order.output.name, truth=folder / f"{order.output.stem}-truth.csv"
    )


def write_turn(folder: Path, marks: Path) -> Path:
    """The experiment of the one rendered turn, from its tracked marks."""
    left, right = TURN_RPM
    text = (
        'format = 1\nname = "self-test: a turn"\nrobot = "barrel"\n\n'
        f'[[run]]\nid = "turn"\nleft_rpm = {left}\nright_rpm = {right}\nstart_s = 0.5\nmarks = "{marks.name}"\n'
    )
    write_text(folder / "turn.toml", text)
    return folder / "turn.toml"


def write_hidden_effect(folder: Path, seed: int) -> HiddenEffect:
    """Simulate runs of a robot with a hidden effect and usual mistakes, and write the files of such an experiment."""
    from simulator.robot import load_robot

    rng = np.random.default_rng(seed)
    robot_file = sample_folder() / "puzzle" / "robot.toml"
    write_text(folder / "robot.toml", robot_file.read_text(encoding="utf-8"))
    robot = load_robot(robot_file)
    runs = ['format = 1\nname = "self-test: a hidden effect"\nrobot = "robot.toml"\n']
    for number, (left, right) in enumerate(COMMANDS_RPM):
        write_table(_marks(robot, (left, right), rng), folder / f"h{number:02d}.csv")
        stated = (right, left) if number == SWAPPED else (left, right)
        runs.append(
            f'[[run]]\nid = "h{number:02d}"\nleft_rpm = {stated[0]}\nright_rpm = {stated[1]}\n'
            f'start_s = {START_S + LATE_S}\nmarks = "h{number:02d}.csv"\n'
        )
    write_text(folder / "hidden.toml", "\n".join(runs))
    return HiddenEffect(folder / "hidden.toml", f"h{SWAPPED:02d}")


def _marks(robot: Robot, rpm: tuple[float, float], rng: np.random.Generator) -> pd.DataFrame:
    """Marks of one run with its own friction and speed, with noise."""
    from simulator.command import Command
    from simulator.effects.entry import EffectEntry
    from simulator.observation import marks_of_run
    from simulator.run import State
    from simulator.simulation import simulate

    values = {
        HIDDEN: {PARAMETER: SIZE},
        "friction-level": {"factor": 1.0 + FRICTION * rng.normal()},
        "drive-speed-scale": {"factor": 1.0 + SPEED * rng.normal()},
    }
    effects = tuple(EffectEntry.model_validate({"id": effect, **given}) for effect, given in values.items())
    own = robot.model_copy(update={"effect": effects})
    pose = State(rng.uniform(-6.0, 6.0), rng.uniform(-6.0, 6.0), rng.uniform(-math.pi, math.pi))
    times_s = np.arange(int(RUN_S * RATE_HZ)) / RATE_HZ
    marks = marks_of_run(own, simulate(own, Command.constant(*rpm, START_S), times_s, pose))
    places = list(marks.columns.drop("time_s"))
    marks[places] += NOISE_MM * rng.normal(size=(len(marks), len(places)))
    return marks
