"""Circular tests of simulated robots, and of an experiment: planned, measured and reported."""

from __future__ import annotations

import json
import tomllib
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from evaluator.cli.experiment.plan import plan
from evaluator.cli.experiment.report import report
from evaluator.cli.measurement.circular_test import circular_test
from evaluator.errors import InputError
from evaluator.workflow import circular_runs, evaluate_circular_test, simulate_circular_test, write_circular_test
from evaluator.workflow.circular.evaluate import _wheelbase, circular_test_of
from evaluator.workflow.circular.runs import simulated_turns
from simulator.command import Command
from simulator.observation import marks_of_run
from simulator.robot import load_robot
from simulator.simulation import simulate


def test_a_plan_drives_all_sides_directions_and_speeds_before_it_repeats() -> None:
    runs = circular_runs("barrel", rpm=(20.0, 40.0, 60.0), ratios=(0.5,), repetitions=3)
    assert len(runs) == 36
    commands = [(run.left_rpm, run.right_rpm) for run in runs]
    assert len(set(commands[:12])) == 12
    assert set(Counter(commands).values()) == {3}
    ways = Counter((np.sign(left + right), np.sign(abs(right) - abs(left))) for left, right in commands)
    assert set(ways.values()) == {9}
    assert [run.radius_mm for run in runs] == pytest.approx([runs[0].radius_mm] * 36, rel=1e-2)


@pytest.mark.parametrize(("yaw_rate", "seconds"), [(0.5, 15.7), (-0.25, 31.4), (3.0, 3.0), (0.05, 60.0), (0.0, 60.0)])
def test_a_run_lasts_for_a_circle_and_a_quarter_between_three_seconds_and_a_minute(
    yaw_rate: float, seconds: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    turn = SimpleNamespace(yaw_rate_rad_s=yaw_rate, radius_mm=-5.0, speed_mm_s=2.0)
    monkeypatch.setattr("evaluator.workflow.circular.runs.steady_turn", lambda *_: turn)
    runs = circular_runs("barrel", rpm=(20.0, 40.0, 60.0), ratios=(0.5,), repetitions=1)
    assert {(run.duration_s, run.radius_mm, run.speed_mm_s) for run in runs} == {(seconds, 5.0, 2.0)}


def test_simulated_turns_have_the_signs_of_measured_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    """Backward, the speed is negative; the slip is the angle of the velocity to the line of the body, to the left."""
    turn = SimpleNamespace(u_mm_s=-3.0, v_mm_s=0.4, speed_mm_s=np.hypot(3.0, 0.4), yaw_rate_rad_s=-0.2)
    monkeypatch.setattr("evaluator.workflow.circular.runs.steady_turn", lambda *_: turn)
    commands = pd.DataFrame({"run": ["a", "b"], "left_rpm": [-30.0, -30.0], "right_rpm": [-20.0, -20.0]})
    found = simulated_turns(load_robot("barrel"), commands).iloc[1]
    assert found["speed_mm_s"] == pytest.approx(-np.hypot(3.0, 0.4))
    assert found["yaw_rate_deg_s"] == pytest.approx(np.degrees(-0.2))
    assert found["body_slip_angle_deg"] == pytest.approx(np.degrees(np.arctan(0.4 / 3.0)))


def test_runs_with_mistakes_and_runs_that_failed_are_no_part_of_the_test() -> None:
    robot = load_robot("barrel")
    left = [20.0, 40.0, 60.0, 50.0, 30.0]
    commands = pd.DataFrame({"run": list("abcde"), "left_rpm": left, "right_rpm": [rpm / 2 for rpm in left]})
    turns = simulated_turns(robot, commands).assign(radius_status="ok")
    analysis: Any = SimpleNamespace(turning=turns, excluded_runs=frozenset("b"), faults={"d": "cannot be read"})
    found = circular_test_of(analysis, robot)
    assert found.measured is not None
    assert list(found.measured.points["run"]) == list(found.simulated.points["run"]) == ["a", "c", "e"]


@pytest.mark.parametrize(("places", "base_mm"), [((3.0, 3.0, -2.0), 5.0), ((1.0, 1.0), 4.0)])
def test_wheelbase_is_the_distance_of_axles_that_grip_and_the_track_of_a_robot_with_one(
    places: tuple[float, ...], base_mm: float
) -> None:
    """In all robots that turnscope brings along both are 4 mm."""
    wheels = [*(SimpleNamespace(x_mm=x, grips=True) for x in places), SimpleNamespace(x_mm=-9.0, grips=False)]
    robot: Any = SimpleNamespace(all_wheels=wheels, track_mm=4.0)
    assert _wheelbase(robot) == base_mm


def test_a_constant_radius_is_kept_at_all_speeds() -> None:
    runs = circular_runs("four_driven", rpm=(20.0, 50.0, 80.0), radius_mm=4000.0, repetitions=1)
    assert [run.radius_mm for run in runs] == pytest.approx([4000.0] * 12, rel=1e-3)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        *(({"rpm": rpm}, "three speeds") for rpm in ((20.0, 40.0), (20.0, 20.0, 40.0), (0.0, 20.0, 40.0))),
        ({"rpm": (20.0, 40.0, np.inf)}, "three speeds"),
        *(({"ratios": ratios}, "between -1 and 1") for ratios in ((1.0,), (-1.0, 0.5), ())),
        ({"radius_mm": np.inf}, "is none"),
        ({"radius_mm": 1.0}, r"does not turn with a radius of 1 mm .* 2\.828 mm or more"),
        ({"radius_mm": -1.0}, "is none"),
    ],
)
def test_a_test_that_cannot_be_driven_is_refused(values: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        circular_runs("barrel", **values)  # type: ignore[arg-type]


def test_understeer_of_two_driven_wheels_is_that_of_statics() -> None:
    # The weight d behind the axle is thrown outward, which turns the robot inward: the wheels hold it with the forces
    # ±m·a_y·d/B, and creep by s, these over their stiffness C. With q = (n_R - n_L)/(n_R + n_L) yaw rate grows by
    # 2·s·u/B and speed by q·s·u, so that κc = κ - 2·m·d/(B²·C)·(1 - q²)·a_y. The length is the track.
    robot = load_robot("two_driven_caster")
    found = simulate_circular_test(robot, rpm=(20.0, 40.0, 60.0), ratios=(0.5,))
    load = robot.weight_uN / 3 + 1000 * robot.wheel[0].attraction_mN
    stiffness = robot.slip.longitudinal_shape * robot.slip.longitudinal_stiffness * load
    gradient = -2 * robot.body.mass_g * 1.0 / (4.0**2 * stiffness) * (1 - (0.5 / 1.5) ** 2)
    for series in found.simulated.series:
        sign = 1 if series.direction == "forward" else -1  # driven backward, the weight leads
        assert series.understeer.value == pytest.approx(sign * np.degrees(gradient * 4.0) * 1e3, rel=1e-3)


def test_wheels_that_roll_turn_as_commanded() -> None:
    found = simulate_circular_test("two_driven_caster", rpm=(15.0, 30.0, 60.0), ratios=(0.5,))
    for series in found.simulated.series:
        assert series.steering.value == pytest.approx(1.0, abs=1e-3)


def test_a_planned_experiment_can_be_read(tmp_path: Path) -> None:
    output = tmp_path / "circular.toml"
    runs = circular_runs("barrel", rpm=(20.0, 40.0, 60.0), ratios=(0.5,), repetitions=1)
    write_circular_test(runs, "barrel", output)
    written = tomllib.loads(output.read_text(encoding="utf-8"))
    assert [(run["left_rpm"], run["right_rpm"]) for run in written["run"]] == [(r.left_rpm, r.right_rpm) for r in runs]
    assert written["robot"] == "barrel"
    with pytest.raises(InputError, match="exists already"):
        write_circular_test(runs, "barrel", output)


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Marks of a planned circular test, with noise and scatter of the motors from run to run."""
    folder, rng, robot = tmp_path_factory.mktemp("circular"), np.random.default_rng(4), load_robot("barrel")
    lines = ["format = 1", 'name = "circular"', 'robot = "barrel"']
    runs = circular_runs(robot, rpm=(30.0, 45.0, 60.0), ratios=(0.5,), repetitions=1)
    times = np.arange(0, 4, 1 / 30)
    for number, run in enumerate(runs):
        gains = 1 + 0.002 * rng.normal(size=2)
        command = Command.constant(run.left_rpm * gains[0], run.right_rpm * gains[1], 0.3)
        marks = marks_of_run(robot, simulate(robot, command, times))
        marks.iloc[:, 1:] += rng.normal(0, 0.003, (len(marks), 4))
        marks.to_csv(folder / f"r{number}.csv", index=False)
        lines += ["", "[[run]]", f'id = "r{number}"', f"left_rpm = {run.left_rpm}", f"right_rpm = {run.right_rpm}"]
        lines += ["start_s = 0.3", f'marks = "r{number}.csv"']
    (folder / "experiment.toml").write_text("\n".join(lines), encoding="utf-8")
    return folder


def test_measured_and_simulated_tests_agree_where_the_model_is_true(driven: Path) -> None:
    found = evaluate_circular_test(driven / "experiment.toml", driven / "out")
    assert found.measured is not None
    assert len(found.measured.series) == len(found.simulated.series) == 4
    for measured, simulated in zip(found.measured.series, found.simulated.series, strict=True):
        assert measured.runs == simulated.runs
        assert measured.steering.low < simulated.steering.value < measured.steering.high
        assert measured.understeer.low < simulated.understeer.value < measured.understeer.high
    content = json.loads((driven / "out" / "circular_test.json").read_text(encoding="utf-8"))
    assert len(content["measured"]) == 4
    assert (driven / "out" / "circular_test.csv").is_file()


def test_the_report_shows_the_test(driven: Path) -> None:
    done = CliRunner().invoke(report, [str(driven / "experiment.toml"), "-o", str(driven / "out"), "-q"])
    assert done.exit_code == 0, done.output
    assert "Steady-state circular test" in (driven / "out" / "report.html").read_text(encoding="utf-8")


def test_the_commands_say_what_was_found(tmp_path: Path) -> None:
    levels = [part for rpm in ("20", "40", "60") for part in ("--rpm", rpm)]
    said = CliRunner().invoke(circular_test, ["--robot", "barrel", *levels, "--ratio", "0.5"]).output
    assert said.count("ratio 0.500") == 4
    output = tmp_path / "circular.toml"
    done = CliRunner().invoke(plan, ["--circular-test", *levels, "--ratio", "0.5", "-o", str(output)])
    assert done.output == (
        f"{output}: 36 runs, commands in {tmp_path / 'commands'}\n"
        f"next: record the runs, then turnscope check {output}\n"
    )
    assert isinstance(CliRunner().invoke(circular_test, []).exception, InputError)
    assert CliRunner().invoke(plan, ["--ratio", "0.5"]).exit_code == 2
