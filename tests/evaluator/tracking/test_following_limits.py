"""Limits that decide what becomes of a frame: each seen from either side, on places without an image."""

from __future__ import annotations

import numpy as np
import pytest

from evaluator.tracking.following.jumps import off_course
from evaluator.tracking.following.pair import ENOUGH, Body
from evaluator.tracking.following.repeated_frames import repeated_frames

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


def test_a_distance_that_changes_from_frame_to_frame_is_that_of_a_body_seen_at_a_slant() -> None:
    seen = body(40.0)
    for distance in range(40, 20, -1):
        seen.note(HERE, apart(float(distance)))
    assert seen.fits(HERE, apart(20.0))
    assert seen.fits(HERE, apart(40.0))
    assert not seen.fits(HERE, apart(10.0))  # no body turns so far in a frame
    assert not seen.fits(HERE, apart(60.0))


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


def test_no_mark_is_shown_again_where_there_is_none() -> None:
    assert repeated_frames([]) == []
