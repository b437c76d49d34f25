"""Units, clocks and coordinate systems of files of other programs, by hand."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from pydantic import ValidationError

from evaluator.errors import InputError
from evaluator.interchange.bags import Topics, _of_joints, _of_numbers, _of_velocity, _pose, _time_s
from evaluator.interchange.commands import RunCommand, constant, from_log
from evaluator.interchange.poses import LARGEST_CLOCK_S, _zero_s, in_recording_s, poses_of, read_poses, scatter
from evaluator.interchange.tracker_project import Project
from evaluator.interchange.tracks import Tracks, read_any_marks, read_points
from simulator.command import Command

MARKS = ("green", "yellow")
HEADER = "time_s,green_x_mm,green_y_mm,yellow_x_mm,yellow_y_mm,green_x_sigma_mm,green_xy_cov_mm2\n"


def test_lengths_of_marks_in_inches_become_millimetres_and_their_covariances_square_ones(tmp_path: Path) -> None:
    path = tmp_path / "m.csv"
    path.write_text(HEADER + "0,1,2,3,4,0.1,0.01\n1,5,6,7,8,0.1,0.01\n", encoding="utf-8")
    table = read_any_marks(path, Tracks(unit="inch"), marks=MARKS)
    assert table.iloc[1, :5].tolist() == pytest.approx([1.0, 127.0, 152.4, 177.8, 203.2])
    assert table.iloc[0, 5:7].tolist() == pytest.approx([2.54, 6.4516])
    assert read_any_marks(path, marks=MARKS).iloc[1, 1] == 5.0
    time_s, points, unit = read_points(path, Tracks(unit="cm"))
    assert (time_s.tolist(), unit, list(points)) == ([0.0, 1.0], "mm", list(MARKS))
    assert points["yellow"].tolist() == [[30.0, 40.0], [70.0, 80.0]]


def test_points_of_an_image_are_read_with_y_up_where_no_camera_places_them(tmp_path: Path) -> None:
    path = tmp_path / "m.csv"
    path.write_text("time_s,green_x_px,green_y_px\n0,1,2\n1,5,6\n", encoding="utf-8")
    _, points, unit = read_points(path)
    assert unit == "px"
    assert points["green"].tolist() == [[1.0, -2.0], [5.0, -6.0]]


def test_a_misspelt_property_of_tracks_is_no_mark() -> None:
    assert Tracks.model_validate({"unit": "cm", "left": "LED 1"}).name("left") == "LED 1"
    assert Tracks().name("left") == "left"
    with pytest.raises(ValidationError, match=r"unknown key tracks\.likelyhood; did you mean likelihood"):
        Tracks.model_validate({"likelyhood": "0.5"})


def test_uncertainties_of_poses_are_read_in_the_units_of_their_columns(tmp_path: Path) -> None:
    path = tmp_path / "p.csv"
    names = "time_ms,x_cm,y_m,heading_rad,x_sigma_m,y_sigma_cm,heading_sigma_rad,xy_cov_cm2"
    rows = "\n".join(f"{1000 + 20 * k},{k},{0.1 * k},{0.01 * k},0.002,0.3,0.01,0.04" for k in range(9))
    path.write_text(f"{names}\n{rows}\n", encoding="utf-8")
    found = read_poses(path)
    row = found.table.iloc[3]
    assert found.noise_stated
    assert found.table["time_s"].tolist() == pytest.approx([1.0 + 0.02 * k for k in range(9)])
    assert (row["x_mm"], row["y_mm"], row["heading_deg"]) == pytest.approx((30.0, 300.0, np.degrees(0.03)))
    assert (row["x_sigma_mm"], row["y_sigma_mm"], row["xy_cov_mm2"]) == pytest.approx((2.0, 3.0, 4.0))
    assert row["heading_sigma_deg"] == pytest.approx(np.degrees(0.01))


STEPS = Command.steps([(0.0, 0.0, 0.0), (1.0, 30.0, 20.0), (2.0, 10.0, 10.0), (5.0, 0.0, 0.0), (6.0, 30.0, 20.0),
                       (9.0, 0.0, 0.0)])  # fmt: skip


@pytest.mark.parametrize(
    ("first_s", "last_s", "main"),
    [(0.0, 10.0, (30.0, 20.0)), (0.0, 5.5, (10.0, 10.0)), (0.0, 1.5, (30.0, 20.0)), (4.5, 6.4, (10.0, 10.0))],
)
def test_main_command_of_a_run_is_held_longest_within_its_recording(
    first_s: float, last_s: float, main: tuple[float, float]
) -> None:
    assert RunCommand(STEPS).main(first_s, last_s) == main


def test_a_run_begins_and_ends_where_its_motors_come_on_first_and_go_off_last() -> None:
    run = RunCommand(STEPS)
    assert (run.start_s, run.stop_s) == (1.0, 9.0)
    assert [(item.begin_s, item.end_s) for item in run.driven] == [(1.0, 2.0), (2.0, 5.0), (6.0, 9.0)]
    moving = constant(30.0, 20.0, 0.7, 4.0, starts_at_rest=False)
    assert (moving.start_s, moving.stop_s, moving.starts_at_rest) == (None, 4.0, False)
    still = RunCommand(Command.constant(0.0, 0.0))
    assert (still.start_s, still.stop_s, still.main(0.0, 9.0)) == (None, None, (0.0, 0.0))
    begun = constant(30.0, 20.0, 0.7, None)
    assert (begun.start_s, begun.stop_s, begun.starts_at_rest) == (0.7, None, True)


def test_a_clock_of_the_recording_that_is_fast_delays_its_own_times_but_no_log(tmp_path: Path) -> None:
    """Times are multiplied by 1.25 from the first frame on: the log of the motors has another clock, and is right."""
    np.testing.assert_allclose(RunCommand(STEPS).in_true_time(1.25).time_s, STEPS.time_s / 1.25)
    table = pd.DataFrame({"time_s": [0.2, 1.2], "left_rpm": [30.0, 0.0], "right_rpm": [20.0, 0.0]})
    table.to_csv(tmp_path / "log.csv", index=False)
    told = from_log(tmp_path / "log.csv", 5.0)
    first, last = (told.in_true_time(1.25).stretches()[k].begin_s for k in (1, 2))
    assert (told.start_s, told.zero_s, first, last) == pytest.approx((5.2, 5.0, 4.2, 5.2))
    late = told.later(0.5)
    assert (late.start_s, late.zero_s) == pytest.approx((5.7, 5.5))
    assert late.in_true_time(1.25).stretches()[1].begin_s == pytest.approx(4.6)
    assert (RunCommand(STEPS).later(2.0).start_s, RunCommand(STEPS).later(2.0).zero_s) == (3.0, None)
    table["time_s"] += 1.7e9  # of a computer that logged both
    table.to_csv(tmp_path / "log.csv", index=False)
    assert from_log(tmp_path / "log.csv", 0.0, 1.7e9).zero_s is None


def project(folder: Path, *, systems: list[dict[str, float]], clip: str = "", control: str = "") -> Project:
    """A project of OSP Tracker with a coordinate system for each of its frames."""

    def numbers(values: dict[str, float]) -> str:
        return "".join(f'<property name="{key}">{value}</property>' for key, value in values.items())

    frames = "".join(
        f'<property name="[{k}]"><object>{numbers(one)}</object></property>' for k, one in enumerate(systems)
    )
    path = folder / "p.trk"
    path.write_text(
        f'<object><property name="videoclip"><object>{clip}</object></property>'
        f'<property name="clipcontrol"><object>{control}</object></property>'
        f'<property name="coords"><object><property name="framedata">{frames}</property></object></property></object>',
        encoding="utf-8",
    )
    return Project(path)


def test_points_of_a_project_are_placed_by_the_coordinate_system_of_their_frame(tmp_path: Path) -> None:
    """Of the first two frames: 100 px right of and 50 above an origin, turned by 90 degrees; later ones as the last."""
    system = {"xorigin": 300.0, "yorigin": 200.0, "angle": 90.0, "xscale": 10.0, "yscale": 5.0}
    later = {"xorigin": 350.0, "yorigin": 200.0, "angle": 0.0, "xscale": 10.0, "yscale": 5.0}
    told = project(tmp_path, systems=[system, system, later])
    places = told.on_plate(np.array([0.0, 1.0, 2.0, 9.0]), np.array([[400.0, 150.0]] * 4))
    assert places == pytest.approx(np.array([[5.0, -20.0]] * 2 + [[5.0, 10.0]] * 2))
    with pytest.raises(InputError, match="scale that is not positive"):
        project(tmp_path, systems=[system | {"yscale": 0.0}]).on_plate(np.zeros(1), np.zeros((1, 2)))
    with pytest.raises(InputError, match="no coordinate system"):
        project(tmp_path, systems=[]).on_plate(np.zeros(1), np.zeros((1, 2)))


def test_frames_of_a_project_are_timed_from_its_first_one_on(tmp_path: Path) -> None:
    clip = '<property name="startframe">10</property><property name="starttime">500</property>'
    told = project(tmp_path, systems=[], clip=clip, control='<property name="delta_t">20</property>')
    assert told.times_s(np.array([10.0, 12.0]), None) == pytest.approx([0.5, 0.54])
    assert told.times_s(np.array([10.0, 12.0]), 25.0) == pytest.approx([0.5, 0.58])
    with pytest.raises(InputError, match="no frame duration"):
        project(tmp_path, systems=[]).times_s(np.zeros(1), None)


def test_commands_of_a_bag_are_wheel_speeds_left_and_right() -> None:
    """1 m/s and 0.5 rad/s over a track of 0.6 m: 0.85 and 1.15 m/s, of wheels of 0.2 m."""
    twist = SimpleNamespace(linear=SimpleNamespace(x=1.0), angular=SimpleNamespace(z=0.5))
    topics = Topics(wheel_radius_m=0.2, track_m=0.6, left_joint=("a", "c"), right_joint="b")
    assert _of_velocity(twist, topics, "bag") == pytest.approx((4.25, 5.75))
    joints = SimpleNamespace(name=["a", "b", "c"], velocity=[1.0, 5.0, 2.0])
    assert _of_joints(joints, topics, "bag") == (1.5, 5.0)
    assert _of_numbers(SimpleNamespace(data=[3.0, 4.0]), topics, "bag") == (3.0, 4.0)
    with pytest.raises(InputError, match="no velocity of d"):
        _of_joints(joints, Topics(left_joint="d", right_joint="b"), "bag")
    with pytest.raises(InputError, match="say left_joint"):
        _of_joints(joints, Topics(), "bag")


@pytest.mark.parametrize(("first", "known"), [(0.04, True), (0.0, False), (-1.0, False)])
def test_pose_of_a_bag_has_the_heading_of_its_x_axis_and_a_covariance_where_one_is_stated(
    first: float, *, known: bool
) -> None:
    half = np.radians(35.0)
    pose: Any = SimpleNamespace(
        position=SimpleNamespace(x=1.0, y=2.0, z=9.0),
        orientation=SimpleNamespace(x=0, y=0, z=np.sin(half), w=np.cos(half)),
    )
    full = np.arange(36.0).reshape(6, 6) / 100
    full[0, 0] = first
    place, covariance = _pose(SimpleNamespace(pose=pose, covariance=full.ravel()))
    assert place == pytest.approx([1.0, 2.0, np.radians(70.0)])
    expected = [[first, 0.01, 0.05], [0.06, 0.07, 0.11], [0.30, 0.31, 0.35]] if known else np.full((3, 3), np.nan)
    assert covariance == pytest.approx(np.array(expected), nan_ok=True)
    assert np.isnan(_pose(pose)[1]).all()


def test_a_message_has_the_time_of_its_header_or_that_at_which_it_was_recorded() -> None:
    def stamped(sec: int, nanosec: int) -> Any:
        return SimpleNamespace(header=SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=nanosec)))

    assert _time_s(stamped(3, 250_000_000), 7_000_000_000) == pytest.approx(3.25)
    assert _time_s(stamped(0, 0), 7_500_000_000) == _time_s(SimpleNamespace(), 7_500_000_000) == pytest.approx(7.5)


@pytest.mark.parametrize(
    ("times", "zero_s"),
    [
        ([1.7e9 + 0.75, 1.7e9 + 2.0], 1.7e9),
        ([np.nan, 1.7e9 + 0.25], 1.7e9),  # the first that is known
        ([LARGEST_CLOCK_S - 1.0], 0.0),
        ([LARGEST_CLOCK_S + 1.5], LARGEST_CLOCK_S + 1.0),
        ([-LARGEST_CLOCK_S - 1.5], -LARGEST_CLOCK_S - 2.0),
        ([np.nan], 0.0),
        ([], 0.0),
    ],
)
def test_a_clock_that_counts_from_1970_is_read_from_the_last_whole_second_before_the_first_pose(
    times: list[float], zero_s: float
) -> None:
    assert _zero_s(np.array(times)) == zero_s


@pytest.mark.parametrize(
    ("stated_s", "zero_s", "found_s"), [(1.7e9 + 3.0, 1.7e9, 3.0), (3.0, 1.7e9, 3.0), (-1.7e9, 5.0, -1.7e9 - 5.0)]
)
def test_a_time_that_counts_from_1970_is_one_of_the_recording_and_any_other_is_already(
    stated_s: float, zero_s: float, found_s: float
) -> None:
    assert in_recording_s(stated_s, zero_s) == found_s


def test_scatter_of_poses_is_that_about_parabolas_in_time_whatever_the_times() -> None:
    rng = np.random.default_rng(4)
    time = np.cumsum(rng.uniform(0.05, 0.2, 4000))
    smooth = 3 - 2 * time + 0.1 * time**2
    assert scatter(time[:200], smooth[:200]) == pytest.approx(0.0, abs=1e-9)
    assert scatter(time, smooth + 0.02 * rng.normal(size=4000)) == pytest.approx(0.02, rel=0.03)
    assert scatter(time[:9], (-1.0) ** np.arange(9)) > 0.5
    assert scatter(time[:8], (-1.0) ** np.arange(8)) == 0.0  # too few to tell


def test_covariance_of_a_pose_is_in_mm_and_rad_and_a_frame_without_any_part_has_none() -> None:
    values = {"time_s": [0.0, 0.1], "x_mm": [1.0, 2.0], "y_mm": [3.0, np.nan], "heading_deg": [90.0, 80.0]}
    sigmas = {"x_sigma_mm": 0.1, "y_sigma_mm": 0.2, "heading_sigma_deg": 0.5, "xy_cov_mm2": 0.01}
    found = poses_of(pd.DataFrame(values | sigmas))
    angle = np.radians(0.5) ** 2
    np.testing.assert_allclose(found.covariance[0], [[0.01, 0.01, 0], [0.01, 0.04, 0], [0, 0, angle]])
    assert found.heading_rad[0] == pytest.approx(np.pi / 2)
    assert np.isnan([found.x_mm[1], found.y_mm[1], found.heading_rad[1]]).all()
    assert found.status.tolist() == ["ok", "no pose in the file"]
