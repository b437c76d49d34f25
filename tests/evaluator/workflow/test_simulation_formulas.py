"""What one simulation, a table of steady turns, and the tables of an analysis are asked for and hold."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from evaluator.errors import InputError
from evaluator.progress import no_progress, part_way
from evaluator.workflow import analysis, simulation
from evaluator.workflow.results.outputs import Outputs
from evaluator.workflow.runs.job import RunResult
from simulator.command import Command
from simulator.robot import load_robot
from simulator.run import State

ROBOT = load_robot("barrel")


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What is simulated, instead of a simulation."""
    found: list[Any] = []
    monkeypatch.setattr(simulation, "simulate_run", lambda *given: found.append(given))
    return found


def test_a_run_has_a_row_every_period_and_its_motors_on_between_start_and_stop(asked: list[Any]) -> None:
    simulation.simulate("barrel", 30.0, duration_s=2.0, right_rpm=-20.0, start_s=0.5, stop_s=1.5, rate_hz=10.0)
    robot, command, times, start = asked[0]
    assert robot.name == ROBOT.name
    np.testing.assert_allclose(times, np.arange(21) / 10)
    assert [command.at(at) for at in (0.4, 0.6, 1.4, 1.6)] == [(0, 0), (30, -20), (30, -20), (0, 0)]
    assert start == State()
    simulation.simulate(ROBOT, 0.0, 0.0, duration_s=1.0, start=State(1.0, 2.0, 3.0))
    assert (len(asked[1][2]), asked[1][3]) == (61, State(1.0, 2.0, 3.0))


def test_a_run_follows_a_log_or_a_command(asked: list[Any], tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("time_s,left_rpm,right_rpm\n0,10,20\n1,20,40\n")
    simulation.simulate(ROBOT, duration_s=1.0, commands=tmp_path / "log.csv", start_s=0.3)
    assert [asked[0][1].at(at) for at in (0.2, 0.4, 1.2, 1.4)] == [(0, 0), (10, 20), (10, 20), (20, 40)]
    given = Command.constant(1.0, 2.0)
    simulation.simulate(ROBOT, duration_s=1.0, commands=given)
    assert asked[1][1].knots.tolist() == given.knots.tolist()


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"left_rpm": 1.0}, "expected the speed of both"), ({"right_rpm": 1.0}, "expected the speed of both"),
        ({"left_rpm": 1.0, "commands": Command.constant(1, 1)}, "expected either speeds"),
        ({"stop_s": 1.0, "commands": Command.constant(1, 1)}, "says when the motors stop: leave out --stop-s"),
        ({"right_rpm": 1.0, "commands": Command.constant(1, 1)}, "expected either speeds"),
        ({"left_rpm": 1.0, "right_rpm": 1.0, "duration_s": 0.0}, "the duration must be a positive number; found 0.0"),
        ({"left_rpm": 1.0, "right_rpm": 1.0, "rate_hz": float("inf")}, "the rate must be a positive number"),
        ({"left_rpm": 1.0, "right_rpm": 1.0, "duration_s": 0.049, "rate_hz": 10.0}, "holds no second row"),
        ({"left_rpm": 1.0, "right_rpm": 1.0, "duration_s": 1e7}, r"is 6e\+08 rows; at most 1,000,000 are written"),
        ({"left_rpm": 1.0, "right_rpm": 1.0, "duration_s": 1e308, "rate_hz": 1e308}, "is inf rows"),
        ({"left_rpm": 1.0, "right_rpm": -1e308}, r"a speed of -1e\+308 rpm is beyond every motor"),
    ],
)  # fmt: skip
def test_a_run_that_cannot_be_meant_is_refused(more: dict[str, Any], said: str, asked: list[Any]) -> None:
    with pytest.raises(InputError, match=said):
        simulation.simulate(ROBOT, **{"duration_s": 1.0, **more})
    simulation.simulate(ROBOT, 1.0, 1.0, duration_s=0.051, rate_hz=10.0)
    assert [len(times) for _, _, times, _ in asked] == [2]


@pytest.mark.parametrize(("left_rpm", "ratios"), [([1.0, 1e308], [1.0]), ([1e6], [0.5, -1.01])])
def test_steady_turns_of_speeds_that_no_motor_has_are_refused(left_rpm: list[float], ratios: list[float]) -> None:
    """A table of empty cells was written for them."""
    with pytest.raises(InputError, match="is beyond every motor; give at most 1,000,000 rpm"):
        simulation.steady_turns(ROBOT, left_rpm, ratios)


def test_a_robot_that_stands_is_not_exported(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="the robot stands at 0 / 0 rpm, and friction is matched at a turn"):
        simulation.export_robot(ROBOT, tmp_path / "r.xml", 0.0, 0.0)
    assert not list(tmp_path.iterdir())


def test_steady_turns_have_their_commands_signed_radii_and_speeds(monkeypatch: pytest.MonkeyPatch) -> None:
    curvature = np.array([[0.1, 0.0], [-0.2, np.nan]])
    found = SimpleNamespace(
        left_rpm=(10.0, 20.0), ratio=(0.5, 1.0), curvature_per_mm=curvature, u_mm_s=np.full((2, 2), 3.0),
        v_mm_s=np.full((2, 2), -4.0), yaw_rate_rad_s=np.array([[np.pi, 0.0], [1.0, 2.0]]),
    )  # fmt: skip
    monkeypatch.setattr(simulation, "steady_map", lambda *_: found)
    table = simulation.steady_turns(ROBOT, (10.0, 20.0), (0.5, 1.0))
    assert table["left_rpm"].tolist() == [10, 10, 20, 20]
    assert table["ratio"].tolist() == [0.5, 1, 0.5, 1]
    assert table["right_rpm"].tolist() == [5, 10, 10, 20]
    np.testing.assert_allclose(table["radius_mm"], [10, np.inf, -5, np.nan])
    assert table["speed_mm_s"].tolist() == [5.0] * 4
    np.testing.assert_allclose(table["yaw_rate_deg_s"], np.degrees([np.pi, 0, 1, 2]))


def run(name: str, **more: Any) -> Any:
    usual = {"id": name, "left_rpm": 1.0, "right_rpm": 2.0, "group": "g", "robot": None, "source": Path(f"{name}.csv")}
    return SimpleNamespace(**{**usual, **dict.fromkeys(("camera", "corrections", "commands")), **more})


def test_a_table_of_runs_has_the_columns_of_a_whole_row_and_a_row_for_every_phase() -> None:
    described: Any = SimpleNamespace(run=(run("a"), run("b", left_rpm=None)))
    table = analysis._table(
        described,
        [
            ({"radius_status": "dark"},),
            ({"radius_mm": 5.0, "left_rpm": 3.0, "radius_status": "ok"}, {"radius_mm": 6.0}),
        ],
    )
    assert list(table) == ["run", "left_rpm", "right_rpm", "radius_mm", "radius_status", "group"]
    assert table["run"].tolist() == ["a", "b", "b"]
    np.testing.assert_array_equal(table["left_rpm"], [1.0, 3.0, np.nan])
    np.testing.assert_array_equal(table["radius_mm"], [np.nan, 5.0, 6.0])
    assert table["left_rpm"].dtype == float


def test_files_that_an_experiment_reads_are_those_that_are_there(tmp_path: Path) -> None:
    for name in ("a.csv", "b.toml", "c.toml", "cam.json", "log.csv", "t.toml"):
        (tmp_path / name).touch()
    runs = (
        run("a", source=tmp_path / "a.csv", robot=str(tmp_path / "c.toml"), camera=tmp_path / "cam.json"),
        run("x", source=tmp_path / "gone.csv", commands=tmp_path / "log.csv"),
    )
    described: Any = SimpleNamespace(run=runs, robot=str(tmp_path / "b.toml"), tracking=tmp_path / "t.toml")
    found = [path.name for path in analysis.input_files(described)]
    assert found == ["a.csv", "b.toml", "c.toml", "cam.json", "log.csv", "t.toml"]
    described = SimpleNamespace(run=runs[1:], robot="barrel", tracking=None)
    assert [path.name for path in analysis.input_files(described)] == ["log.csv"]


@pytest.mark.parametrize(
    ("known", "workers", "told", "within"),
    [
        ("a", 2, [1, 2, 3, 4], False), ("abc", 2, [3, 3.25, 4], True), ("ab", 1, [2, 2.25, 3, 3.25, 4], True),
        ("abcd", 2, [4], False),
    ],
)  # fmt: skip
def test_runs_are_counted_as_they_are_known_and_computed_and_within_each_where_it_is_computed_here(
    known: str, workers: int, told: list[float], within: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def analyse(job: Any, progress: Any = no_progress) -> RunResult:
        progress("tracking", 5, 20)
        return RunResult(job.run.id)

    @contextmanager
    def answers_of(work: Any, todo: Any, **_: Any) -> Iterator[Any]:
        assert isinstance(work, partial) == within
        yield ((number, work(job)) for number, job in enumerate(todo))

    jobs: Any = [SimpleNamespace(run=SimpleNamespace(id=name)) for name in "abcd"]
    monkeypatch.setattr(analysis, "known_result", lambda job: RunResult(job.run.id) if job.run.id in known else None)
    monkeypatch.setattr(analysis, "_analyse", analyse)
    monkeypatch.setattr(analysis, "answers_of", answers_of)
    said: list[Any] = []
    found = analysis.results_of(jobs, workers, progress=lambda *item: said.append(item))
    assert said == [("runs", done, 4) for done in told]
    assert set(found) == set("abcd")


def test_the_share_of_one_of_many_is_added_to_those_that_are_done() -> None:
    said: list[Any] = []
    report = part_way(lambda *item: said.append(item), "runs", lambda: 3.0, 8)
    for share, of in ((1, 4), (9, 4), (5, 0)):
        report("tracking", share, of)
    assert said == [("runs", 3.25, 8), ("runs", 4.0, 8), ("runs", 3.0, 8)]


def test_why_no_run_can_be_analysed_is_told_once_for_each_reason() -> None:
    assert analysis._nothing_left({"a": "a: dark"}) == "a: dark"
    said = analysis._nothing_left({"a": "dark", "b": "short", "c": "dark"})
    assert said == "none of the 3 runs can be analysed: a, c: dark; b: short"
    said = analysis._nothing_left({f"r{k}": f"{k}.csv" for k in range(10_000)})
    assert said.endswith("r0: 0.csv; r1: 1.csv; r2: 2.csv; r3: 3.csv; 9996 others")
    said = analysis._nothing_left({f"r{k}": "dark" for k in range(10_000)})
    assert said.endswith("r0, r1, r2, r3, 9996 others: dark")


def test_an_analysis_shows_its_first_columns_and_how_many_runs_have_no_result() -> None:
    turning = pd.DataFrame({"run": ["<a>"], "radius_mm": [5.12345], "other": [1.0]})
    empty = turning.iloc[:0]
    found = analysis.Analysis(
        SimpleNamespace(name="two"), Outputs(Path("out")), turning, empty, empty, None, {"b": "dark"}, {}, 0,
        (SimpleNamespace(everywhere=False, runs=("a",)), SimpleNamespace(everywhere=True, runs=("c",))),
    )  # type: ignore[arg-type]  # fmt: skip
    assert repr(found) == "Analysis(two: 1 runs, 1 without results, in out)"
    assert found.excluded_runs == {"a"}
    html = found._repr_html_()
    assert "&lt;a&gt;" in html
    assert "5.123" in html
    assert "other" not in html
