"""The heading of a robot across gaps, and frames in which it is reversed, on motions worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from evaluator.pose import poses_from_marks, unwrapped_across_gaps

from .turning.synthetic import GEOMETRY, arc_poses, marks_of

MARKS = ["green_x_mm", "green_y_mm", "yellow_x_mm", "yellow_y_mm"]


@pytest.mark.parametrize(("first", "count"), [(0, 7), (50, 1), (50, 15), (93, 7)])
def test_frames_that_point_backward_for_a_moment_are_refused_while_the_robot_spins(first: int, count: int) -> None:
    marks = marks_of(arc_poses(2.0, 3600, 100), 0.0, np.random.default_rng(0))  # 36 degrees a frame
    wrong = slice(first, first + count - 1)
    marks.loc[wrong, MARKS] = marks.loc[wrong, [*MARKS[2:], *MARKS[:2]]].to_numpy()
    poses = poses_from_marks(marks, GEOMETRY)
    assert np.flatnonzero(~poses.measured).tolist() == list(range(first, first + count))
    assert poses.status[first] == "heading reversed for a moment: marks exchanged?"
    steps = np.diff(poses.heading_rad) / np.radians(3600 / 99)
    np.testing.assert_allclose(steps[np.isfinite(steps)], 1.0)


@pytest.mark.parametrize(("frames", "refused"), [(30, 0), (31, 1)])
def test_a_moment_needs_thirty_one_frames_to_be_told_from_the_rest(frames: int, refused: int) -> None:
    marks = marks_of(arc_poses(5.0, 40, frames), 0.0, np.random.default_rng(0))
    marks.loc[15, MARKS] = marks.loc[15, [*MARKS[2:], *MARKS[:2]]].to_numpy()
    assert (~poses_from_marks(marks, GEOMETRY).measured).sum() == refused


def test_heading_is_unwrapped_in_both_senses_and_keeps_its_first_value() -> None:
    for sense in (1, -1):
        heading = 2.0 + sense * 0.9 * np.arange(30.0)
        found = unwrapped_across_gaps(np.arange(30) / 50, np.angle(np.exp(1j * heading)))
        np.testing.assert_allclose(found, heading, atol=1e-9)


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize("first", [2, 40, 90])
def test_turns_in_a_gap_are_counted_by_the_yaw_rate_beside_it(sense: int, first: int) -> None:
    """The rate changes along the run, so that only the frames beside the gap tell how far it turned meanwhile."""
    time = np.arange(130) / 50
    heading = sense * np.cumsum(np.linspace(0.2, 0.6, 130))
    broken = np.angle(np.exp(1j * heading))
    broken[first : first + 30] = np.nan
    found = unwrapped_across_gaps(time, broken)
    after = found[first + 30 :] - heading[first + 30 :]
    np.testing.assert_allclose(after, after[0], atol=1e-9)
    np.testing.assert_allclose(found[0] - heading[0], after[0], atol=1e-9)
    assert np.isnan(found[first : first + 30]).all()


def test_the_yaw_rate_beside_a_gap_is_the_usual_one_of_five_frames_to_either_side() -> None:
    """A frame in which the heading errs by two radians says nothing of how often the robot turned in the gap."""
    time, heading = np.arange(130) / 50, 0.4 * np.arange(130)
    for odd in (35, 39, 70, 74):
        broken = np.angle(np.exp(1j * (heading + 2.0 * (np.arange(130) == odd))))
        broken[40:70] = np.nan
        found = unwrapped_across_gaps(time, broken)
        assert found[-1] - found[0] == pytest.approx(heading[-1])


@pytest.mark.parametrize("sense", [1, -1])
def test_as_many_frames_count_before_a_gap_as_after_it(sense: int) -> None:
    """The robot turns five times as fast after the gap as before it: in the gap, as the mean of both."""
    rate = np.concatenate([np.full(40, 0.1), np.full(41, 0.3), np.full(40, 0.5)])[::sense]
    heading = np.concatenate([[0.0], np.cumsum(rate)])
    broken = np.angle(np.exp(1j * heading))
    broken[41:81] = np.nan
    found = unwrapped_across_gaps(np.arange(len(heading)) / 50, broken)
    assert found[-1] - found[0] == pytest.approx(heading[-1])


def test_a_step_of_one_and_a_half_intervals_is_a_gap_and_a_shorter_one_is_not() -> None:
    """4 rad per interval look like -2.28: in a gap the frames beside it tell, between frames the shortest way does."""
    interval = np.full(20, 1.0)
    for length, turned in ((1.4, 2.8), (1.6, 3.2)):
        interval[10] = length
        heading = np.concatenate([[0.0], np.cumsum(2.0 * interval)])
        found = unwrapped_across_gaps(np.concatenate([[0.0], np.cumsum(interval)]), np.angle(np.exp(1j * heading)))
        assert found[11] - found[10] == pytest.approx(turned)
    interval[10], heading = 1.4, np.concatenate([[0.0], np.cumsum(2.5 * np.where(np.arange(20) == 10, 1.4, 1.0))])
    found = unwrapped_across_gaps(np.concatenate([[0.0], np.cumsum(interval)]), np.angle(np.exp(1j * heading)))
    assert found[11] - found[10] == pytest.approx(3.5 - 2 * np.pi)


@pytest.mark.parametrize("known", [2, 3])
def test_two_headings_are_enough_to_be_unwrapped(known: int) -> None:
    heading = np.array([3.0, -3.0, -2.8, np.nan, np.nan])
    heading[known:] = np.nan
    found = unwrapped_across_gaps(np.arange(5.0), heading)
    np.testing.assert_allclose(found - heading, [0.0, 2 * np.pi, 2 * np.pi if known == 3 else np.nan, np.nan, np.nan])


@pytest.mark.parametrize("known", [0, 1, 2])
def test_heading_of_few_frames_is_left_as_it_is(known: int) -> None:
    heading = np.full(4, np.nan)
    heading[:known] = 0.3
    np.testing.assert_array_equal(unwrapped_across_gaps(np.arange(4.0), heading), heading)
