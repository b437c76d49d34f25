"""Small experiments with a hidden effect: marks as a tracker would write them, from the simulator."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.candidates.coordinates import named_terms
from evaluator.diagnosis.candidates.free_form import free_terms
from evaluator.diagnosis.experiment import Session, session_of
from evaluator.settings import load_experiment
from simulator.command import Command
from simulator.effects.entry import EffectEntry
from simulator.observation import marks_of_run
from simulator.robot import load_robot, shipped_robot_text
from simulator.run import State
from simulator.simulation import simulate

COMMANDS = (
    *((30.0, 30.0), (-30.0, -30.0), (33.3, 14.4), (14.4, 33.3), (-33.3, -14.4), (-14.4, -33.3)),
    *((60.0, 40.0), (-40.0, -60.0)),
)
ATTRACTION = ("magnetic_attraction.driving_wheel_mN", "magnetic_attraction.driven_wheel_mN")
LENGTHS = ("wheel_radius_mm", "wheelbase_mm", "track_mm", "mass_g", "mark_position_mm", "center_of_gravity_mm")
ROBOT_EXACTLY = ("[known_to]", *(f"{name} = 0.0" for name in (*LENGTHS, "plate_level_deg")))
TIMES = ("start_common_s", "start_per_run_s", "time_base", "plane_scale")
SESSION_EXACTLY = ("[known_to]", *(f"{name} = 0.0" for name in TIMES))
SIGMA_MM, FRICTION, GAIN = 0.004, 0.01, 0.002


def write_hidden(
    folder: Path,
    effects: Mapping[str, Mapping[str, float]],
    *,
    commands: Sequence[tuple[float, float]] = COMMANDS,
    tolerance: Mapping[str, float] | None = None,
    sigma_mm: float = SIGMA_MM,
    error_mm: float = 0.0,
    seed: int = 3,
    seconds: float = 6.0,
    exact: bool = False,
) -> Path:
    """An experiment.toml over runs of the barrel robot with effects that its robot.toml does not have.

    sigma_mm: tracking noise; error_mm: a slow wave in all marks, as steps of another simulator would leave. exact: of a
    laboratory that knows everything exactly, which has a fifth of the parameters and is diagnosed in a third of the
    time.
    """
    rng = np.random.default_rng(seed)
    true = load_robot("barrel")
    true = true.model_copy(
        update={"effect": tuple(EffectEntry.model_validate({"id": key, **values}) for key, values in effects.items())}
    )
    folder.mkdir(parents=True, exist_ok=True)
    tolerance = {**(dict.fromkeys(ATTRACTION, 0.0) if exact else {}), **(tolerance or {})}
    stated = [f'"{key}" = {value}' for key, value in tolerance.items()]
    (folder / "robot.toml").write_text(
        "\n".join(
            [
                shipped_robot_text("barrel"),
                *(["[tolerance]"] if stated else []),
                *stated,
                *(ROBOT_EXACTLY if exact else ()),
                "",
            ]
        ),
        encoding="utf-8",
    )
    lines = ["format = 1", 'name = "hidden"', 'robot = "robot.toml"', *(SESSION_EXACTLY if exact else ())]
    for number, (left, right) in enumerate(commands):
        time = np.arange(round(30 * seconds)) / 30
        share, gains = 1 + FRICTION * rng.normal(), 1 + GAIN * rng.normal(size=2)
        slip = {name: getattr(true.slip, name) * share for name in ("lateral_friction", "longitudinal_friction")}
        own = true.model_copy(update={"slip": true.slip.model_copy(update=slip)})
        pose = State(*rng.uniform(-8, 8, 2), rng.uniform(-np.pi, np.pi))
        run = simulate(own, Command.constant(left * gains[0], right * gains[1], 0.3), time, pose, run_index=number)
        marks = marks_of_run(own, run)
        marks.iloc[:, 1:] += rng.normal(0, sigma_mm, (len(marks), 4)) + error_mm * np.sin(time)[:, None]
        marks.to_csv(folder / f"r{number}.csv", index=False)
        lines += ["", "[[run]]", f'id = "r{number}"', f"left_rpm = {left}", f"right_rpm = {right}", "start_s = 0.3"]
        lines.append(f'marks = "r{number}.csv"')
    path = folder / "experiment.toml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def offer_few(monkeypatch: pytest.MonkeyPatch, named: Collection[str], channels: tuple[str, ...]) -> None:
    """Offer the searches of this process few effects, those of the user, and free-form terms of some channels.

    For tests of what a search does, not of what it tells apart: that takes a tenth of the candidates and of the time.
    """

    def few_named(reach: float, levels: tuple[float, ...], own: Sequence[str], *how: Any, **more: Any) -> Any:
        every = named_terms(reach, levels, own, *how, **more)
        return {effect: term for effect, term in every.items() if effect in (*named, *own)}

    def few_free(*how: Any, **more: Any) -> Any:
        begins = tuple(f"free:{channel}." for channel in channels)
        return {form: term for form, term in free_terms(*how, **more).items() if form.startswith(begins)}

    monkeypatch.setattr("evaluator.diagnosis.search_input.named_terms", few_named)
    monkeypatch.setattr("evaluator.diagnosis.search_input.free_terms", few_free)


def hidden_session(
    folder: Path, effects: Mapping[str, Mapping[str, float]], seed: int = 3, *, exact: bool = False
) -> Session:
    """The runs of `write_hidden` as a diagnosis reads them; exact: of a laboratory that knows everything exactly."""
    experiment = load_experiment(write_hidden(folder, effects, seed=seed))
    session = session_of(experiment, {run.id: run.marks for run in experiment.run if run.marks is not None})
    return (
        replace(session, known=(), start_sigma_s=0.0, data=tuple(replace(run, systematic={}) for run in session.data))
        if exact
        else session
    )
