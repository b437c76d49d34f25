"""Measured beside simulated: where a run starts, what its clock and marks say, and how far the two lie apart."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator import comparison
from evaluator.comparison import (
    BESIDE,
    _simulated_from,
    comparison_row,
    resting_pose,
    simulated_path,
    simulated_poses,
    start_pose,
    trajectory_gap,
)
from evaluator.interchange.commands import RunCommand
from evaluator.mark_geometry import MarkGeometry
from evaluator.pose import Poses
from evaluator.robot_geometry import robot_shape
from evaluator.workflow.runs.phases import phases_of
from simulator.command import Command
from simulator.effects.entry import EffectEntry
from simulator.effects.view import View
from simulator.robot import Robot, load_robot
from simulator.run import State

FRAME_S = 0.02
STILL = np.zeros(4)


def poses_of(time: np.ndarray, x: np.ndarray, y: np.ndarray, heading: np.ndarray) -> Poses:
    return Poses(time, x, y, heading, np.tile(1e-6 * np.eye(3), (len(time), 1, 1)), np.full(len(time), "ok"))


def moving(first_s: float, frames: int = 50) -> Poses:
    """Position along parabolas and heading along a line, in the time of the recording."""
    time = first_s + FRAME_S * np.arange(frames)
    return poses_of(time, 1 + 2 * time + 3 * time**2, 4 - time + 0.5 * time**2, 0.3 + 0.7 * time)


@pytest.mark.parametrize("resting", [3, 10])
def test_run_starts_at_the_mean_of_its_frames_at_rest(resting: int) -> None:
    poses = moving(-FRAME_S * (resting - 1))
    x, y, heading = start_pose(poses, 0.0)
    assert (x, y, heading) == pytest.approx(
        (poses.x_mm[:resting].mean(), poses.y_mm[:resting].mean(), poses.heading_rad[:resting].mean())
    )


@pytest.mark.parametrize(
    ("moved", "since_s"), [((0.2, 0.0, 0.0), -0.33), ((0.0, 0.0, 0.05), -0.33), ((0.004, 0.0, 0.0), -1.0)]
)
def test_run_starts_where_it_stands_since_a_hand_moved_it(moved: tuple[float, ...], since_s: float) -> None:
    """0.4 s before its motors. By 4 µm, within noise, it is not moved, nor by one wrong mark."""
    time = np.linspace(-1.0, 0.0, 51)
    rng = np.random.default_rng(3)
    places = np.array([1.0, 2.0, 0.5]) + rng.normal(0.0, 0.003, (51, 3)) - np.outer(time < -0.4 - 1e-9, moved)
    places[-8] += 0.3
    chosen = places[time >= since_s - 1e-9]
    assert start_pose(poses_of(time, *places.T), 0.0) == pytest.approx(chosen.mean(axis=0))


def test_run_recorded_from_its_start_on_starts_where_its_parabola_does() -> None:
    assert start_pose(moving(-FRAME_S), 0.0) == pytest.approx((1.0, 4.0, 0.3))  # two frames are no rest
    late = moving(0.5)
    assert start_pose(late, 0.0) == pytest.approx((late.x_mm[0], late.y_mm[0], late.heading_rad[0]))


def test_only_the_first_quarter_of_a_second_tells_the_start() -> None:
    poses = moving(0.0)
    x = np.array(poses.x_mm)
    x[poses.time_s > 0.25 + 1e-9] += 100.0
    assert start_pose(poses_of(poses.time_s, x, poses.y_mm, poses.heading_rad), 0.0)[0] == pytest.approx(1.0)
    x[12] += 1.0  # at 0.24 s
    assert start_pose(poses_of(poses.time_s, x, poses.y_mm, poses.heading_rad), 0.0)[0] != pytest.approx(1.0, abs=1e-3)


def test_heading_at_the_start_is_that_of_a_line_and_follows_no_bend() -> None:
    """The least-squares line through n places of a parabola t², h apart, begins at -h²·(n-1)·(n-2)/6."""
    poses = moving(0.0)
    bent = poses_of(poses.time_s, poses.x_mm, poses.y_mm, poses.heading_rad + poses.time_s**2)
    assert start_pose(bent, 0.0)[2] == pytest.approx(0.3 - FRAME_S**2 * 12 * 11 / 6)  # 13 frames in a quarter second


@pytest.mark.parametrize("frames", [4, 5])
def test_four_frames_are_enough_for_a_parabola(frames: int) -> None:
    poses = moving(0.1, frames)
    assert start_pose(poses, 0.0) == pytest.approx((poses.x_mm[0], poses.y_mm[0], poses.heading_rad[0]))


def test_three_frames_are_averaged_and_missing_ones_left_out() -> None:
    poses = moving(0.1, 3)
    assert start_pose(poses, 0.0) == pytest.approx((poses.x_mm.mean(), poses.y_mm.mean(), poses.heading_rad.mean()))
    many = moving(0.1)
    values = [np.array(value) for value in (many.x_mm, many.y_mm, many.heading_rad)]
    for value in values:
        value[:5] = np.nan
    first = many.time_s[5]
    assert start_pose(poses_of(many.time_s, *values), 0.0) == pytest.approx(
        (1 + 2 * first + 3 * first**2, 4 - first + 0.5 * first**2, 0.3 + 0.7 * first)
    )


GEOMETRY = MarkGeometry((-1.5, 1.8), (-1.5, -1.8))


def test_robot_whose_marks_sit_elsewhere_rests_where_they_were_seen() -> None:
    view = View(((-1.4, 2.0), (-1.4, -1.6)))  # both 0.1 mm ahead and 0.2 mm to the left of where they should be
    x, y, heading = resting_pose(view, GEOMETRY, (3.0, -2.0, 0.5))
    assert heading == pytest.approx(0.5)
    cos, sin = np.cos(0.5), np.sin(0.5)
    assert (x, y) == pytest.approx((3.0 - 0.1 * cos + 0.2 * sin, -2.0 - 0.1 * sin - 0.2 * cos))


def test_robot_seen_in_long_millimetres_rests_nearer_to_the_origin() -> None:
    x, y, heading = resting_pose(View(tuple(GEOMETRY.places_mm.values()), scale=1.25), GEOMETRY, (10.0, 20.0, 0.0))
    # The middle of the marks, (8.5, 20), is seen 1.25 times too far out.
    assert (x, y, heading) == pytest.approx((8.5 / 1.25 + 1.5, 16.0, 0.0), abs=1e-6)


def barrel(*effects: dict[str, object]) -> Robot:
    return load_robot("barrel").model_copy(update={"effect": tuple(EffectEntry.model_validate(e) for e in effects)})


RUN = RunCommand(Command.constant(33.0, 20.0, 1.0, 3.0))


def at_rest(seconds: float = 5.0) -> Poses:
    time = np.arange(0, seconds, FRAME_S)
    return poses_of(time, np.full(len(time), 3.0), np.full(len(time), -2.0), np.full(len(time), 0.7))


def test_simulated_run_starts_in_the_measured_pose_and_moves_between_the_commands() -> None:
    motion, seen = simulated_poses(barrel(), RUN, at_rest())
    np.testing.assert_array_equal(seen.time_s, at_rest().time_s)
    start = seen.time_s <= 1.0
    np.testing.assert_allclose(seen.x_mm[start], 3.0, atol=1e-6)
    np.testing.assert_allclose(seen.y_mm[start], -2.0, atol=1e-6)
    np.testing.assert_allclose(seen.heading_rad[start], 0.7, atol=1e-6)
    np.testing.assert_allclose(seen.x_mm, motion.x_mm, atol=1e-9)
    speed = np.hypot(np.diff(seen.x_mm), np.diff(seen.y_mm)) / FRAME_S
    moves = seen.time_s[1:][speed > 0.2]
    assert (moves[0], moves[-1]) == pytest.approx((1.04, 3.0), abs=0.1)
    assert seen.heading_rad[-1] < 0.7  # the left wheels are faster: it turns to the right


def test_simulated_run_starts_at_the_mean_of_all_frames_before_its_motors() -> None:
    rest = at_rest(1.5)
    x = np.where(rest.time_s < 0.3, 3.01, 3.0)
    _, seen = simulated_poses(barrel(), RUN, poses_of(rest.time_s, x, rest.y_mm, rest.heading_rad))
    assert seen.x_mm[0] == pytest.approx(x[rest.time_s <= 1.0].mean(), abs=1e-6)


def test_a_single_mark_sets_place_and_heading_of_a_simulated_run_by_its_path() -> None:
    def path_of(start: State) -> Poses:
        path = _simulated_from(start, barrel(), RUN, at_rest(), 0)[1]
        return poses_of(path.time_s, path.x_mm, path.y_mm, np.full(len(path.time_s), np.nan))

    motion, seen = simulated_path(barrel(), RUN, path_of(State(-4.0, 7.0, 2.0)))
    assert (motion.x_mm[0], motion.y_mm[0], motion.heading_rad[0]) == pytest.approx((-4.0, 7.0, 2.0), abs=1e-3)
    np.testing.assert_allclose(seen.x_mm, path_of(State(-4.0, 7.0, 2.0)).x_mm, atol=1e-3)


def test_a_sensor_of_few_frames_tells_the_start_by_its_first_four() -> None:
    time = 0.2 * np.arange(1, 8)  # two frames in a quarter of a second
    x = 1 + 2 * time + 3 * time**2 + 10.0 * (np.arange(7) > 3)
    heading = np.where(np.arange(7) == 1, np.nan, 0.3 + 0.7 * time)
    x[4] -= 10.0  # the fourth that is known
    assert start_pose(poses_of(time, x, 0 * time, heading), 0.0) == pytest.approx((x[0], 0.0, heading[0]))


def test_clock_that_runs_fast_sees_the_same_start_and_a_slower_robot() -> None:
    plain = simulated_poses(barrel(), RUN, at_rest())[1]
    motion, seen = simulated_poses(barrel({"id": "time-base", "factor": 1.25}), RUN, at_rest())
    np.testing.assert_allclose(motion.time_s * 1.25, seen.time_s)
    np.testing.assert_allclose(seen.time_s, plain.time_s)
    way = [np.hypot(p.x_mm[p.time_s <= 2.5][-1] - 3.0, p.y_mm[p.time_s <= 2.5][-1] + 2.0) for p in (plain, seen)]
    assert way[1] == pytest.approx(way[0] / 1.25, rel=0.02)


def test_run_that_does_not_start_at_rest_has_the_speed_of_its_command_at_its_first_pose() -> None:
    told = RunCommand(Command.constant(33.0, 20.0, -1.0), starts_at_rest=False)
    motion, seen = simulated_poses(barrel(), told, at_rest())
    np.testing.assert_allclose(motion.u_mm_s, motion.u_mm_s[-1], rtol=1e-4)
    resting, _ = simulated_poses(barrel(), RunCommand(told.command), at_rest())
    assert resting.u_mm_s[0] == 0.0
    assert (seen.x_mm[0], seen.y_mm[0], seen.heading_rad[0]) == pytest.approx((3.0, -2.0, 0.7), abs=1e-6)
    again = simulated_poses(barrel(), told, seen)[1]  # of the moving robot: 0.03 mm a frame
    assert trajectory_gap(seen, again)["gap_rms_mm"] < 1e-3


def test_speed_of_a_robot_in_motion_is_that_of_its_command_at_the_first_pose_by_its_own_clock(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(comparison, "moving_state", lambda *given: asked.append(given[2:]) or given[2])
    robot = barrel({"id": "time-base", "factor": 1.25})
    told = RunCommand(Command.constant(33.0, 20.0, -1.0), starts_at_rest=False)
    _simulated_from(State(1.0, 2.0, 0.3), robot, told, moving(0.5), 4)
    along = (2 + 6 * 0.5 + 1j * (-1 + 0.5)) * np.exp(-1j * (0.3 + 0.7 * 0.5))  # as measured there
    ((begin, *others),) = asked
    assert others == [pytest.approx(0.4), 4]
    assert begin.to_array() == pytest.approx([1.0, 2.0, 0.3, along.real, along.imag, 0.7])
    unseen = moving(0.5, 4)  # too few poses for a velocity
    _simulated_from(State(1.0, 2.0, 0.3), robot, told, unseen, 4)
    assert asked[1][0] == State(1.0, 2.0, 0.3)


def test_counterpart_is_read_by_the_same_estimator() -> None:
    long = RunCommand(Command.constant(33.0, 20.0, 1.0))
    motion, seen = simulated_poses(barrel(), long, at_rest(8.0))
    (phase,) = phases_of(long, at_rest(8.0))
    turning = phase.measured(seen, robot_shape(barrel()))
    assert turning.radius_status == "ok"
    rates = np.degrees(np.diff(motion.heading_rad)[-50:] / FRAME_S)
    assert turning.yaw_rate_deg_s == pytest.approx(rates.mean(), rel=1e-3)
    assert np.isfinite(turning.to_row()["front_left_slip_ratio"])  # of the commanded rpm and the robot's shape


def test_a_run_without_rest_is_read_from_its_first_frames_though_some_lie_before_its_start() -> None:
    poses = moving(-0.3)
    assert start_pose(poses, 0.0, at_rest=False) == pytest.approx((1.0, 4.0, 0.3))


def test_a_run_in_motion_or_without_motors_starts_at_its_first_pose() -> None:
    moves, stands = Command.constant(33.0, 20.0, 0.8), Command.constant(0.0, 0.0, 0.8)
    for told in (RunCommand(moves, starts_at_rest=False), RunCommand(stands)):
        poses = moving(0.5)
        _, seen = simulated_poses(barrel(), told, poses)
        assert (seen.x_mm[0], seen.y_mm[0]) == pytest.approx((poses.x_mm[0], poses.y_mm[0]), abs=1e-6)


def simulated_of(radius: float, curvature: float) -> Any:
    """Simulated poses and what the estimator reads in them."""
    values = {"radius_mm": radius, "steady_radius_mm": 2 * radius, **dict.fromkeys(ALIKE, 7.0)}
    seen = SimpleNamespace(x_mm=STILL + 3.0, y_mm=STILL + 4.0, heading_rad=STILL)
    return seen, SimpleNamespace(curvature_per_mm=curvature, to_row=lambda: dict(values))


ALIKE = (*BESIDE, "green_speed_mm_s", "front_speed_mm_s")
MEASURED = {
    "radius_mm": 5.0,
    "radius_low_mm": 4.9,
    "radius_high_mm": 5.2,
    "steady_radius_mm": 8.0,
    "steady_radius_low_mm": 7.8,
    "steady_radius_high_mm": 8.3,
    **dict.fromkeys(ALIKE, 6.0),
}


def test_row_sets_measured_beside_simulated_with_the_difference_of_the_simulated_one() -> None:
    measured: Any = SimpleNamespace(x_mm=STILL, y_mm=STILL, heading_rad=STILL)
    row = comparison_row(MEASURED, measured, *simulated_of(5.5, 0.18))
    assert (row["radius_mm"], row["radius_low_mm"], row["radius_high_mm"], row["simulated_radius_mm"]) == (
        *(5.0, 4.9, 5.2, 5.5),
    )
    assert row["radius_difference_percent"] == pytest.approx(10.0)
    assert row["steady_radius_difference_percent"] == pytest.approx(100 * (11 / 8 - 1))
    assert (row["steady_radius_low_mm"], row["steady_radius_high_mm"]) == (7.8, 8.3)
    assert all((row[name], row[f"simulated_{name}"]) == (6.0, 7.0) for name in ALIKE)
    assert (row["gap_rms_mm"], row["gap_end_mm"]) == pytest.approx((5.0, 5.0))
    # Speeds of the marks follow the speed of the robot, each column beside its simulated one, and none is there twice.
    beside = [name for name in row if name in ALIKE]
    assert beside == [*BESIDE[:2], "green_speed_mm_s", "front_speed_mm_s", *BESIDE[2:]]
    names = list(row)
    assert all(names[names.index(name) + 1] == f"simulated_{name}" for name in beside)


@pytest.mark.parametrize(("curvature", "straight"), [(0.9e-6, True), (-0.9e-6, True), (1.1e-6, False)])
def test_simulated_circle_of_a_kilometre_is_a_straight_line(curvature: float, straight: bool) -> None:
    measured: Any = SimpleNamespace(x_mm=STILL, y_mm=STILL, heading_rad=STILL)
    row = comparison_row(MEASURED, measured, *simulated_of(1e6, curvature))
    assert np.isnan(row["simulated_radius_mm"]) == straight
    assert np.isnan(row["simulated_steady_radius_mm"]) == straight
    assert np.isnan(row["radius_difference_percent"]) == straight


@pytest.mark.parametrize("turns", [-2, 0, 1])
def test_heading_gap_counts_from_the_start_and_whole_turns_in_between_stay(turns: int) -> None:
    measured: Any = SimpleNamespace(x_mm=STILL, y_mm=STILL, heading_rad=np.radians([10.0, 100.0, 200.0, 300.0]))
    heading = np.radians([12.0, 300.0, 380.0, 665.0]) + 2 * np.pi * turns
    simulated: Any = SimpleNamespace(x_mm=STILL, y_mm=STILL, heading_rad=heading)
    assert trajectory_gap(measured, simulated)["heading_gap_end_deg"] == pytest.approx(365.0)


def test_gap_is_that_of_the_frames_where_the_pose_is_known() -> None:
    still = np.zeros(5)
    measured: Any = SimpleNamespace(x_mm=np.array([5.0, np.nan, 5.0, 5.0, np.nan]), y_mm=still, heading_rad=still)
    simulated: Any = SimpleNamespace(x_mm=np.array([8.0, 9.0, 9.0, 10.0, 9.0]), y_mm=still, heading_rad=still)
    gap = trajectory_gap(measured, simulated)
    assert gap["gap_rms_mm"] == pytest.approx(np.sqrt((9 + 16 + 25) / 3))
    assert gap["gap_end_mm"] == pytest.approx(5.0)


def test_poses_that_are_never_known_together_have_no_gap() -> None:
    measured: Any = SimpleNamespace(x_mm=STILL * np.nan, y_mm=STILL, heading_rad=STILL)
    simulated: Any = SimpleNamespace(x_mm=STILL, y_mm=STILL, heading_rad=STILL)
    assert np.isnan(list(trajectory_gap(measured, simulated).values())).all()
