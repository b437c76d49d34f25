"""Sweeps: the same runs however they are cut, resumed after an interruption, unharmed by a worker's death."""

from __future__ import annotations

import os
import shutil
import signal
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from evaluator.cli.group import turnscope
from evaluator.errors import InputError
from evaluator.progress import Cancelled
from evaluator.workflow import run_sweep
from evaluator.workflow import sweep as command
from evaluator.workflow.execution import cluster
from simulator.command import Command
from simulator.effects.entry import EffectEntry
from simulator.errors import SimulationError
from simulator.robot import load_robot
from simulator.simulation import simulate
from simulator.sweep import changed, load_sweep, robot_of_sweep, run_part

SWEEP = """
format = 1
name = "friction and tilt"
robot = "barrel"
duration_s = 2.0
samples = 3
seed = 7
[fixed]
left_rpm = 33.3
[grid]
right_rpm = [14.4, 20.0]
slip.lateral_friction = { low = 0.25, high = 0.35, count = 2 }
[random]
"effect.plate-tilt.angle_deg" = { low = 0.0, high = 3.0 }
"start.heading_deg" = { mean = 0.0, sigma = 90.0 }
"""


@pytest.fixture
def sweep_file(tmp_path: Path) -> Path:
    path = tmp_path / "sweep.toml"
    path.write_text(SWEEP, encoding="utf-8")
    return path


def test_runs_do_not_depend_on_how_the_sweep_is_cut(sweep_file: Path) -> None:
    sweep = load_sweep(sweep_file)
    robot = robot_of_sweep(sweep)
    whole = run_part(sweep, robot, 0, sweep.count())
    cut = pd.concat([run_part(sweep, robot, start, min(start + 5, 12)) for start in (0, 5, 10)], ignore_index=True)
    assert len(whole) == 12
    pd.testing.assert_frame_equal(whole, cut)
    assert whole["start.heading_deg"].nunique() == 12


def test_a_row_is_the_run_its_keys_describe(sweep_file: Path) -> None:
    sweep = load_sweep(sweep_file)
    row = run_part(sweep, robot_of_sweep(sweep), 4, 5).iloc[0]
    barrel = load_robot("barrel")
    slip = barrel.slip.model_copy(update={"lateral_friction": row["slip.lateral_friction"]})
    tilt = EffectEntry.model_validate({"id": "plate-tilt", "angle_deg": row["effect.plate-tilt.angle_deg"]})
    robot = barrel.model_copy(update={"slip": slip, "effect": (tilt,)})
    from simulator.run import State

    start = State(heading_rad=np.radians(row["start.heading_deg"]))
    run = simulate(robot, Command.constant(33.3, row["right_rpm"]), [0.0, 2.0], start)
    assert run.x_mm[-1] == pytest.approx(row["x_mm"], abs=1e-9)
    assert np.degrees(run.heading_rad[-1]) == pytest.approx(row["heading_deg"], abs=1e-9)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ('"slip.lateral_frictoin" = [0.2]', "did you mean slip.lateral_friction?"),
        ('"effect.plate-tlit.angle_deg" = [1.0]', "did you mean plate-tilt?"),
        ("robot.mass = [1.0]", "not a key of a sweep"),
        ('"body.mass_g" = [-1.0]', "body.mass_g"),
    ],
)
def test_a_key_that_is_none_is_named_before_anything_runs(tmp_path: Path, line: str, said: str) -> None:
    path = tmp_path / "sweep.toml"
    text = f'format = 1\nname = "bad"\nrobot = "barrel"\nduration_s = 1.0\n[grid]\n{line}\n'
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SimulationError) as caught:
        robot_of_sweep(load_sweep(path))
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (
            "[grid]\nleft_rpm = { low = 1, high = 2, count = 0 }",
            "grid.left_rpm.count = 0: should be greater than or equal to 1",
        ),
        ("[grid]\nleft_rpm = { low = 1, high = 2 }", "grid.left_rpm.count is missing"),
        ("[grid]\nleft_rpm = { low = 1, high = 2, cuont = 3 }", "unknown key grid.left_rpm.cuont; did you mean count?"),
        ("[grid]\nleft_rpm = 5", "grid.left_rpm = 5: should be a table"),
        ("[grid]\nleft_rpm = []", "grid.left_rpm is empty"),
        ('[grid]\nleft_rpm = [1, "x"]', "grid.left_rpm.values[2] = 'x': should be a number"),
        ("[random]\nleft_rpm = { low = 2, high = 1.5 }", "low = 2 is above high = 1.5"),
        (
            "[random]\nleft_rpm = { low = 2, sigma = 1 }",
            "random.left_rpm.mean is missing; unknown key random.left_rpm.low",
        ),
        ("[random]\nleft_rpm = { mean = 2, sigma = 0 }", "random.left_rpm.sigma = 0: should be greater than 0"),
        (
            "[grid]\nleft_rpm = { low = 1, high = 2, count = 1e9 }\nstart_s = { low = 1, high = 2, count = 1e9 }",
            "the grid and its samples are 1e+18 runs; at most 10,000,000 are simulated",
        ),
    ],
)
def test_a_grid_or_a_distribution_that_is_none_is_told_in_one_sentence(tmp_path: Path, lines: str, said: str) -> None:
    path = tmp_path / "sweep.toml"
    path.write_text(f'format = 1\nname = "bad"\nrobot = "barrel"\nduration_s = 1.0\n{lines}\n', encoding="utf-8")
    with pytest.raises(InputError) as caught:
        run_sweep(path, tmp_path / "out.csv")
    assert said in str(caught.value)
    assert str(caught.value).count("sweep.toml") == 1
    assert not (tmp_path / "out.csv").exists()


def test_the_last_keys_of_a_grid_change_first_and_both_ends_are_in_it(tmp_path: Path) -> None:
    path = tmp_path / "sweep.toml"
    left, start = "{ low = 0.1, high = 0.7, count = 3 }", "{ low = 2, high = 9, count = 1 }"
    grid = f"left_rpm = {left}\nright_rpm = [5, 6]\nstart_s = {start}"
    path.write_text(
        f'format = 1\nname = "g"\nrobot = "barrel"\nduration_s = 1.0\nsamples = 2\n[grid]\n{grid}\n', encoding="utf-8"
    )
    sweep = load_sweep(path)
    found = [tuple(point.values()) for point in sweep.points(0, sweep.count())]
    assert found[::2] == found[1::2]
    assert found[::2] == [(x, y, 2.0) for x in (0.1, pytest.approx(0.4), 0.7) for y in (5.0, 6.0)]
    assert [tuple(point.values()) for point in sweep.points(3, 5)] == found[3:5]


def test_parameters_of_one_effect_come_together_and_others_stay_as_they_are() -> None:
    robot = load_robot("barrel").model_copy(update={"effect": (EffectEntry(id="plate-tilt", angle_deg=2.0),)})
    found = changed(robot, {"effect.mass-offset.x_mm": 0.3, "effect.mass-offset.y_mm": -0.2, "body.mass_g": 0.6})
    assert [(entry.id, entry.given) for entry in found.effect] == [
        ("plate-tilt", robot.effect[0].given),
        ("mass-offset", {"x_mm": 0.3, "y_mm": -0.2}),
    ]
    steeper = changed(robot, {"effect.plate-tilt.angle_deg": 3.0})
    assert [entry.given["angle_deg"] for entry in steeper.effect] == [3.0]


@pytest.mark.parametrize("workers", [1, 2])
def test_a_cancelled_sweep_goes_on_where_it_was_and_ends_the_same(
    sweep_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, workers: int
) -> None:
    monkeypatch.setattr(command, "RUNS_A_PART", 3)
    whole, output = tmp_path / "whole.csv", tmp_path / "out.csv"
    assert run_sweep(sweep_file, whole, workers=1).parts == 4

    def cancel_half_way(stage: str, done: float, total: float = 1.0, /) -> None:
        assert (stage, total) == ("simulating", 4)
        if done >= 2:
            raise Cancelled

    with pytest.raises(Cancelled):
        run_sweep(sweep_file, output, workers=workers, progress=cancel_half_way)
    assert not output.exists()
    done = run_sweep(sweep_file, output, workers=workers)
    assert (done.runs, done.reused) == (12, 2)
    assert output.read_bytes() == whole.read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.csv", "sweep.toml", "whole.csv"]


@pytest.mark.parametrize("content", [b"", bytes(400), b"right_rpm,slip.lateral_friction\n14.4,0.25\n"])
def test_parts_that_are_not_whole_after_a_power_failure_are_simulated_again(
    sweep_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, content: bytes
) -> None:
    monkeypatch.setattr(command, "RUNS_A_PART", 6)
    run_sweep(sweep_file, tmp_path / "whole.csv", workers=1)

    def spoil(_stage: str, done: float, total: float = 1.0, /) -> None:
        if done == total:
            next(tmp_path.glob("out.csv.parts-*/*6.csv")).write_bytes(content)
            raise Cancelled

    with pytest.raises(Cancelled):
        run_sweep(sweep_file, tmp_path / "out.csv", workers=1, progress=spoil)
    assert run_sweep(sweep_file, tmp_path / "out.csv", workers=1).reused == 1
    assert (tmp_path / "out.csv").read_bytes() == (tmp_path / "whole.csv").read_bytes()


def test_a_sweep_whose_parts_another_has_removed_ends_the_same(
    sweep_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(command, "RUNS_A_PART", 6)
    run_sweep(sweep_file, tmp_path / "whole.csv", workers=1)

    def remove(_stage: str, done: float, total: float = 1.0, /) -> None:
        if done == total:
            shutil.rmtree(next(tmp_path.glob("out.csv.parts-*")))

    run_sweep(sweep_file, tmp_path / "out.csv", workers=1, progress=remove)
    assert (tmp_path / "out.csv").read_bytes() == (tmp_path / "whole.csv").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.csv", "sweep.toml", "whole.csv"]


def test_the_command_writes_a_row_for_every_run(sweep_file: Path, tmp_path: Path) -> None:
    output = tmp_path / "out.csv"
    run = CliRunner().invoke(turnscope, ["sweep", str(sweep_file), "-o", str(output), "--workers", "1"])
    assert run.exit_code == 0, run.output
    sweep = load_sweep(sweep_file)
    rows = run_part(sweep, robot_of_sweep(sweep), 0, 12)
    assert np.allclose(pd.read_csv(output)["x_mm"], rows["x_mm"], rtol=1e-8)


@pytest.mark.filterwarnings("ignore")
def test_nothing_is_lost_when_a_dask_worker_is_killed_during_the_sweep(
    sweep_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    distributed = pytest.importorskip("distributed", reason="the optional extra dask is not installed")
    monkeypatch.setattr(command, "RUNS_A_PART", 20)
    sweep_file.write_text(SWEEP.replace("samples = 3", "samples = 60"), encoding="utf-8")
    killed: list[int] = []
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as cluster_of_two:
        victim = next(iter(cluster_of_two.workers.values())).pid

        def kill(stage: str, done: float, total: float = 1.0, /) -> None:
            assert (stage, total) == ("simulating", 12)
            if done and not killed:
                killed.append(victim)
                os.kill(victim, signal.SIGKILL)

        address = cluster_of_two.scheduler_address
        run_sweep(sweep_file, tmp_path / "there.csv", dask=address, progress=kill)
    run_sweep(sweep_file, tmp_path / "here.csv", workers=1)
    assert killed
    assert (tmp_path / "there.csv").read_bytes() == (tmp_path / "here.csv").read_bytes()


@pytest.mark.filterwarnings("ignore")
def test_a_scheduler_that_does_not_answer_is_one_clear_error(
    sweep_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed", reason="the optional extra dask is not installed")
    monkeypatch.setattr(cluster, "DASK_TIMEOUT_S", 0.5)
    with pytest.raises(InputError, match="no Dask scheduler responds"):
        run_sweep(sweep_file, tmp_path / "out.csv", dask="tcp://127.0.0.1:1")
