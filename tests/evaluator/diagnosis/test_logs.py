"""A diagnosis from poses and logs of commands alone: several phases in one run, a clock that is off, late motors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from evaluator.workflow.diagnosis.experiment import diagnose_experiment
from simulator.command import Command
from simulator.effects.entry import EffectEntry
from simulator.robot import load_robot, shipped_robot_text
from simulator.run import State
from simulator.simulation import simulate
from tests.evaluator.diagnosis.hidden import ATTRACTION, COMMANDS, ROBOT_EXACTLY, offer_few

SIGMA_MM, SIGMA_RAD = 0.004, 0.002
DEAD_S, LAG_S = 0.15, 0.10
LIKE_LATE = ("command-lag", "drive-speed-scale", "friction-level", "time-base", "viscous-drag"), ("speed",)


def session_of_poses(folder: Path, effects: dict[str, dict[str, float]], late_s: float, more: str) -> Path:
    """Six runs of two phases each, forward and back or the other way, of a robot known exactly: poses and logs."""
    rng = np.random.default_rng(5)
    robot = load_robot("barrel")
    entries = tuple(EffectEntry.model_validate({"id": name, **values}) for name, values in effects.items())
    true = robot.model_copy(update={"effect": entries})
    exactly = ["[tolerance]", *(f'"{name}" = 0.0' for name in ATTRACTION), *ROBOT_EXACTLY, ""]
    (folder / "robot.toml").write_text("\n".join([shipped_robot_text("barrel"), *exactly]), encoding="utf-8")
    lines = ["format = 1", 'name = "poses and logs"', 'robot = "robot.toml"', more]
    for number, (left, right) in enumerate(COMMANDS[:6]):
        rows = [(0.3, left, right), (3.0, 0.0, 0.0), (3.5, -right, -left)]
        log = pd.DataFrame(rows, columns=["time_s", "left_rpm", "right_rpm"])
        log.to_csv(folder / f"c{number}.csv", index=False)
        command = Command.steps(rows).retimed(later_s=late_s)
        times = np.arange(180) / 30
        run = simulate(true, command, times, State(*rng.uniform(-8, 8, 2), rng.uniform(-3, 3)), run_index=number)
        noise = rng.normal(0, 1, (3, len(times)))
        poses = {
            "time_s": times,
            "x_mm": run.x_mm + SIGMA_MM * noise[0],
            "y_mm": run.y_mm + SIGMA_MM * noise[1],
            "heading_rad": run.heading_rad + SIGMA_RAD * noise[2],
        }
        pd.DataFrame(poses).to_csv(folder / f"p{number}.csv", index=False)
        lines += ["[[run]]", f'id = "r{number}"', f'commands = "c{number}.csv"', f'poses = "p{number}.csv"']
    path = folder / "experiment.toml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def late_motors(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("late")
    effects = {"command-lag": {"dead_time_s": DEAD_S, "time_constant_s": LAG_S}}
    path = session_of_poses(folder, effects, 0.0, "[known_to]\nstart_common_s = 0.0\nstart_per_run_s = 0.0")
    with pytest.MonkeyPatch.context() as monkeypatch:
        offer_few(monkeypatch, *LIKE_LATE)
        return diagnose_experiment(path, folder / "out")[1]


def test_late_motors_are_found_from_poses_and_logs(late_motors: dict[str, Any]) -> None:
    assert late_motors["verdict"] == "effect"
    (effect,) = late_motors["effects"]
    assert effect["id"] == "command-lag"
    assert effect["parameters"]["dead_time_s"]["value"] == pytest.approx(DEAD_S, abs=0.01)
    assert effect["parameters"]["time_constant_s"]["value"] == pytest.approx(LAG_S, abs=0.02)
    assert late_motors["mistakes"] == []
    gap = late_motors["gap"]
    assert gap["after"]["held_out"] < 1.2 * gap["noise_floor"] < 0.5 * gap["before"]["held_out"]


def test_a_clock_that_is_off_is_found_within_its_interval_and_is_no_effect(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    offer_few(monkeypatch, *LIKE_LATE)
    path = session_of_poses(tmp_path, {}, 0.08, "[known_to]\nstart_common_s = 0.1\nstart_per_run_s = 0.005")
    content = diagnose_experiment(path, tmp_path / "out")[1]
    assert content["verdict"] == "none"
    (start,) = [item for item in content["known_to"] if item["quantity"] == "start_common_s"]
    assert start["low"] < 0.08 < start["high"]
    assert start["high"] - start["low"] < 0.01
