"""Runs given as poses of another system: units, formats, held values, noise, and the same results as from marks."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from evaluator.diagnosis.experiment import session_of
from evaluator.diagnosis.likelihood.preparation import build_problem
from evaluator.diagnosis.likelihood.run_data import PER_RUN, Task
from evaluator.diagnosis.likelihood.simulation import Simulated
from evaluator.errors import InputError
from evaluator.interchange.poses import (
    _from_quaternions,
    _with_noise,
    held,
    holds_poses,
    poses_of,
    read_poses,
    refuse_few,
)
from evaluator.report.build import write_report
from evaluator.settings import Run as StatedRun
from evaluator.workflow import analyze, check_experiment
from evaluator.workflow.turning_tables import Request, measure_table
from simulator.command import Command
from simulator.robot import load_robot
from simulator.run import Run, State
from simulator.simulation import simulate

SIGMA_MM, SIGMA_RAD = 0.004, 0.002


def motion(seconds: float = 6.0, rate_hz: float = 60.0) -> Run:
    times = np.arange(round(rate_hz * seconds)) / rate_hz
    return simulate(load_robot("barrel"), Command.constant(33.3, 14.4, 0.5), times, State(5.0, -3.0, 3.0))


def noisy(run: Run, seed: int = 1) -> pd.DataFrame:
    noise = np.random.default_rng(seed).normal(0, 1, (len(run.time_s), 3))
    return pd.DataFrame(
        {
            "time_s": run.time_s,
            "x_mm": run.x_mm + SIGMA_MM * noise[:, 0],
            "y_mm": run.y_mm + SIGMA_MM * noise[:, 1],
            "heading_deg": np.degrees(np.angle(np.exp(1j * (run.heading_rad + SIGMA_RAD * noise[:, 2])))),
        }
    )


def test_poses_with_semicolons_and_decimal_commas_are_those_with_points(tmp_path: Path) -> None:
    table = noisy(motion())
    points, commas = tmp_path / "points.csv", tmp_path / "commas.csv"
    table.to_csv(points, index=False)
    table.to_csv(commas, index=False, sep=";", decimal=",")
    pd.testing.assert_frame_equal(read_poses(commas).table, read_poses(points).table)
    assert holds_poses(commas)
    commas.write_text(commas.read_text().replace("0,", "0,,", 1))
    with pytest.raises(InputError, match=r"line 2, time_s = '0,,"):
        read_poses(commas)


@pytest.mark.parametrize(("rows", "said"), [(2, "2 poses"), (3, "3 poses"), (4, "")])
def test_a_file_of_poses_that_show_no_motion_is_one_sentence(rows: int, said: str, tmp_path: Path) -> None:
    path = tmp_path / "p.csv"
    noisy(motion()).iloc[:rows].to_csv(path, index=False)
    if said:
        with pytest.raises(InputError, match=rf"p.csv: {said}; a motion and its noise show from 4 poses on"):
            refuse_few(read_poses(path), path)
    else:
        refuse_few(read_poses(path), path)


def experiment(folder: Path, more: str = "") -> Path:
    path = folder / "experiment.toml"
    path.write_text(
        'format = 1\nname = "poses"\nrobot = "barrel"\n[[run]]\nid = "r01"\nleft_rpm = 33.3\nright_rpm = 14.4\n'
        f'start_s = 0.5\nposes = "r01.csv"\n{more}'
    )
    return path


def test_radius_comparison_and_report_of_a_run_of_poses_are_those_of_its_motion(tmp_path: Path) -> None:
    run = motion()
    noisy(run).to_csv(tmp_path / "r01.csv", index=False)
    path = experiment(tmp_path)
    assert check_experiment(path).faults == ()
    found = analyze(path, tmp_path / "out", simulate=True, workers=1)
    (row,) = found.turning.to_dict("records")
    radius = np.hypot(run.u_mm_s[-1], run.v_mm_s[-1]) / abs(run.yaw_rate_rad_s[-1])
    assert row["radius_low_mm"] < radius < row["radius_high_mm"]
    assert row["radius_high_mm"] - row["radius_low_mm"] < 0.01 * radius
    assert found.comparison is not None
    assert found.comparison["gap_rms_mm"][0] < 3 * SIGMA_MM
    assert any("noise estimated from the poses" in note for note in found.notes["r01"])
    write_report(found)
    assert "1 run, from poses" in found.outputs.report.read_text(encoding="utf-8")


def test_the_turning_command_measures_poses_without_a_robot_file(tmp_path: Path) -> None:
    run = motion()
    table = noisy(run)
    table.assign(time_s=table["time_s"] + 1.7e9).to_csv(tmp_path / "r01.csv", index=False, float_format="%.9f")
    found = measure_table(tmp_path / "r01.csv", Request(start_s=1.7e9 + 0.5))
    radius = np.hypot(run.u_mm_s[-1], run.v_mm_s[-1]) / abs(run.yaw_rate_rad_s[-1])
    assert found.row["radius_low_mm"] < radius < found.row["radius_high_mm"]
    assert any("noise estimated from the poses" in line for line in found.lines)
    assert found.row["start_delay_s"] == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ({"start_s": 6.0}, "--start-s is 6 s, but the table ends at 5.95 s"),
        ({"start_s": 5.95}, "--start-s is 5.95 s, but the table ends at 5.95 s"),
        ({"stop_s": 0.0}, "--stop-s is 0 s, but the table begins at 0.00 s"),
    ],
)
def test_motors_that_are_off_throughout_a_table_are_a_mistake(
    stated: dict[str, float], said: str, tmp_path: Path
) -> None:
    poses = noisy(motion()).iloc[:358]
    poses = poses.assign(time_s=np.round(np.arange(358) / 60, 4))
    marks = pd.DataFrame({"time_s": poses["time_s"], "green_x_mm": poses["x_mm"], "green_y_mm": poses["y_mm"]})
    for table in (poses, marks):
        table.to_csv(tmp_path / "r01.csv", index=False)
        assert measure_table(tmp_path / "r01.csv", Request(start_s=-1.0, stop_s=9.0)).row
        with pytest.raises(InputError) as refused:
            measure_table(tmp_path / "r01.csv", Request(**stated))
        assert str(refused.value).startswith(f"{tmp_path / 'r01.csv'}: {said}; give the time in the table")


def test_noise_is_estimated_from_the_poses_where_none_is_stated_and_taken_where_it_is(tmp_path: Path) -> None:
    table = noisy(motion(20.0))
    table.to_csv(tmp_path / "r01.csv", index=False)
    covariance = poses_of(read_poses(tmp_path / "r01.csv").table).covariance[0]
    assert np.sqrt(covariance[0, 0]) == pytest.approx(SIGMA_MM, rel=0.1)
    assert np.sqrt(covariance[2, 2]) == pytest.approx(SIGMA_RAD, rel=0.1)
    stated = table.assign(x_sigma_mm=0.1, y_sigma_mm=0.2, heading_sigma_rad=0.3, xy_cov_mm2=0.01)
    stated.to_csv(tmp_path / "r01.csv", index=False)
    covariance = poses_of(read_poses(tmp_path / "r01.csv").table).covariance[0]
    assert np.allclose(np.diag(covariance), [0.01, 0.04, 0.09])
    assert covariance[0, 1] == pytest.approx(0.01)


def test_metres_radians_tum_and_a_clock_that_counts_from_1970_give_the_same_poses(tmp_path: Path) -> None:
    table, zero_s = noisy(motion()), 1.7e9
    table.to_csv(tmp_path / "mm.csv", index=False)
    metres = pd.DataFrame({"time_s": table["time_s"], "x_m": table["x_mm"] / 1000, "y_m": table["y_mm"] / 1000})
    metres.assign(heading_rad=np.radians(table["heading_deg"])).to_csv(tmp_path / "m.csv", index=False)
    half = np.radians(table["heading_deg"]) / 2
    columns = [table["time_s"] + zero_s, metres["x_m"], metres["y_m"], 0.1 + 0 * half, 0 * half, 0 * half]
    tum = np.column_stack([*columns, np.sin(half), np.cos(half)])
    np.savetxt(tmp_path / "tum.txt", tum, fmt="%.9f", header="timestamp x y z qx qy qz qw")
    euroc = np.column_stack([tum[:, 0] * 1e9, tum[:, 1:4], tum[:, 7], tum[:, 4:7], tum[:, 1:4]])
    np.savetxt(tmp_path / "euroc.csv", euroc, fmt="%.9f", delimiter=",", header="timestamp [ns],p_x [m]")
    named = pd.DataFrame(tum[:, 3:], columns=["z", "qx", "qy", "qz", "qw"]).assign(x_m=tum[:, 1], y_m=tum[:, 2])
    named.assign(time_ns=np.rint(1e9 * tum[:, 0]).astype(np.int64)).to_csv(tmp_path / "named.csv", index=False)
    assert holds_poses(tmp_path / "named.csv")
    clock = pd.to_datetime(np.rint(1e9 * tum[:, 0]).astype(np.int64), utc=True)
    dated = {"dated.csv": clock.strftime("%Y-%m-%dT%H:%M:%S.%fZ"), "east.csv": clock.tz_convert("+05:30").map(str)}
    for name, dates in dated.items():
        named.assign(timestamp=dates).to_csv(tmp_path / name, index=False)
        assert holds_poses(tmp_path / name)
    brackets = {"time_ns": "Time [ns]", "x_m": "x (m)", "y_m": " Y (m)"}
    pd.read_csv(tmp_path / "named.csv").rename(columns=brackets).to_csv(tmp_path / "brackets.csv", index=False)
    assert holds_poses(tmp_path / "brackets.csv")
    for header in ('"time_s","x_mm","y_mm"', "time_s\tx_mm\ty_mm"):  # of R, and of spreadsheets
        (tmp_path / "header.csv").write_text(f"{header}\n")
        assert holds_poses(tmp_path / "header.csv")
    first = read_poses(tmp_path / "mm.csv").table
    for name in ("m.csv", "tum.txt", "euroc.csv", "named.csv", "brackets.csv", *dated):
        other = read_poses(tmp_path / name)
        assert np.allclose(other.table["time_s"], first["time_s"], atol=1e-6)
        for column in ("x_mm", "y_mm", "heading_deg"):
            assert np.allclose(other.table[column], first[column], atol=2e-6)
        assert other.zero_s == (0.0 if name == "m.csv" else zero_s)


def test_a_trajectory_without_times_is_refused_as_one_of_kitti(tmp_path: Path) -> None:
    (tmp_path / "p.txt").write_text("1 0 0 0.5 0 1 0 0.2 0 0 1 0\n" * 2)
    with pytest.raises(InputError, match=r"p.txt: a trajectory in the format of KITTI has no times"):
        read_poses(tmp_path / "p.txt")


def test_a_table_of_other_names_is_refused_with_the_names_that_are_there(tmp_path: Path) -> None:
    (tmp_path / "r01.csv").write_text("t,x,y,yaw\n0,1,2,3\n")
    with pytest.raises(InputError, match=r"lacks time_s, x_mm, y_mm, heading_deg.*found: t, x, y, yaw"):
        read_poses(tmp_path / "r01.csv")


@pytest.mark.parametrize(("pitch", "roll"), [(0.0, 0.0), (0.4, -0.3), (-0.2, 0.7)])
def test_heading_of_a_body_that_leans_is_that_of_its_x_axis_over_the_plane(pitch: float, roll: float) -> None:
    heading = np.array([-170.0, -60.0, 0.0, 45.0, 130.0])
    turned = [Rotation.from_euler("ZYX", [np.radians(angle), pitch, roll]).as_quat() for angle in heading]
    rows = np.column_stack([np.arange(5.0), np.zeros((5, 3)), turned])
    np.testing.assert_allclose(_from_quaternions(rows, 1.0, (4, 5, 6, 7))["heading_deg"], heading, atol=1e-9)


@pytest.mark.parametrize(("rows", "groups", "holds"), [(40, 3, True), (40, 2, False), (103, 5, True), (106, 5, False)])
def test_values_are_held_where_three_and_one_of_twenty_stand_in_groups(rows: int, groups: int, *, holds: bool) -> None:
    values = np.arange(float(rows))
    at = 5 * np.arange(1, groups + 1)
    values[at] = values[at - 1]
    expected = np.isin(np.arange(rows), at) & holds
    np.testing.assert_array_equal(held(values[:, None]), expected)


def test_poses_without_noise_have_the_least_that_a_simulation_leaves() -> None:
    still = pd.DataFrame({"time_s": np.arange(20) / 10, "x_mm": 1.0, "y_mm": 2.0, "heading_deg": 30.0})
    found = _with_noise(still)
    assert found["x_sigma_mm"].tolist() == [1e-6] * 20
    assert found["heading_sigma_deg"].tolist() == pytest.approx([np.degrees(1e-8)] * 20)


def test_commands_and_poses_by_one_clock_that_counts_from_1970_stay_together(tmp_path: Path) -> None:
    zero_s = 1.7e9
    table = noisy(motion())
    table.assign(time_s=table["time_s"] + zero_s).to_csv(tmp_path / "r01.csv", index=False, float_format="%.9f")
    (tmp_path / "log.csv").write_text(f"time_s,left_rpm,right_rpm\n{zero_s + 0.5:.6f},33.3,14.4\n")
    path = experiment(tmp_path)
    text = path.read_text().replace("left_rpm = 33.3\nright_rpm = 14.4\nstart_s = 0.5", 'commands = "log.csv"')
    path.write_text(text)
    found = analyze(path, tmp_path / "out", simulate=True, workers=1)
    (row,) = found.turning.to_dict("records")
    assert row["late_s"] == pytest.approx(0.0, abs=5e-3)
    assert found.comparison is not None
    assert found.comparison["gap_rms_mm"][0] < 3 * SIGMA_MM


@pytest.mark.parametrize("zero_s", [0.0, 1.7e9])
def test_times_of_a_run_count_from_its_first_pose_where_only_the_poses_count_from_1970(
    tmp_path: Path, zero_s: float
) -> None:
    (tmp_path / "r01.csv").write_text(f"time_s,x_mm,y_mm,heading_deg\n{zero_s},1,2,3\n{zero_s + 1},1,2,4\n")
    (tmp_path / "c01.csv").write_text("time_s,left_rpm,right_rpm\n0,10,20\n0.4,0,0\n")
    poses, source = tmp_path / "r01.csv", {"id": "r01", "start_s": 0.5}
    constant = StatedRun(**source, poses=poses, left_rpm=10.0, right_rpm=20.0, stop_s=0.9).run_command()
    logged = StatedRun(**source, poses=poses, commands=tmp_path / "c01.csv").run_command()
    by_clock = StatedRun(**source | {"start_s": zero_s + 0.5}, poses=poses, left_rpm=10.0, right_rpm=20.0).run_command()
    assert (constant.start_s, constant.stop_s) == (0.5, 0.9)
    assert (logged.start_s, logged.stop_s) == (0.5, 0.9)
    assert by_clock.start_s == pytest.approx(0.5, abs=1e-6)


def test_held_values_are_dropped_counted_and_said(tmp_path: Path) -> None:
    table = noisy(motion())
    places = ["x_mm", "y_mm", "heading_deg"]
    fresh = np.arange(len(table)) // 3 * 3  # measured at 20 Hz, sampled at 60 Hz
    table[places] = table[places].to_numpy()[fresh]
    table.to_csv(tmp_path / "r01.csv", index=False)
    found = read_poses(tmp_path / "r01.csv")
    assert found.dropped == 240
    assert np.allclose(found.table["time_s"], np.arange(120) / 20)
    assert "240 of 360 poses repeat the previous one" in found.notes()[0]
    done = analyze(experiment(tmp_path), tmp_path / "out", workers=1)
    assert "240 of 360 poses" in " ".join(done.notes["r01"])


def test_a_robot_at_rest_without_noise_holds_no_value(tmp_path: Path) -> None:
    run = motion()
    table = pd.DataFrame({"time_s": run.time_s, "x_mm": run.x_mm, "y_mm": run.y_mm, "heading_rad": run.heading_rad})
    table.to_csv(tmp_path / "r01.csv", index=False)
    assert read_poses(tmp_path / "r01.csv").dropped == 0


def test_the_distance_of_marks_that_stand_for_poses_says_nothing_in_a_diagnosis(tmp_path: Path) -> None:
    noisy(motion()).to_csv(tmp_path / "r01.csv", index=False)
    found = analyze(experiment(tmp_path), tmp_path / "out", workers=1)
    (run,) = session_of(found.experiment, {"r01": found.outputs.marks("r01")}).data
    assert run.from_poses
    own = (5.0, -3.0, 3.0, *([0.0] * (PER_RUN - 3)))
    problem, _ = build_problem((run,), Simulated((load_robot("barrel"),), (run,), {}))
    (residual,) = problem.residuals([Task(0, own)])
    features = problem.compressions[0].features
    assert np.allclose(features(residual), features(residual + np.array([0.0, 0.0, 0.0, 1.0])), atol=1e-6)
    assert not np.allclose(features(residual), features(residual + np.array([1.0, 0.0, 0.0, 0.0])), atol=1.0)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("time_s,x_mm,y_mm\n0,1,2\n1,1,2\n", "lacks heading_deg"),
        ("time_s,x_mm,y_mm,heading_deg\n0,1,2,3\n1,1,a,3\n", "line 3, y_mm = 'a'"),
        ("time_s,x_mm,x_m,y_mm,heading_deg\n0,1,1,2,3\n1,1,1,2,3\n", "x_mm and x_m"),
        ("time_s,x_mm,y_mm,heading_deg\n1,1,2,3\n0,1,2,3\n", "does not come after"),
        ("0 1 2 3 0 0 0 1\n1 2 3\n", "pose 2"),
    ],
)
def test_a_file_that_holds_no_poses_is_refused_with_its_fault(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "r01.csv").write_text(text)
    with pytest.raises(InputError, match=said):
        read_poses(tmp_path / "r01.csv")
    assert any(said in fault for fault in check_experiment(experiment(tmp_path)).faults)


@pytest.mark.parametrize(
    ("log_s", "said"),
    [
        (0.0, None),
        (9.0, "its log of commands begins 8 s after r01.csv ends; do both count from one moment"),
        (-1.7e9, "its log of commands ends 1.7e\\+09 s before r01.csv begins"),
    ],
)
def test_a_log_by_another_clock_than_the_poses_is_said_to_be_one(
    tmp_path: Path, log_s: float, said: str | None
) -> None:
    (tmp_path / "r01.csv").write_text("time_s,x_mm,y_mm,heading_deg\n0,1,2,3\n1,1,2,4\n")
    (tmp_path / "c01.csv").write_text(f"time_s,left_rpm,right_rpm\n{log_s},1,2\n")
    path = experiment(tmp_path, "starts_at_rest = false\n")
    text = path.read_text().replace("left_rpm = 33.3\nright_rpm = 14.4\nstart_s = 0.5", 'commands = "c01.csv"')
    path.write_text(text)
    faults = check_experiment(path).faults
    assert len(faults) == (said is not None)
    assert said is None or re.search(said, faults[0])
