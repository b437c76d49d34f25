"""Runs with a log of commands: forward, stop, backward in one recording, each phase measured by itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from evaluator.diagnosis.experiment import session_of
from evaluator.diagnosis.likelihood.run_data import PER_RUN, Task
from evaluator.diagnosis.likelihood.simulation import Simulated
from evaluator.files import read_with
from evaluator.report.build import write_report
from evaluator.settings import load_experiment
from evaluator.workflow import Analysis, analyze
from simulator.command import Command
from simulator.observation import marks_of_run
from simulator.robot import load_robot
from simulator.run import State
from simulator.simulation import simulate

LOG = "time_s,left_rpm,right_rpm\n1.0,33.3,14.4\n7.0,0,0\n8.0,-33.3,-14.4\n14.0,0,0\n"
LATE_S = 0.2137  # of the recording's clock
PHASES = [(33.3, 14.4), (-33.3, -14.4)]


def experiment(folder: Path, *runs: str) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "experiment.toml"
    path.write_text('format = 1\nname = "phases"\nrobot = "barrel"\n' + "".join(f"[[run]]\n{run}\n" for run in runs))
    return path


def recording(command: Command, late_s: float, path: Path, seconds: float = 15.0, sigma_mm: float = 0.004) -> None:
    """Marks of the paper's robot under a command, by a clock that is late, with noise."""
    times = np.arange(round(60 * seconds)) / 60
    motion = simulate(load_robot("barrel"), command.retimed(later_s=late_s), times, State(5.0, -3.0, 0.6))
    marks = marks_of_run(load_robot("barrel"), motion)
    places = marks.columns != "time_s"
    marks.loc[:, places] += np.random.default_rng(3).normal(0, sigma_mm, (len(marks), 4))
    marks.to_csv(path, index=False)


@pytest.fixture(scope="module")
def analysed(tmp_path_factory: pytest.TempPathFactory) -> Analysis:
    folder = tmp_path_factory.mktemp("log")
    (folder / "log.csv").write_text(LOG)
    recording(Command.held(folder / "log.csv"), LATE_S, folder / "r01.csv")
    path = experiment(folder, 'id = "r01"\ncommands = "log.csv"\nmarks = "r01.csv"')
    return analyze(path, folder / "out", simulate=True, workers=1)


def test_each_phase_of_a_recording_is_a_row_with_its_own_radius(analysed: Analysis) -> None:
    table = pd.read_csv(analysed.outputs.turning)
    assert list(zip(table["left_rpm"], table["right_rpm"], strict=True)) == PHASES
    assert table["run"].tolist() == ["r01", "r01"]
    assert table["phase"].tolist() == [1, 2]
    for row, command in zip(table.to_dict("records"), PHASES, strict=True):
        alone = simulate(load_robot("barrel"), Command.always(*command), np.arange(0, 6, 0.01))
        speed = np.hypot(alone.u_mm_s[-1], alone.v_mm_s[-1])
        radius = speed / abs(alone.yaw_rate_rad_s[-1])
        assert row["radius_low_mm"] < radius < row["radius_high_mm"]
        assert row["radius_mm"] == pytest.approx(radius, rel=2e-3)
        assert row["speed_mm_s"] == pytest.approx(np.sign(command[0]) * speed, rel=2e-3)


def test_no_frame_of_another_phase_enters_one(analysed: Analysis) -> None:
    table = analysed.turning
    assert (table["phase_start_s"] >= np.array([1.0, 8.0]) + LATE_S).all()
    assert (table["phase_stop_s"] <= np.array([7.0, 14.0]) + LATE_S).all()
    assert (table["phase_stop_s"] - table["phase_start_s"] > 5.9).all()


def test_the_clock_of_the_commands_is_found_to_a_millisecond(analysed: Analysis) -> None:
    row = analysed.turning.iloc[0]
    assert row["late_s"] == pytest.approx(LATE_S, abs=2e-3)
    assert row["late_low_s"] < LATE_S < row["late_high_s"]
    assert row["late_high_s"] - row["late_low_s"] < 4e-3
    assert any("later than its command log" in note for note in analysed.notes["r01"])


def test_comparison_and_report_show_the_phases(analysed: Analysis) -> None:
    assert analysed.comparison is not None
    assert len(analysed.comparison) == 2
    assert np.allclose(analysed.comparison["radius_difference_percent"], 0, atol=0.3)
    write_report(analysed)
    page = analysed.outputs.report.read_text(encoding="utf-8")
    assert "r01 (1)" in page
    assert "r01 (2)" in page


def test_the_diagnosis_simulates_the_log_that_the_run_was_driven_by(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(LOG)
    recording(Command.held(tmp_path / "log.csv"), 0.0, tmp_path / "r01.csv", sigma_mm=0.0)
    path = experiment(tmp_path, 'id = "r01"\ncommands = "log.csv"\nmarks = "r01.csv"')
    session = session_of(read_with(load_experiment, path), {"r01": tmp_path / "r01.csv"})
    (run,) = session.data
    assert run.command == PHASES[0]
    assert (run.start_s, run.stop_s) == (1.0, 14.0)
    own = (5.0, -3.0, 0.6, *([0.0] * (PER_RUN - 3)))
    (marks,) = Simulated(session.robots, session.data, {}).marks([Task(0, own)])
    assert np.allclose(marks, run.marks_mm, atol=2e-4)


@pytest.mark.parametrize("said", ["left_rpm = 33.3\nright_rpm = 14.4", 'commands = "log.csv"'])
def test_a_run_that_does_not_start_at_rest_is_compared_and_diagnosed_from_its_first_frame(
    tmp_path: Path, said: str
) -> None:
    (tmp_path / "log.csv").write_text("time_s,left_rpm,right_rpm\n0,33.3,14.4\n")
    recording(Command.always(33.3, 14.4), 0.0, tmp_path / "all.csv", sigma_mm=0.0)
    whole = pd.read_csv(tmp_path / "all.csv")
    later = whole[whole["time_s"] >= 5.0].reset_index(drop=True)
    later.to_csv(tmp_path / "r01.csv", index=False)
    path = experiment(tmp_path, f'id = "r01"\n{said}\nstarts_at_rest = false\nmarks = "r01.csv"')
    found = analyze(path, tmp_path / "out", simulate=True, workers=1)
    assert found.comparison is not None
    assert found.comparison["gap_rms_mm"][0] < 2e-3
    session = session_of(found.experiment, {"r01": tmp_path / "r01.csv"})
    motion = simulate(load_robot("barrel"), Command.always(33.3, 14.4), whole["time_s"], State(5.0, -3.0, 0.6))
    at = int(np.searchsorted(whole["time_s"], 5.0))
    own = (float(motion.x_mm[at]), float(motion.y_mm[at]), float(motion.heading_rad[at]), *([0.0] * (PER_RUN - 3)))
    (marks,) = Simulated(session.robots, session.data, {}).marks([Task(0, own)])
    # The simulation starts a millisecond before the first frame, 2 µm of way.
    assert np.abs(marks - session.data[0].marks_mm).max() < 4e-3


def test_a_log_that_cannot_be_used_is_a_fault_of_its_run_alone(tmp_path: Path) -> None:
    (tmp_path / "good.csv").write_text(LOG)
    (tmp_path / "bad.csv").write_text("time_s,left\n0,1\n")
    recording(Command.held(tmp_path / "good.csv"), 0.0, tmp_path / "r01.csv")
    runs = [f'id = "r0{k}"\ncommands = "{log}.csv"\nmarks = "r01.csv"' for k, log in ((1, "good"), (2, "bad"))]
    found = analyze(experiment(tmp_path, *runs), tmp_path / "out", workers=1)
    assert list(found.faults) == ["r02"]
    assert "bad.csv: lacks left_rpm, right_rpm" in found.faults["r02"]
    assert found.turning["radius_mm"].notna().tolist() == [True, True, False]


def test_a_log_without_a_phase_leaves_a_row_that_says_so(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("time_s,left_rpm,right_rpm\n1.0,33.3,14.4\n1.1,0,0\n")
    recording(Command.held(tmp_path / "log.csv"), 0.0, tmp_path / "r01.csv", seconds=3.0)
    path = experiment(tmp_path, 'id = "r01"\ncommands = "log.csv"\nmarks = "r01.csv"')
    found = analyze(path, tmp_path / "out", simulate=True, workers=1)
    assert "nothing with a motor on for" in found.turning["radius_status"][0]
    assert found.comparison is not None
    assert found.comparison["gap_rms_mm"][0] < 0.02
