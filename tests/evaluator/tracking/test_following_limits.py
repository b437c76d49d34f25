"""Limits that decide what becomes of a frame: each seen from either side, on places without an image."""

from __future__ import annotations

import math

import numpy as np
import pytest

from evaluator.tracking.following.jumps import off_course
from evaluator.tracking.following.pair import ENOUGH, Body
from evaluator.tracking.following.repeated_frames import repeated_frames
from evaluator.tracking.uncertainty.exposure import exposed
from evaluator.tracking.uncertainty.rim import Rim

HERE = (100.0, 50.0)


def apart(distance: float) -> tuple[float, float]:
    """A place so far from HERE."""
    return HERE[0] + 0.6 * distance, HERE[1] - 0.8 * distance


def body(distance: float = 40.0, frames: int = ENOUGH) -> Body:
    found = Body()
    for _ in range(frames):
        found.note(HERE, apart(distance))
    return found


def test_distance_of_a_pair_is_believed_from_six_frames_on() -> None:
    assert ENOUGH == 6
    assert not body(frames=5).known
    assert body(frames=5).fits(HERE, apart(400.0))
    assert body().known
    assert not body().fits(HERE, apart(400.0))


@pytest.mark.parametrize(("distance", "fits"), [(33.2, True), (32.8, False), (46.8, True), (47.2, False)])
def test_marks_of_a_pair_keep_their_distance_to_a_seventh_and_a_pixel(distance: float, fits: bool) -> None:
    known = body(40.0)  # 15 % of it are 6 px
    assert known.fits(HERE, apart(distance)) == fits
    assert known.paired([HERE, (900.0, 900.0)], [apart(distance), (0.0, 500.0)]) == ([HERE] if fits else [])
    known.confirmed = False
    known.note(HERE, apart(distance))
    assert known.confirmed == fits
    # Of a pair that is known, a new distance counts a twentieth, or as much as one of the frames so far.
    assert known.distance_px == pytest.approx(40.0 + (distance - 40.0) / 7 if fits else 40.0)


def test_old_distances_are_forgotten_by_a_twentieth_a_frame() -> None:
    known = body(40.0, frames=100)
    known.note(HERE, apart(44.0))
    assert known.distance_px == pytest.approx(40.2)


def shown_again(frames: range, step_px: float = 3.0, still_px: float = 0.0, late_px: float = 0.0) -> np.ndarray:
    """Places of a mark that moves by a step a frame, and in these frames stands where it was before them."""
    along = step_px * np.arange(40.0)
    before = along[frames.start - 1]
    for number, frame in enumerate(frames, 1):
        along[frame] = before + number * still_px
    along[frames.stop :] += late_px
    return np.column_stack([along, np.full(40, 7.0)])


@pytest.mark.parametrize(
    ("points", "found"),
    [
        (shown_again(range(20, 21)), [20]),
        (shown_again(range(20, 25)), [20, 21, 22, 23, 24]),
        (shown_again(range(20, 26)), []),  # six in a row are no repeated frame
        (shown_again(range(20, 21), still_px=0.7), [20]),  # a quarter of the usual step of 3 px
        (shown_again(range(20, 21), still_px=0.8), []),
        (shown_again(range(20, 21), late_px=2.0), [20]),  # 8 px instead of 6: 35 % more are 8.1
        (shown_again(range(20, 21), late_px=2.2), []),
        (shown_again(range(20, 21), late_px=-2.2), []),
        (shown_again(range(20, 21), step_px=0.51), [20]),
        (shown_again(range(20, 21), step_px=0.49), []),  # that is no motion
    ],
)
def test_a_frame_is_shown_again_in_which_a_mark_stands_and_then_makes_up_for_it(
    points: np.ndarray, found: list[int]
) -> None:
    assert np.flatnonzero(repeated_frames([points])[0]).tolist() == found


def test_all_marks_that_move_must_stand_for_a_frame_to_be_shown_again() -> None:
    stands, moves, rests = shown_again(range(20, 21)), shown_again(range(30, 31)), np.tile([3.0, 4.0], (40, 1))
    assert not repeated_frames([stands, moves])[0].any()
    both, of_rest = repeated_frames([stands, rests])
    assert np.flatnonzero(both).tolist() == [20]
    assert not of_rest.any()


TIME = np.arange(60) / 30


def course(step_px: float = 2.0) -> np.ndarray:
    return np.column_stack([step_px * np.arange(60.0), 0.5 * step_px * np.arange(60.0)])


def test_a_mark_that_only_moves_is_on_its_course_also_beyond_a_gap() -> None:
    points = course(4.0)
    points[20:30] = np.nan
    assert not off_course(TIME, points, 8.0).any()
    assert not off_course(TIME[:3], np.array([[0.0, 0], [500.0, 0], [0.0, 0]]), 8.0).any()


@pytest.mark.parametrize("frames", [3, 14, 25])
def test_places_far_off_that_a_mark_comes_back_from_are_wrong_and_cost_the_others_nothing(frames: int) -> None:
    """There and back are two jumps, of 15 frames each: 25 frames elsewhere are not worth them."""
    points = course()
    points[20 : 20 + frames] += [0.0, 60.0]
    assert np.flatnonzero(off_course(TIME, points, 8.0)).tolist() == list(range(20, 20 + frames))


@pytest.mark.parametrize(("frames", "kept"), [(14, False), (16, True)])
def test_a_robot_carried_elsewhere_at_the_end_is_followed_there_from_fifteen_frames_on(frames: int, kept: bool) -> None:
    points = course()
    points[60 - frames :] += [0.0, 60.0]
    assert off_course(TIME, points, 8.0).any() != kept


@pytest.mark.parametrize(("radius_px", "off_px", "wrong"), [(8.0, 2.0, False), (8.0, 7.0, True), (30.0, 7.0, False)])
def test_a_jump_is_longer_than_the_usual_step_and_a_share_of_the_mark(
    radius_px: float, off_px: float, wrong: bool
) -> None:
    points = course(1.0)
    points[30] += [off_px, off_px]
    assert off_course(TIME, points, radius_px).tolist() == [wrong and number == 30 for number in range(60)]


def test_a_steady_change_of_speed_shows_where_a_mark_was_on_the_average() -> None:
    """At 50 px/s² an exposure of half of 1/30 s is off its middle by a·T²/24; the share is known to a tenth."""
    points = 0.5 * 50.0 * np.column_stack([TIME**2, -(TIME**2)])
    shift, variance = exposed(TIME, points, np.full((60, 2), 1e-6), (0.5, 0.1))
    size = 50.0 * (0.5 / 30) ** 2 / 24
    np.testing.assert_allclose(shift, size * np.tile([1.0, -1.0], (60, 1)), rtol=1e-6)
    np.testing.assert_allclose(variance, np.full((60, 2), (2 * size * 0.1 / 0.5) ** 2), rtol=1e-6)
    assert (exposed(TIME[:2], points[:2], np.ones((2, 2)), (0.5, 0.1))[0] == 0).all()


@pytest.mark.parametrize(("sigma_px", "counts"), [(0.07, True), (0.09, False)])
def test_a_jump_of_speed_counts_from_three_sigmas_of_the_centres_on(sigma_px: float, counts: bool) -> None:
    """From rest to 1 px a frame: three sigmas of its change of speed, √17.5 times a centre's, are 1 px at 0.08."""
    along = np.maximum(np.arange(60.0) - 30, 0.0)
    points = np.column_stack([along, np.zeros(60)])
    shift, variance = exposed(TIME, points, np.full((60, 2), sigma_px**2), (0.5, 0.0))
    assert np.abs(shift).max() < 1e-12
    expected = (1.0 * 0.5) ** 2 / 320 if counts else 0.0
    assert variance[30, 0] == pytest.approx(expected, rel=1e-6)
    assert max(variance[:29].max(), variance[:, 1].max()) < 1e-24


def noted(powers: list[float], own: float = 1.0) -> float:
    rim = Rim()
    for power in powers:
        rim.note((power, power), own)
    return rim.extra_px2


def test_a_rim_that_noise_explains_adds_nothing_and_one_that_is_always_disturbed_half_as_much_again() -> None:
    assert noted([1.0] * 30) == 0.0
    # Beyond three sigmas of a mean of 20 frames of six squares: 1 + 3·√(2/120) = 1.387 times the noise.
    assert noted([1.37] * 30) == 0.0
    assert noted([1.41] * 30) == pytest.approx(1.5 * 0.41, rel=1e-6)  # of six squares: 6/4
    assert noted([math.nan, 1.41] * 30) == noted([1.41] * 30)


@pytest.mark.parametrize(("power", "shown"), [(2.7, 0.0), (2.9, 1.5 * 1.9)])
def test_a_single_frame_is_disturbed_from_what_chance_makes_in_one_of_a_hundred(power: float, shown: float) -> None:
    assert noted([*[1.0] * 30, power]) == pytest.approx(shown, abs=1e-9)
