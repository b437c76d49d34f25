"""What ground and jumps do to a fit, in closed form: slopes that jump, left-overs of a run, and noise of their size."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.likelihood.jumps import bends, central_slope, jumps, with_slopes
from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized
from evaluator.diagnosis.likelihood.noise.discrepancy import left_over, with_discrepancy
from evaluator.diagnosis.likelihood.noise.tracking import Noise
from evaluator.diagnosis.likelihood.point import Column, Point
from evaluator.diagnosis.likelihood.run_data import RunData
from simulator.effects.coordinates import Candidate, Coordinate


def test_a_slope_jumps_where_its_step_moves_the_features_by_more_than_a_sigma() -> None:
    slopes = np.array([[3.0, 3.0, -3.0], [4.0, 4.0, 4.0]])
    assert jumps(slopes, np.array([0.19, 0.21, -0.21])) == [1, 2]
    assert jumps(slopes, np.zeros(3)) == []


def test_motion_bends_where_slopes_miss_a_fifth_of_a_sigma_and_a_twentieth_of_a_step_that_no_start_pose_makes() -> None:
    start = np.eye(5)[:, :3]
    view = Linearized(np.zeros(5), np.array([[9.0, 9.0, 9.0, 2.0, 0.0], [0.0] * 5]).T, start, np.zeros((5, 4)))
    steps, along, aside = np.array([0.5, 7.0]), np.eye(5)[3], np.eye(5)[4]
    expected = view.common[:, 0] * 0.5  # 1 along the fourth feature; the rest is a start pose
    assert [bends(view, [0], steps, expected + size * aside) for size in (0.19, 0.21)] == [False, True]
    assert [bends(view, [0], steps, expected - size * along) for size in (0.19, 0.21)] == [False, True]
    assert not bends(view, [0], steps, expected + 5 * start[:, 0])
    steep = Linearized(view.response, 10 * view.common, start, view.scatter)  # 10 by a step
    assert [bends(steep, [0], steps, 10 * expected + size * aside) for size in (0.49, 0.51)] == [False, True]


def test_a_central_slope_is_exact_for_a_parabola() -> None:
    def features(value: float) -> np.ndarray:
        return np.array([3.0, -1.0]) * value + np.array([4.0, 0.7]) * value**2

    forward = (features(0.2) - features(0.7)) / 0.5  # minus the derivative, as the slopes of a residual
    found = central_slope(forward, features(0.2), features(-0.3), 0.5)
    np.testing.assert_allclose(found, -np.array([3.0 + 1.6, -1.0 + 0.28]))


def test_views_with_other_slopes_predict_the_same_features_where_they_are_seen() -> None:
    rng = np.random.default_rng(0)
    theta = np.array([0.7, -1.3])
    view = Linearized(rng.normal(size=5), rng.normal(size=(5, 2)), rng.normal(size=(5, 3)), rng.normal(size=(5, 4)))
    slope = rng.normal(size=5)
    untouched, changed, missing = with_slopes([view, view, None], {(1, 0): slope}, theta)
    assert untouched is view
    assert missing is None
    assert changed is not None
    np.testing.assert_array_equal(changed.common[:, 0], slope)
    np.testing.assert_array_equal(changed.common[:, 1], view.common[:, 1])
    np.testing.assert_allclose(changed.response - changed.common @ theta, view.response - view.common @ theta)


HALF_MM = 150.0


def laid(channels: np.ndarray, turn: float, x: float, y: float) -> np.ndarray:
    """Channels of the same run laid elsewhere."""
    place = (channels[:, 0] + 1j * channels[:, 1]) * np.exp(1j * turn)
    return np.column_stack([place.real + x, place.imag + y, channels[:, 2] + turn, channels[:, 3]])


def course(frames: int = 400) -> np.ndarray:
    """An arc of a metre, marks across the way."""
    angle = np.linspace(0, 2.0, frames)
    return np.column_stack([500 * np.sin(angle), -500 * np.cos(angle), angle + np.pi / 2, np.full(frames, 2 * HALF_MM)])


@pytest.mark.parametrize("turn", [0.0, 2.9, -1.2])
def test_left_overs_are_the_rms_of_a_coordinate_and_of_the_direction_times_half_the_distance(turn: float) -> None:
    """Ripples of 6 mm in x and 8 mm in y and of 0.02 rad, too fast to be taken up by a turn or a shift."""
    predicted, ripple = course(), np.resize([1.0, -1.0], 400)
    measured = predicted + np.column_stack([6 * ripple, 8 * np.roll(ripple, 1), 0.02 * ripple, 0 * ripple])
    found = left_over(measured, laid(predicted, turn, 7e3, -2e3), HALF_MM)
    assert found == pytest.approx([np.sqrt((36 + 64) / 2), 0.02 * HALF_MM], rel=1e-3)
    measured[100:200] = np.nan
    assert left_over(measured, laid(predicted, turn, 7e3, -2e3), HALF_MM) == pytest.approx(found, rel=0.01)


def test_a_run_is_turned_as_places_and_directions_say_together() -> None:
    """Directions that are all off by 0.3 rad against places: by their squares of 150 mm beside those of the places."""
    predicted = course()
    measured = predicted + np.array([0.0, 0.0, 0.3, 0.0])
    place = predicted[:, :2] - predicted[:, :2].mean(axis=0)
    spread = float(np.mean(np.sum(place**2, axis=1)))
    turn = np.angle(spread + HALF_MM**2 * np.exp(0.3j))
    expected = [np.sqrt(spread / 2) * 2 * np.sin(turn / 2), HALF_MM * (0.3 - turn)]
    assert left_over(measured, predicted, HALF_MM) == pytest.approx(expected, rel=1e-6)


def test_noise_has_the_size_of_the_usual_left_overs_and_more_in_a_run_that_leaves_more_than_twice_of_them() -> None:
    """Median squares of few modes are 0.79 of their mean. A run of ten times the usual has √5 times it."""
    noise = [(Noise(3.0, 4.0, 0.1), Noise(3.0, 4.0, 0.1), Noise(2.0, 0.0, 0.1), Noise(1.0, 0.0, 0.1))] * 5
    left = np.tile([30.0, 60.0], (5, 1))
    usual = np.array([30.0, 60.0]) / np.sqrt(0.79)
    left[4] = 10 * usual
    left[3] = 1.9 * usual
    found = with_discrepancy(noise, [np.array([0.5, 1.0, 4.5])] * 5, left)
    for run, times in ((0, 1.0), (3, 1.0), (4, np.sqrt(5.0))):
        place, direction = times * usual
        sizes = [part.drift.size_mm for part in found[run]]
        assert sizes == pytest.approx(
            [np.sqrt(place**2 - 25), np.sqrt(place**2 - 25), np.sqrt(direction**2 - 4), 0.0], rel=1e-9
        )
        assert [part.drift.lasting_s for part in found[run][:3]] == [4.0] * 3
        assert found[run][3] == noise[run][3]
    quiet = with_discrepancy(noise[:1], [np.array([0.0, 1.0])], np.full((1, 2), 1.0))
    assert [part.drift.size_mm for part in quiet[0]] == [0.0] * 4  # tracking explains it all


def test_first_frames_of_a_run_keep_their_errors() -> None:
    run = RunData("r", 1.0, 2.0, 0.0, 9.0, np.arange(5.0), np.ones((5, 4)), 0, {"camera, error 1": np.ones((5, 4))})
    first = run.first(3)
    assert first.time_s.tolist() == [0.0, 1.0, 2.0]
    assert (first.marks_mm.shape, first.systematic["camera, error 1"].shape) == ((3, 4), (3, 4))
    assert (first.id, first.stop_s, first.command) == ("r", 9.0, (1.0, 2.0))


@pytest.mark.parametrize(("value", "within"), [(-0.1, False), (0.0, True), (1.0, True), (1.1, False)])
def test_a_term_is_within_bounds_where_clipping_changes_nothing(value: float, within: bool) -> None:
    term: Any = Candidate("t", (Coordinate("a", 0.0, 0.1, 0.0, 1.0),), lambda _: {})
    point = Point(np.zeros((1, 7)), terms={"t": (value,)})
    assert point.is_within_bounds(Column("t", term=term)) == within
    assert point.is_within_bounds(Column("body.mass_g"))


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("jump", "over"), [(9.0, False), (90.0, True)])
def test_a_slope_on_a_plate_is_taken_from_the_side_without_a_jump(side: float, jump: float, over: bool) -> None:
    """Features grow by 2 a unit, and by a jump where the parameter exceeds 0.1 on one side."""
    step = 0.5

    def features(at: float) -> np.ndarray:
        return np.array([2.0 * at + side * jump * (side * at > 0.1)])

    ahead = (features(0.0) - features(step)) / step
    slope = central_slope(ahead, features(0.0), features(-step), step)
    assert slope.tolist() == pytest.approx([-2.0 if over else -2.0 - jump])
