"""A robot of 50 kg with four driven wheels, driven by others: from its commands and held poses to a comparison."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from evaluator.workflow import analyze
from simulator.effects.entry import EffectEntry
from simulator.robot import Robot, load_robot
from simulator.run import State
from simulator.simulation import simulate
from tests.driven_robot.corrected import NUMBERS, Model
from tests.driven_robot.drive import Drive, command_of, load, write_experiment
from tests.driven_robot.peers import _process

ROBOT = Path(__file__).parent / "husky.toml"
REAL = Path(__file__).parents[3] / "shared" / "real" / "skid_steer_husky"
SAMPLES, INTERVAL_S = 40, 0.05
COMMANDS = [(4.0, 6.0), (4.0, 6.0), (-5.0, -3.0), (6.0, 2.0)]  # rad/s, 2 s each
LAG = {"dead_time_s": 0.3, "time_constant_s": 0.3}


def late(robot: Robot) -> Robot:
    lag = EffectEntry.model_validate({"id": "command-lag", **LAG})
    return robot.model_copy(update={"effect": (*robot.effect, lag)})


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files of such a recording: each window begins at nought, and every pose is there twice."""
    where = tmp_path_factory.mktemp("driven")
    rows = np.repeat(np.array(COMMANDS), SAMPLES, axis=0)
    times = INTERVAL_S * np.arange(len(rows))
    run = simulate(late(load_robot(ROBOT)), command_of(rows, times), times, State())
    tables = []
    for window in range(len(COMMANDS)):
        part = slice(window * SAMPLES, (window + 1) * SAMPLES)
        x, y, heading = run.x_mm[part] / 1000, run.y_mm[part] / 1000, run.heading_rad[part]
        fresh = np.arange(SAMPLES) // 2 * 2
        table = pd.DataFrame({"step": window, "window": 0, "time_s": INTERVAL_S * np.arange(SAMPLES)})
        table[["command_left_rad_s", "command_right_rad_s"]] = COMMANDS[window]
        table[["x_m", "y_m", "heading_rad"]] = np.column_stack([x, y, heading])[fresh]
        tables.append(table)
    pd.concat(tables).to_csv(where / "poses.csv.gz", index=False)
    return where


def test_windows_are_read_from_their_own_starts_with_the_commands_before_them(folder: Path) -> None:
    drive = load(folder)
    assert len(drive) == len(COMMANDS)
    assert np.allclose(drive.pose[:, 0], 0)
    assert drive.step.tolist() == [0, 0, 1, 2]  # by the commands: the file calls every window a step
    assert drive.fresh.sum(axis=1).tolist() == [SAMPLES // 2] * len(COMMANDS)
    rows, times = drive.log(2)
    assert rows[times < 0].tolist() == [list(COMMANDS[0])] * 80
    assert rows[times >= 0].tolist() == [list(COMMANDS[2])] * 40
    assert np.isnan(drive.encoder_rad_s).all()


def test_the_model_with_the_true_numbers_predicts_the_windows(folder: Path) -> None:
    drive = load(folder)
    unchanged = {"common": 1.0, "difference": 1.0, "drag_of_weight": 1e-12, "gravity_x_m": 0.0, "pose_x_m": 0.0}
    limits = {name: 1e9 for name in NUMBERS if name.endswith(("_limit", "_ramp_per_s"))}
    slip = {name: 1.0 for name in NUMBERS if name.endswith(("_friction", "_stiffness"))}
    model = Model(load_robot(ROBOT), drive)
    poses = model.poses(LAG | unchanged | limits | slip, np.arange(len(drive)))
    fresh = drive.fresh
    assert np.abs(poses - drive.pose)[1:][fresh[1:]].max() < 2e-3  # the first window starts at rest in truth
    halved = LAG | unchanged | limits | slip | {"difference": 0.5}
    assert np.abs(model.poses(halved, np.arange(len(drive))) - drive.pose).max() > 0.05
    mixed = LAG | slip | unchanged | limits | {"common": 2.0, "difference": 0.5}
    assert model.wheels_rad_s(mixed, np.array([-5.0, -3.0])) == pytest.approx((-8.5, -7.5))
    usual = model.usual_rpm * np.pi / 30  # of 2, 3, 4, 4, 5, 6, 6, 6
    assert usual == pytest.approx(4.5)
    limited = mixed | {"ahead_limit": 7.0 / usual, "turn_limit": 0.3 / usual, "wheel_limit": 7.2 / usual}
    assert model.wheels_rad_s(limited, np.array([-5.0, -3.0])) == pytest.approx((-7.2, -6.7))


def test_a_gaussian_process_follows_values_without_noise() -> None:
    """Their noise tends to nought, and a first step along so steep a likelihood left the range of numbers."""
    inputs = np.random.default_rng(2).normal(size=(40, 4))
    values = 50.0 * np.sin(3.0 * inputs[:, 0])
    assert _process(inputs, values, np.ones(40), inputs) == pytest.approx(values, abs=1.0)


def test_poses_and_logs_of_a_large_robot_are_measured_and_compared(folder: Path, tmp_path: Path) -> None:
    drive = load(folder)
    robot = tmp_path / "robot.toml"
    lag = "\n".join(f"{name} = {value}" for name, value in LAG.items())
    robot.write_text(f'{ROBOT.read_text(encoding="utf-8")}\n[[effect]]\nid = "command-lag"\n{lag}\n', encoding="utf-8")
    out = tmp_path / "experiment"
    out.mkdir()
    path = write_experiment(drive, np.array([1, 3]), robot, out)
    found = analyze(path, tmp_path / "out", simulate=True, workers=1)
    assert found.faults == {}
    assert all("20 of 40 poses repeat" in " ".join(notes) for notes in found.notes.values())
    assert found.comparison is not None
    steady = found.comparison[found.comparison["run"] == "w001"].iloc[-1]
    assert steady["gap_rms_mm"] < 5.0
    assert steady["yaw_rate_deg_s"] == pytest.approx(steady["simulated_yaw_rate_deg_s"], rel=0.02)


@pytest.mark.skipif(not REAL.is_dir(), reason="needs ../shared/real/skid_steer_husky")
def test_the_real_recording_is_read_whole_and_a_window_of_it_measured(tmp_path: Path) -> None:
    drive: Drive = load(REAL)
    assert len(drive) == 603
    assert 0.4 < drive.fresh.mean() < 0.6
    path = write_experiment(drive, np.array([1]), ROBOT, tmp_path)
    found = analyze(path, tmp_path / "out", workers=1)
    assert found.faults == {}
    assert "repeat the previous one" in found.notes["w001"][0]
