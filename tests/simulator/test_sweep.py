"""Sweeps: the same runs however they are cut, resumed after an interruption, unharmed by a worker's death."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from evaluator.cli import sweep as command
from evaluator.errors import InputError
from evaluator.workflow.execution import scale_out
from simulator.command import Command
from simulator.effects.entry import EffectEntry
from simulator.errors import SimulationError
from simulator.robot import load_robot
from simulator.simulation import simulate
from simulator.sweep import load_sweep, robot_of_sweep, run_part

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
    whole = run_part(sweep, robot, 0, len(sweep))
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
        ("robot.mass = [1.0]", "no key of a sweep"),
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


def test_an_interrupted_sweep_goes_on_where_it_was(
    sweep_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    worked: list[int] = []

    @contextmanager
    def serial(
        work: Callable[..., pd.DataFrame], jobs: list[tuple[object, ...]], *_: object
    ) -> Iterator[Iterator[tuple[int, pd.DataFrame]]]:
        def each() -> Iterator[tuple[int, pd.DataFrame]]:
            for number, job in enumerate(jobs):
                if len(worked) == 2:
                    worked.append(-1)
                    raise KeyboardInterrupt
                worked.append(number)
                yield number, work(*job)

        yield each()

    monkeypatch.setattr(scale_out, "results_of", serial)
    monkeypatch.setattr(command, "RUNS_A_PART", 3)
    output = tmp_path / "out.csv"
    first = CliRunner().invoke(command.sweep, [str(sweep_file), "-o", str(output)])
    assert first.exit_code != 0
    assert not output.exists()
    second = CliRunner().invoke(command.sweep, [str(sweep_file), "-o", str(output)])
    assert second.exit_code == 0, second.output
    assert worked == [0, 1, -1, 0, 1]
    sweep = load_sweep(sweep_file)
    whole = run_part(sweep, robot_of_sweep(sweep), 0, 12)
    assert np.allclose(pd.read_csv(output)["x_mm"], whole["x_mm"], rtol=1e-8)
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith("out")] == ["out.csv"]


@pytest.mark.filterwarnings("ignore")
def test_nothing_is_lost_when_a_dask_worker_is_killed_during_the_sweep(sweep_file: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="the optional extra dask is not installed")
    sweep = load_sweep(sweep_file).model_copy(update={"samples": 300})
    robot = robot_of_sweep(sweep)
    jobs = [(sweep, robot, start, start + 100) for start in range(0, len(sweep), 100)]
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as cluster:
        victim = next(iter(cluster.workers.values())).pid
        found: dict[int, pd.DataFrame] = {}
        with scale_out.results_of(run_part, jobs, cluster.scheduler_address) as results:
            for number, table in results:
                if not found:
                    os.kill(victim, signal.SIGKILL)
                found[number] = table
    assert sorted(found) == list(range(12))
    together = pd.concat([found[number] for number in range(12)], ignore_index=True)
    pd.testing.assert_frame_equal(together, run_part(sweep, robot, 0, len(sweep)))


@pytest.mark.filterwarnings("ignore")
def test_a_scheduler_that_does_not_answer_is_one_clear_error(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason="the optional extra dask is not installed")
    monkeypatch.setattr(scale_out, "DASK_TIMEOUT_S", 0.5)
    with (
        pytest.raises(InputError, match="no Dask scheduler answers"),
        scale_out.results_of(run_part, [(1,)], "tcp://127.0.0.1:1"),
    ):
        pass
