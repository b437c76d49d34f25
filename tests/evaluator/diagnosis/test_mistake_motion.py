"""What a recording shows of its motion, without a model: speeds, starts, jumps, gaps and spacing, in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.disturbances import disturbed_runs
from evaluator.diagnosis.mistakes.jump import _covers, frames_ahead, jump
from evaluator.diagnosis.mistakes.motion import (
    _carried,
    _missing_elsewhere,
    _missing_over,
    _moving_at,
    displacement_in_gap,
    midpoint_and_heading,
    motion_of,
    onset,
)
from simulator.robot import load_robot
from tests.evaluator.diagnosis.marks_of_motion import NOISE_MM, RATE, TIME, moving, onset_s, recorded


@pytest.mark.parametrize("yaw", [0.8, -2.5, 0.0])
def test_velocity_is_that_of_the_robot_in_its_own_frame(yaw: float) -> None:
    motion = motion_of(recorded(moving(TIME, 2.0, yaw, heading=3.0)))
    assert motion is not None
    np.testing.assert_allclose(motion.along, 2.0, rtol=0.02)
    np.testing.assert_allclose(motion.across, 0.0, atol=0.02)
    np.testing.assert_allclose(motion.yaw, yaw, atol=0.01)
    assert np.diff(motion.time_s) == pytest.approx(np.full(len(motion.time_s) - 1, 0.075))
    part = motion_of(recorded(moving(TIME)), (1.0, 2.0))
    assert part is not None
    assert (part.time_s[0], part.time_s[-1]) == pytest.approx((1.075, 1.9), abs=0.03)


def test_marks_that_slide_sideways_move_across_to_the_left() -> None:
    marks = moving(TIME, 0.0, 0.0, heading=0.3) + np.tile(TIME[:, None] * [-np.sin(0.3), np.cos(0.3)], 2)
    motion = motion_of(recorded(marks))
    assert motion is not None
    np.testing.assert_allclose(motion.across, 1.0, rtol=0.01)
    np.testing.assert_allclose(motion.along, 0.0, atol=0.01)


def test_recordings_of_few_frames_have_no_motion() -> None:
    assert motion_of(recorded(moving(TIME[:15]))) is None
    slow = np.arange(20) / 10  # one or two frames to a window of 0.15 s
    assert motion_of(recorded(moving(slow), slow)) is None


def test_heading_is_that_of_the_robot_whatever_line_its_marks_are_on() -> None:
    run = recorded(moving(TIME))
    time, middle, heading = midpoint_and_heading(run)
    np.testing.assert_allclose(heading, 0.4 + 0.8 * TIME, atol=1e-3)
    np.testing.assert_allclose(middle[0], [3.0, -2.0], atol=1e-3)
    assert len(time) == 180
    holed = run.marks_mm.copy()
    holed[5, 3] = np.nan
    ahead = replace(run, marks_mm=holed, line_rad=0.0)
    assert len(midpoint_and_heading(ahead)[0]) == 179
    np.testing.assert_allclose(midpoint_and_heading(ahead)[2][0], 0.4 + np.pi / 2, atol=1e-3)


def started(begins_s: float, noise_mm: float = NOISE_MM, speed: float = 2.0) -> RunData:
    return recorded(moving(np.maximum(TIME - begins_s, 0.0), speed, 0.2), noise_mm=noise_mm)


@pytest.mark.parametrize("begins_s", [0.3, 1.0, 2.0])
@pytest.mark.parametrize("noise_mm", [1e-4, 0.01])
def test_motion_begins_where_its_distance_from_rest_is_extrapolated_to(begins_s: float, noise_mm: float) -> None:
    assert onset_s(started(begins_s, noise_mm)) == pytest.approx(begins_s, abs=0.004 + noise_mm)


@pytest.mark.parametrize("heading", [0.0, np.pi / 2])
@pytest.mark.parametrize("yaw", [0.8, -0.8])
def test_onset_of_a_robot_that_turns_about_one_of_its_marks_is_that_of_the_other(yaw: float, heading: float) -> None:
    marks = moving(np.maximum(TIME - 1.0, 0.0), 1.6, yaw, heading)
    rests = 0 if yaw > 0 else 2
    assert np.ptp(marks[:, rests : rests + 2], axis=0).max() < 1e-9
    assert onset_s(recorded(marks)) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("ends_s", [0.3, 0.8])
def test_marks_that_settle_and_rest_until_the_start_begin_there(ends_s: float) -> None:
    """The first image of 150 kbit/s is off by 0.06 mm, and becomes finer until the robot starts."""
    run = started(1.0)
    settling = 0.06 * np.clip((TIME[:, None] - 0.15) / (ends_s - 0.15), 0.0, 1.0)
    assert onset_s(replace(run, marks_mm=run.marks_mm + settling, start_s=1.0)) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(("way_mm", "start_s"), [(0.06, 0.2), (0.06, 0.9), (0.6, 1.4)])
def test_what_goes_farther_or_does_not_rest_before_the_start_is_the_motion(way_mm: float, start_s: float) -> None:
    moved = way_mm * np.clip((TIME - 0.3) / 0.6, 0.0, 1.0)
    run = recorded(moving(moved, 1.0, 0.0))
    assert onset_s(replace(run, start_s=start_s)) == pytest.approx(0.3, abs=0.02)


def test_one_frame_beside_its_place_is_no_onset() -> None:
    run = started(1.0)
    marks = run.marks_mm.copy()
    marks[20] += 0.5
    assert onset_s(replace(run, marks_mm=marks)) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(("speed", "rate"), [(0.157, 25), (0.3, 60), (1.0, 60)])
def test_onset_is_as_uncertain_as_the_noise_leaves_it(speed: float, rate: int) -> None:
    """The slowest is a wheel at 3 rpm: in 0.01 mm of noise its start is known to a tenth of a second."""
    rng = np.random.default_rng(2)
    time = np.arange(3 * rate) / rate
    marks = moving(np.maximum(time - 1.0, 0.0), speed, 0.1)
    found = [onset(recorded(marks + rng.normal(0.0, 0.01, marks.shape), time)) for _ in range(100)]
    off = np.array([(one.time_s - 1.0) / one.sigma_s for one in found if one is not None])
    assert len(off) == 100
    assert np.sqrt(np.mean(off**2)) == pytest.approx(1.1, abs=0.25)


@pytest.mark.parametrize("size_mm", [0.5, 3.0])
def test_jump_has_its_moment_and_its_size_less_what_the_robot_moved(size_mm: float) -> None:
    run = recorded(moving(TIME, 2.0, 0.2))
    marks = run.marks_mm.copy()
    marks[100:] += np.tile([0.6 * size_mm, -0.8 * size_mm], 2)
    found = jump(replace(run, marks_mm=marks))
    assert found is not None
    assert found == pytest.approx((99.5 / RATE, size_mm), rel=2e-2)


@pytest.mark.parametrize("size_mm", [0.08, 0.15])
def test_a_light_knock_across_or_against_the_path_is_a_jump_though_lost_frames_move_as_far(size_mm: float) -> None:
    run = recorded(moving(TIME, 2.0, 0.2), noise_mm=0.003)
    ahead = run.marks_mm[101] - run.marks_mm[99]
    ahead = ahead / np.hypot(*ahead[:2])
    for direction, seen in ((-ahead, True), (ahead[[1, 0, 3, 2]] * [1, -1, 1, -1], True), (ahead, size_mm > 0.1)):
        marks = run.marks_mm.copy()
        marks[100:] += size_mm * direction
        assert (jump(replace(run, marks_mm=marks)) is not None) == seen


@pytest.mark.parametrize(("angle_deg", "frames"), [(0.0, 6), (30.0, 0), (180.0, 0)])
def test_a_jump_ahead_is_as_far_as_so_many_frames(angle_deg: float, frames: int) -> None:
    """A straight run whose recorder lost six frames was told to have a moved camera alone."""
    run = recorded(moving(TIME, 2.0, 0.2), noise_mm=0.003)
    step = (moving(TIME, 2.0, 0.2)[[98, 101]] @ np.tile(np.eye(2) / 2, (2, 1))).T @ [-1.0, 1.0]
    ahead = 6 * 2.0 / RATE * (step[0] + 1j * step[1]) / np.hypot(*step) * np.exp(1j * np.radians(angle_deg))
    marks = run.marks_mm.copy()
    marks[100:] += np.tile([ahead.real, ahead.imag], 2)
    jumping = replace(run, marks_mm=marks)
    assert frames_ahead(jumping, 99.5 / RATE) == frames
    (found,) = disturbed_runs([jumping], [load_robot("barrel")])
    assert found.kind == ("wrong-rate" if frames else "camera-moved")
    assert "pushed" in found.equivalent
    assert ("as far as it drives in 6 frames" in found.seen) == bool(frames)


def test_neither_lost_frames_nor_a_start_or_a_reversal_of_the_motors_are_a_jump() -> None:
    lost = recorded(moving(np.where(TIME > 1.5, TIME + 3 / RATE, TIME), 3.0, 0.2), noise_mm=0.003)
    start = recorded(moving(np.maximum(TIME - 1.494, 0.0), 3.0, 0.2), noise_mm=0.003)
    back = recorded(moving(1.494 - np.abs(TIME - 1.494), 3.0, 0.2), noise_mm=0.003)
    assert [jump(run) for run in (lost, start, back)] == [None] * 3


@pytest.mark.parametrize(("across_mm", "seen"), [(0.12, False), (0.2, True)])
def test_a_side_that_starts_first_displaces_the_robot_by_less_than_its_speed_in_a_twentieth_of_a_second(
    across_mm: float, seen: bool
) -> None:
    """At 3 mm/s by up to 0.15 mm; what displaces a robot that drives on as before is a jump."""
    across = across_mm * (np.arange(len(TIME)) >= 90)[:, None] * np.tile([np.sin(0.4), -np.cos(0.4)], 2)
    for since, jumps in ((np.maximum(TIME - TIME[90], 0.0), seen), (TIME, True)):
        run = recorded(moving(since, 3.0, 0.0), noise_mm=0.003)
        assert (jump(replace(run, marks_mm=run.marks_mm + across)) is not None) == jumps


def test_the_larger_of_two_jumps_is_told_and_motion_is_none() -> None:
    run = recorded(moving(TIME, 2.0, 0.2))
    marks = run.marks_mm.copy()
    marks[60:] += 0.5
    marks[120:, [0, 2]] += 2.0
    found = jump(replace(run, marks_mm=marks))
    assert found is not None
    assert found[0] == pytest.approx(119.5 / RATE)
    assert jump(run) is None
    assert jump(recorded(np.tile([1.0, 2.0, 1.0, -2.0], (180, 1)))) is None
    assert jump(replace(run, time_s=TIME[:23], marks_mm=marks[:23])) is None


def test_a_jump_is_ten_times_what_frames_around_it_scatter() -> None:
    """Eight frames before it swing by a tenth of a millimetre: 0.8 mm may be of that, 1.2 mm is not."""
    for size_mm, jumps in ((0.8, False), (1.2, True)):
        marks = moving(TIME, 2.0, 0.0)
        marks[92:100] += 0.1 * (-1.0) ** np.arange(8)[:, None]
        marks[100:] += np.tile([0.6 * size_mm, -0.8 * size_mm], 2)
        found = jump(recorded(marks))
        assert (found is not None) == jumps


def test_steps_as_large_as_all_others_are_no_jump_where_a_run_stands_between_them() -> None:
    marks = np.tile([1.0, 2.0, 1.0, -2.0], (180, 1))
    for frame in (40, 80, 120):
        marks[frame:] += 0.05
    assert jump(recorded(marks, noise_mm=0.0)) is None
    marks[150:] += 0.5
    assert jump(recorded(marks, noise_mm=0.0)) == pytest.approx((149.5 / RATE, 0.5 * np.sqrt(2)), rel=0.05)


def with_gap(push: tuple[float, float], begin: int = 80, end: int = 104, yaw: float = 0.8) -> RunData:
    """Without frames begin to end, over which the robot is pushed as well."""
    marks = moving(TIME, 2.0, yaw)
    marks[end:] += np.tile(push, 2)
    keep = (np.arange(180) < begin) | (np.arange(180) >= end)
    return recorded(marks[keep], TIME[keep], noise_mm=2e-3)


@pytest.mark.parametrize("yaw", [0.8, -1.5])
def test_a_push_within_a_gap_is_what_no_arc_makes(yaw: float) -> None:
    found = displacement_in_gap(with_gap((0.6, -0.8), yaw=yaw), (0.0, 3.0))
    assert found is not None
    assert found == pytest.approx((79 / RATE, 104 / RATE, 1.0), rel=0.05)
    assert displacement_in_gap(with_gap((0.0, 0.0), yaw=yaw), (0.0, 3.0)) is None
    assert displacement_in_gap(with_gap((0.11, -0.15)), (0.0, 3.0)) is None  # less than 0.2 mm


@pytest.mark.parametrize(
    ("begin", "end", "between", "seen"),
    [
        (80, 84, (0.0, 3.0), False),  # 0.08 s: no hand is faster
        (80, 87, (0.0, 3.0), True),
        (60, 118, (0.0, 3.0), True),
        (60, 122, (0.0, 3.0), False),  # beyond a second anything may happen
        (80, 104, (1.24, 3.0), False),  # a start is no push
        (80, 104, (0.0, 1.83), False),
        (80, 104, (1.0, 2.1), True),
    ],
)
def test_gaps_count_that_a_hand_can_use_within_one_command(
    begin: int, end: int, between: tuple[float, float], seen: bool
) -> None:
    assert (displacement_in_gap(with_gap((2.4, -3.2), begin, end), between) is not None) == seen


@pytest.mark.parametrize(("every", "lost"), [(7, 0), (12, 0), (7, 1)])
def test_frames_that_are_seldom_leave_no_gap_and_a_push_between_two_is_a_jump(every: int, lost: int) -> None:
    """Of 8.6 and 5 frames a second, each farther from the next than a gap lasts; with one lost there is one."""
    time = np.arange(0, 720, every) / RATE
    marks = moving(time, 0.5, 0.1)
    marks[30:] += np.tile([0.6, -0.8], 2)
    keep = (np.arange(len(time)) < 30 - lost) | (np.arange(len(time)) >= 30)
    run = recorded(marks[keep], time[keep], noise_mm=2e-3)
    assert (displacement_in_gap(run, (0.0, 12.0)) is not None) == bool(lost)
    found = jump(run)
    assert found is not None
    assert found == pytest.approx(((time[30] + time[29 - lost]) / 2, 1.0), rel=0.05)


@pytest.mark.parametrize("phase", [0.0, 1.6, 3.1, 4.7])
def test_a_ripple_of_the_wheels_is_no_push_over_a_gap(phase: float) -> None:
    """A speed of 8 mm/s that varies by 20 % every 1.3 s leaves up to a millimetre over 0.7 s, all along the run."""
    time = np.arange(360) / RATE
    pulse = 2 * np.pi / 1.3
    way = 8.0 * (time - 0.2 / pulse * np.cos(pulse * time + phase))
    for push_mm, begins in ((0.0, range(60, 240, 20)), (5.0, (150,))):
        for begin in begins:
            marks = np.stack([way, 0 * time + 1.8, way, 0 * time - 1.8], axis=1)
            marks[begin + 42 :] += np.tile([0.6 * push_mm, 0.8 * push_mm], 2)
            keep = (np.arange(360) < begin) | (np.arange(360) >= begin + 42)
            found = displacement_in_gap(recorded(marks[keep], time[keep], noise_mm=2e-3), (0.0, 6.0))
            assert (found is not None) == (push_mm > 0)


@pytest.mark.parametrize("yaw", [0.9, -0.9, 0.0])
def test_a_pose_is_carried_along_its_arc(yaw: float) -> None:
    marks = moving(np.array([0.0, 1.7]), 2.0, yaw)
    middle = (marks[1, :2] + marks[1, 2:]) / 2
    ahead = _carried(np.array([3.0, -2.0, 0.4]), np.array([2.0, 0.0, yaw]), 1.7)
    np.testing.assert_allclose(ahead, [*middle, 0.4 + 1.7 * yaw], atol=1e-12)
    np.testing.assert_allclose(_carried(ahead, np.array([2.0, 0.0, yaw]), -1.7), [3.0, -2.0, 0.4], atol=1e-12)
    np.testing.assert_allclose(
        _carried(np.zeros(3), np.array([0.0, 2.0, 0.0]), 1.0), [0.0, 2.0, 0.0]
    )  # across is to the left


def test_pose_and_velocity_at_a_moment_are_those_of_the_arc_and_scatter_is_that_of_a_frame() -> None:
    time = TIME[:15]
    run = recorded(moving(time, 2.0, 0.8), time, noise_mm=5e-3)
    _, middle, heading = midpoint_and_heading(run)
    pose, velocity, scatter = _moving_at(time, middle, heading, 0.25)
    exact = moving(np.array([0.25]), 2.0, 0.8)[0]
    np.testing.assert_allclose(pose, [*((exact[:2] + exact[2:]) / 2), 0.4 + 0.2], atol=0.01)
    np.testing.assert_allclose(velocity, [2.0, 0.0, 0.8], atol=0.06)
    assert scatter == pytest.approx(5e-3 / np.sqrt(2), rel=0.4)  # the middle of two marks


@pytest.mark.parametrize(("phase", "between"), [(3.5, (0.2, 2.2)), (0.7, (0.97, 2.95))])
def test_the_largest_displacement_elsewhere_in_a_rippled_run_is_met(phase: float, between: tuple[float, float]) -> None:
    """A run-out of 20 % at 75 rpm: in steps of half a gap, half of the largest was met."""
    rate, length = 2 * np.pi * 75 / 60, 0.7
    way = 4.0 * (TIME - 0.2 / rate * np.cos(rate * TIME + phase))
    course = TIME, np.column_stack([way, 0 * way]), 0 * way
    places = np.arange(between[0] + 0.25, between[1] - 0.25 - length, 1 / RATE)
    largest = max(_missing_over(course, (begin, begin + length), between, 2.0)[0] for begin in places)
    assert 0.85 * largest < _missing_elsewhere(course, (-1.0, -1.0 + length), between, 2.0)


def test_one_step_of_rounded_coordinates_is_no_jump() -> None:
    """Both marks of a robot that drives along y step at one frame, and otherwise in turn: their middle is smooth."""
    marks = moving(TIME, 1.5, 0.0, 0.5 * np.pi) + np.array([0.0, 0.01, 0.0, 0.035])
    marks = np.round(marks / 0.05) * 0.05
    marks[90:] += np.tile([0.05, -0.05], 2)
    assert jump(recorded(marks, noise_mm=0.0)) is None
    marks[90:] += np.tile([0.05, -0.05], 2)
    assert jump(recorded(marks, noise_mm=0.0)) is not None


@pytest.mark.parametrize("direction", [0.0, 1.2, np.pi / 2, 3.0, -2.2])
def test_a_speed_explains_a_step_along_it_within_its_times_whatever_its_direction(direction: float) -> None:
    ahead, left = (np.array([[np.cos(a), np.sin(a)]]) for a in (direction, direction + np.pi / 2))
    within, least = (np.array([-0.1]), np.array([0.3])), np.array([0.05])
    steps = {(1.4, 0.0): True, (1.6, 0.0): False, (-0.4, 0.0): True, (-0.6, 0.0): False}
    steps |= {(1.0, 0.04): True, (1.0, -0.04): True, (1.0, 0.06): False, (1.0, -0.06): False}
    for (along, across), explained in steps.items():  # at 5 mm/s
        assert bool(_covers(5.0 * ahead, within, along * ahead + across * left, least)[0]) == explained
    assert not _covers(0.0 * ahead, within, 0.0 * ahead, least)[0]  # a robot at rest explains nothing
