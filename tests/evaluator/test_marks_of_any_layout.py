"""One mark, three marks with one hidden, and marks of any names: what each can tell, and what it says it cannot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from calibration.frames import plate_from_body
from evaluator.cli.measurement.analyze import turning_text
from evaluator.cli.measurement.turning import turning
from evaluator.diagnosis.experiment import session_of
from evaluator.errors import InputError
from evaluator.mark_geometry import MarkGeometry
from evaluator.pose import poses_from_marks
from evaluator.report.runs import views_of
from evaluator.report.summary import summary
from evaluator.robot_geometry import reference_marks
from evaluator.settings import load_experiment
from evaluator.turning import measure_turning
from evaluator.workflow import analyze, circular_test_of
from simulator.command import Command
from simulator.observation import marks_of_run
from simulator.robot import Robot, load_robot, shipped_robot_text
from simulator.run import State
from simulator.simulation import simulate
from tests.evaluator.turning.synthetic import arc_poses

PLACES = {"front": (3.0, 0.0), "left": (-1.5, 2.0), "right": (-1.5, -2.0)}
FRONT_MM = float(np.hypot(20.0 * np.cos(0.1), 3.0 + 20.0 * np.sin(0.1)))  # its path radius: the body slips by 0.1 rad
GEOMETRY = MarkGeometry(PLACES, height_mm=6.5)


def marks_at(places: dict[str, tuple[float, float]], poses: np.ndarray, sigma_mm: float, seed: int) -> pd.DataFrame:
    rng = np.random.default_rng(seed)
    table: dict[str, np.ndarray] = {"time_s": np.arange(len(poses)) / 60}
    for name, place in places.items():
        points = plate_from_body(np.broadcast_to(place, (len(poses), 2)), *poses.T)
        table[f"{name}_x_mm"], table[f"{name}_y_mm"] = (points + rng.normal(0, sigma_mm, points.shape)).T
    return pd.DataFrame(table)


@pytest.fixture
def circling() -> np.ndarray:
    return arc_poses(20.0, 300, 600)


def test_pose_of_three_marks_with_one_hidden_is_the_truth_within_its_sigma(circling: np.ndarray) -> None:
    marks = marks_at(PLACES, circling, 0.01, 1)
    for k, name in enumerate(PLACES):
        marks.loc[100 + 60 * k : 150 + 60 * k, [f"{name}_x_mm", f"{name}_y_mm"]] = np.nan
    poses = poses_from_marks(marks, GEOMETRY)
    assert poses.measured.all()
    off = np.column_stack([poses.x_mm, poses.y_mm, poses.heading_rad]) - circling
    square = np.einsum("ni,nij,nj->n", off, np.linalg.inv(poses.covariance), off) / 3
    for frames in (slice(0, 100), slice(100, 151), slice(160, 211), slice(220, 271), slice(271, 600)):
        assert 0.6 < square[frames].mean() < 1.6  # χ² of three, per degree of freedom


def test_hidden_mark_does_not_make_the_centre_jump_where_robot_toml_is_wrong(circling: np.ndarray) -> None:
    built = {**PLACES, "left": (-1.5, 2.2)}  # 0.2 mm from where robot.toml says
    marks = marks_at(built, circling, 0.0, 2)
    marks.loc[200:400, ["left_x_mm", "left_y_mm"]] = np.nan
    poses = poses_from_marks(marks, GEOMETRY)
    body = np.hypot(poses.x_mm - 0.0, poses.y_mm - 20.0)
    assert np.ptp(body) < 1e-6


def test_mark_that_jumps_is_left_out_and_the_others_carry_the_pose(circling: np.ndarray) -> None:
    marks = marks_at(PLACES, circling, 0.01, 3)
    marks.loc[50, ["front_x_mm"]] += 3.0
    poses = poses_from_marks(marks, GEOMETRY)
    assert np.hypot(poses.x_mm[50] - circling[50, 0], poses.y_mm[50] - circling[50, 1]) < 0.05
    two = poses_from_marks(marks.drop(columns=["right_x_mm", "right_y_mm"]), GEOMETRY)
    assert "mm apart" in two.status[50]
    assert np.isnan(two.heading_rad[50])


def test_radius_of_three_marks_of_any_names_is_found(circling: np.ndarray) -> None:
    found = measure_turning(poses_from_marks(marks_at(PLACES, circling, 0.005, 14), GEOMETRY))
    assert found.radius_low_mm < 20.0 < found.radius_high_mm
    assert set(found.mark_radii_mm) == set(PLACES)
    assert found.to_row()["front_radius_mm"] == pytest.approx(
        np.hypot(20.0 * np.cos(0.1), 3.0 + 20 * np.sin(0.1)), rel=0.01
    )


def test_places_without_names_belong_to_the_marks_in_their_order(circling: np.ndarray) -> None:
    marks = marks_at(PLACES, circling, 0.0, 5)
    poses = poses_from_marks(marks, MarkGeometry(*PLACES.values()))
    assert poses.x_mm == pytest.approx(circling[:, 0], abs=1e-9)


MEASURED_ROBOT = """
[[mark]]
name = "front"
x_mm = 3.0
y_mm = 0.0
[[mark]]
name = "left"
x_mm = -1.5
y_mm = 2.0
[[mark]]
name = "right"
x_m = -0.0015
y_mm = -2.0
"""


def test_turning_reads_marks_of_any_names_from_robot_toml(tmp_path: Path, circling: np.ndarray) -> None:
    (tmp_path / "robot.toml").write_text(MEASURED_ROBOT, encoding="utf-8")
    marks_at(PLACES, circling, 0.005, 6).to_csv(tmp_path / "r.csv", index=False)
    out = tmp_path / "turning.csv"
    CliRunner().invoke(turning, [str(tmp_path / "r.csv"), "--robot", str(tmp_path / "robot.toml"), "-o", str(out)])
    (row,) = pd.read_csv(out).to_dict("records")
    assert row["radius_low_mm"] < 20.0 < row["radius_high_mm"]
    assert np.isfinite([row["front_speed_mm_s"], row["left_speed_mm_s"], row["right_speed_mm_s"]]).all()


def robot_with(marks: list[dict[str, object]]) -> Robot:
    content = load_robot("barrel").model_dump(exclude={"marks"})
    return Robot.model_validate({**content, "mark": marks})


def test_both_ways_of_giving_marks_at_once_and_equal_names_are_refused() -> None:
    mark = {"name": "a", "x_mm": 1.0, "y_mm": 0.0}
    with pytest.raises(ValueError, match="used more than once"):
        robot_with([mark, mark])
    content = load_robot("barrel").model_dump()
    with pytest.raises(ValueError, match="keep one of them"):
        Robot.model_validate({**content, "mark": [mark]})


def test_reference_pair_of_three_marks_is_where_two_of_them_are_though_one_is_hidden() -> None:
    robot = robot_with([{"name": name, "x_mm": x, "y_mm": y} for name, (x, y) in PLACES.items()])
    run = simulate(robot, Command.constant(33.3, 14.4, 0.1), np.arange(120) / 60)
    marks = marks_of_run(robot, run)
    first, second = (
        column.removesuffix("_x_mm") for column in reference_marks(marks, robot) if column.endswith("_x_mm")
    )
    hidden = marks.copy()
    hidden.loc[40:60, [f"{first}_x_mm", f"{first}_y_mm"]] = np.nan
    columns = [f"{first}_x_mm", f"{second}_y_mm"]
    for scale in (1.0, 1.05):  # what is hidden is as much too far away as in the other frames
        found = reference_marks(hidden.assign(**scale * hidden.drop(columns="time_s")), robot)
        assert found[columns].to_numpy() == pytest.approx(scale * marks[columns].to_numpy(), abs=1e-9)


def experiment_of_one_mark(folder: Path, circling: np.ndarray) -> Path:
    barrel = shipped_robot_text("barrel").split("[marks]")[0]
    (folder / "robot.toml").write_text(f'{barrel}\n[[mark]]\nname = "top"\nx_mm = 3.0\ny_mm = 0.0\n', encoding="utf-8")
    marks_at({"top": (3.0, 0.0)}, circling, 0.005, 7).to_csv(folder / "r.csv", index=False)
    (folder / "experiment.toml").write_text(
        'format = 1\nname = "x"\nrobot = "robot.toml"\n'
        '[[run]]\nid = "r"\nleft_rpm = 14\nright_rpm = 33\nmarks = "r.csv"\n',
        encoding="utf-8",
    )
    return folder / "experiment.toml"


def test_run_of_one_mark_gives_its_path_and_says_that_there_is_no_heading(tmp_path: Path, circling: np.ndarray) -> None:
    experiment = experiment_of_one_mark(tmp_path, circling)
    found = analyze(experiment, tmp_path / "out", workers=1)
    (row,) = found.turning.to_dict("records")
    radius = FRONT_MM
    assert f"{row['top_radius_mm']:.3f} (top)" in turning_text(found, verbose=False)
    with pytest.raises(InputError, match="a circular test needs the yaw rate"):
        circular_test_of(found, load_robot(tmp_path / "robot.toml"))
    assert row["top_radius_low_mm"] < radius < row["top_radius_high_mm"]
    assert row["top_speed_mm_s"] == pytest.approx(radius * np.radians(300) / (599 / 60), rel=1e-3)
    assert np.isnan(row["radius_mm"])
    assert row["radius_status"].startswith("no heading: a single mark")
    session = session_of(load_experiment(experiment), {"r": tmp_path / "r.csv"})
    assert "no heading" in session.skipped["r"]


def test_run_of_one_mark_is_compared_with_the_path_of_this_mark_from_the_pose_that_fits_best(tmp_path: Path) -> None:
    experiment = experiment_of_one_mark(tmp_path, arc_poses(20.0, 300, 20))
    robot, start = load_robot(tmp_path / "robot.toml"), State(4.0, -3.0, 2.5)
    motion = simulate(robot, Command.constant(14.0, 33.0, 0.0), np.arange(240) / 30, start=start)
    marks_of_run(robot, motion).to_csv(tmp_path / "r.csv", index=False)
    found = analyze(experiment, tmp_path / "out", workers=1, simulate=True)
    assert found.comparison is not None
    (row,) = found.comparison.to_dict("records")
    assert row["simulated_top_radius_mm"] == pytest.approx(row["top_radius_mm"], rel=1e-6)
    assert row["gap_rms_mm"] < 1e-4
    (view,) = views_of(found, robot)
    assert view.value("simulated_radius_mm", "comparison") == row["simulated_top_radius_mm"]
    assert view.simulated["x_mm"].to_numpy() == pytest.approx(view.poses["x_mm"].to_numpy(), abs=1e-3)
    assert "A single mark (top) shows no heading" in summary([view], {}, None, pd.DataFrame())[0]
