"""What a codec adds to the error of a mark, from how smoothly marks move: in closed form."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.tracking.uncertainty.codec import (
    _moving,
    _non_negative,
    _shared_out,
    _tail,
    codec_variance,
    hidden_variance,
)
from evaluator.tracking.uncertainty.course import Course, robust_square, steady_times
from evaluator.tracking.uncertainty.motion_changes import changes_of_motion

FRAME_S = 1 / 60


def line(n: int, speed_px: float = 1.0) -> np.ndarray:
    """Places of a mark on a line at a speed in px a frame, (n, 2)."""
    return np.outer(np.arange(n), [0.8 * speed_px, -0.6 * speed_px])


def test_rounding_of_a_clock_is_taken_off_and_lost_frames_stay_lost() -> None:
    true = FRAME_S * np.delete(np.arange(200), [50, 51, 120])
    np.testing.assert_allclose(steady_times(np.round(true, 3)), true, atol=1e-4)
    few = np.round(FRAME_S * np.arange(24), 3)  # 23 steps
    assert steady_times(few) is few


@pytest.mark.parametrize(("off", "steadied"), [(0.055, True), (0.065, False)])
def test_a_frame_that_lies_a_sixteenth_of_an_interval_off_is_no_rounding(off: float, steadied: bool) -> None:
    true = FRAME_S * np.arange(1000)
    told = true + off * FRAME_S * (np.arange(1000) == 500)
    assert (steady_times(told)[500] == pytest.approx(true[500], abs=1e-5)) == steadied


@pytest.mark.parametrize("stride", [1, 2])
@pytest.mark.parametrize("uneven", [0.0, 0.2])
def test_a_quartic_is_a_course_without_error_and_a_frame_off_it_has_its_own(stride: int, uneven: float) -> None:
    rng = np.random.default_rng(1)
    time = FRAME_S * (np.arange(60) + uneven * rng.uniform(-1, 1, 60))
    places = np.column_stack([np.polyval(rng.normal(size=5), 2 * time), np.polyval(rng.normal(size=5), 2 * time)])
    places[30] += [0.3, -0.4]
    course = Course(time, places, stride)
    assert course.error[30] == pytest.approx([0.3, -0.4], abs=1e-6)
    assert course.error[30 + stride] == pytest.approx(course.weights[4, 30 + stride] * -np.array([0.3, -0.4]), abs=1e-6)
    assert np.flatnonzero(course.known).tolist() == list(range(2 * stride, 60 - 2 * stride))


def test_seven_neighbours_two_of_them_on_either_side_tell_an_error() -> None:
    for absent, known in (([27, 28, 29], True), ([27, 28, 29, 33], False), ([26, 27, 28, 29], False)):
        places = line(60)
        places[absent] = np.nan
        assert Course(FRAME_S * np.arange(60), places).known[30] == known
    gap = FRAME_S * (np.arange(60) + 30 * (np.arange(60) > 32))  # beyond four reaches of five frames: another course
    assert not Course(gap, line(60)).known[31]
    short = FRAME_S * (np.arange(60) + 10 * (np.arange(60) > 32))
    assert Course(short, line(60)).known[31]


def test_variance_of_an_error_is_the_frames_own_and_its_neighbours_by_their_weights() -> None:
    rng = np.random.default_rng(2)
    sigma = np.where(np.arange(4000) % 2, 0.1, 0.3)
    course = Course(FRAME_S * np.arange(4000), line(4000) + sigma[:, None] * rng.normal(size=(4000, 2)))
    stated = course.variance(sigma**2)
    for odd in (0, 1):
        chosen = course.known & (np.arange(4000) % 2 == odd)
        assert np.mean(course.error[chosen] ** 2) == pytest.approx(stated[chosen].mean(), rel=0.06)


def test_what_a_codec_adds_is_found_for_each_kind_of_frame() -> None:
    rng = np.random.default_rng(3)
    kinds = np.where(np.arange(3000) % 3, "B", "P")
    added = np.where(kinds == "B", 0.03, 0.08)
    noise = np.hypot(added, 0.02)[:, None] * rng.normal(size=(3000, 2))
    extra = hidden_variance(FRAME_S * np.arange(3000), line(3000) + noise, np.full(3000, 0.02**2), kinds)
    assert np.median(extra[kinds == "B"]) == pytest.approx(0.03**2, rel=0.25)
    assert np.median(extra[kinds == "P"]) == pytest.approx(0.08**2, rel=0.15)


def test_a_recording_without_a_codec_is_widened_by_nothing_and_rest_by_a_third_of_motion() -> None:
    rng = np.random.default_rng(4)
    time, kinds = FRAME_S * np.arange(2000), np.full(2000, "P")
    own = 0.02 * rng.normal(size=(2000, 2))
    assert np.median(hidden_variance(time, line(2000) + own, np.full(2000, 4e-4), kinds)) < 0.1 * 4e-4
    stops = np.vstack([line(1000), np.tile(line(1000)[-1], (1000, 1))]) + own
    stops[:1000] += 0.06 * rng.normal(size=(1000, 2))  # no codec error changes at rest
    extra = hidden_variance(time, stops, np.full(2000, 4e-4), kinds)
    assert np.median(extra[:990]) == pytest.approx(0.06**2, rel=0.15)
    assert np.median(extra[1010:]) == pytest.approx(0.06**2 / 3, rel=0.15)


def test_an_error_that_neighbours_share_shows_at_neighbours_farther_away() -> None:
    """Each error holds for three frames of a slow mark: a stride of eight sees all of it, one of one but a part."""
    rng = np.random.default_rng(5)
    shared = 0.1 * np.repeat(rng.normal(size=(700, 2)), 3, axis=0)
    extra = hidden_variance(
        FRAME_S * np.arange(2100), line(2100, 0.12) + shared, np.full(2100, 1e-6), np.full(2100, "P")
    )
    assert np.median(extra) == pytest.approx(0.1**2, rel=0.15)


def arc(count: int, radius: float = 150.0, step: float = 2.0) -> np.ndarray:
    angle = step / radius * np.arange(count)
    return radius * np.stack([np.sin(angle), 1.0 - np.cos(angle)], axis=1)


def test_such_an_error_shows_on_a_wide_turn_too_though_the_mark_is_fast() -> None:
    rng = np.random.default_rng(8)
    shared = 0.1 * np.repeat(rng.normal(size=(700, 2)), 3, axis=0)
    extra = hidden_variance(FRAME_S * np.arange(2100), arc(2100) + shared, np.full(2100, 1e-6), np.full(2100, "P"))
    assert np.median(extra) == pytest.approx(0.1**2, rel=0.15)  # 0.06² by neighbouring frames alone


def test_what_two_marks_of_a_body_do_together_is_no_error_that_neighbours_share() -> None:
    """It sets off within some frames and bends its path: the course of 40 frames leaves 0.3 px of that, 8 px apart."""
    rng = np.random.default_rng(11)
    frame = np.arange(120.0)
    path = np.maximum(frame - 20.0, 0.0) - 4.0 * (1.0 - np.exp(-np.maximum(frame - 20.0, 0.0) / 4.0))
    body = np.stack([path, np.maximum(path - 50.0, 0.0) ** 2 / 150.0], axis=1)
    heading = np.arctan2(np.maximum(path - 50.0, 0.0) / 75.0, 1.0)
    other = body + 40.0 * np.stack([-np.sin(heading), np.cos(heading)], axis=1)

    def stated(held_for: int) -> tuple[float, float]:
        """Sigma of a mark alone, and of one with its partner, whose errors of 0.05 px hold for some frames."""
        one, partner = (
            mark + 0.05 * np.repeat(rng.normal(size=(120 // held_for, 2)), held_for, axis=0) for mark in (body, other)
        )
        given = FRAME_S * frame, one, np.full(120, 1e-6), np.full(120, "P")
        alone, beside = hidden_variance(*given), hidden_variance(*given, apart_px=np.hypot(*(one - partner).T))
        return float(np.median(alone)) ** 0.5, float(np.median(beside)) ** 0.5

    alone, beside = np.median([stated(1) for _ in range(9)], axis=0)
    assert alone > 0.1
    assert beside == pytest.approx(0.05, rel=0.25)
    assert np.median([stated(4)[1] for _ in range(9)]) > 0.05  # errors that are shared still show


def test_an_abrupt_start_is_no_error_of_the_centres() -> None:
    """Half a second of rest and two of driving at 2 px a frame: a fifth of the courses run across the start."""
    rng = np.random.default_rng(9)
    found = []
    for _ in range(20):
        path = np.vstack([np.zeros((15, 2)), arc(60)]) + 0.04 * rng.normal(size=(75, 2))
        extra = hidden_variance(FRAME_S * np.arange(75), path, np.full(75, 1e-6), np.full(75, "P"))
        found.append(np.median(extra[30:]))
    assert np.sqrt(np.median(found)) == pytest.approx(0.04, rel=0.15)  # else 0.06


def test_a_large_error_of_one_frame_is_no_change_of_motion() -> None:
    rng = np.random.default_rng(10)
    path = arc(200) + 0.03 * rng.normal(size=(200, 2))
    time = FRAME_S * np.arange(200)
    path[100] += (0.6, -0.3)
    assert not changes_of_motion([Course(time, path)]).any()
    path[100:] += 1.5 * np.arange(100)[:, None]  # now it is faster from there on
    changed = np.flatnonzero(changes_of_motion([Course(time, path)]))
    assert changed.min() >= 93
    assert changed.max() <= 107
    assert len(changed) == 11
    # The other mark of its body goes on as it was: then it is an error of the one that seems faster.
    other = Course(time, arc(200) + 0.03 * rng.normal(size=(200, 2)))
    assert not changes_of_motion([Course(time, path), other]).any()
    assert changes_of_motion([Course(time, path), Course(time, path + 30.0)]).sum() == 11


@pytest.mark.parametrize(("frames", "told"), [(7, False), (8, True)])
def test_eight_frames_tell_that_there_is_an_error(frames: int, told: bool) -> None:
    rng = np.random.default_rng(6)
    course = Course(FRAME_S * np.arange(60), line(60) + 0.1 * rng.normal(size=(60, 2)))
    chosen = (np.arange(60) >= 20) & (np.arange(60) < 20 + frames)
    extra = codec_variance(course, chosen, np.zeros(60), np.full(60, "P"))
    assert (extra > 0).all() if told else (extra == 0).all()


def test_kinds_of_fewer_than_24_frames_have_the_mean_of_the_others() -> None:
    rng = np.random.default_rng(7)
    course = Course(FRAME_S * np.arange(400), line(400) + 0.1 * rng.normal(size=(400, 2)))
    for rare, told in ((23, False), (24, True)):
        kinds = np.where((np.arange(400) >= 100) & (np.arange(400) < 100 + rare), "I", "P")
        extra = codec_variance(course, course.known, np.zeros(400), kinds)
        assert (extra[100] != extra[0]) == told


def test_a_frame_far_off_its_course_has_the_variance_of_students_t_given_its_error() -> None:
    """Degrees of freedom 4, two axes: (4 + d²)/(4 + 2) times the variance from 3 sigmas on; nearer nothing."""
    course: Any = SimpleNamespace(error=np.array([[0.29, 0.0], [0.31, 0.0], [3.0, 4.0], [np.nan, np.nan]]))
    course.variance = lambda variances: variances
    added = _tail(course, np.full(4, 0.01))
    assert added == pytest.approx([0.0, 0.01 * ((4 + 9.61) / 6 - 1), 0.01 * ((4 + 2500) / 6 - 1), 0.0])


@pytest.mark.parametrize(("speed", "moves"), [(0.09, False), (0.11, True)])
def test_a_mark_moves_from_a_tenth_of_a_pixel_a_frame_on(speed: float, moves: bool) -> None:
    for frames in (7, 30):
        assert (_moving(line(frames, speed)) == moves).all()
    assert _moving(line(6, speed)).all()


def test_mean_square_is_per_axis_and_brings_back_what_lies_beyond_four_sigmas() -> None:
    errors = np.tile([[1.0, -1.0]], (100, 1))
    assert robust_square(errors) == pytest.approx(1.0)
    errors[0] = 500.0
    assert robust_square(errors) == pytest.approx((99 + (4 * 1.4826) ** 2) / 100)


def test_least_squares_above_zero_leaves_out_what_would_be_negative() -> None:
    matrix = np.array([[1.0, 0.5], [0.5, 1.0]])
    assert _non_negative(matrix, matrix @ [2.0, 3.0]) == pytest.approx([2.0, 3.0])
    free = _non_negative(matrix, matrix @ [2.0, -1.0])
    assert free == pytest.approx([(matrix[:, 0] @ matrix @ [2.0, -1.0]) / 1.25, 0.0])


@pytest.mark.parametrize(
    ("excess", "solution"),
    [
        ((0.9, 0.5), (0.9, 0.5)),
        ((0.9, -0.1), (0.9, 0.2167)),  # a third of (3 · 0.9 - 0.1) / 4
        ((0.1, -0.9), (0.1, 0.0)),  # they have nothing in common
    ],
)
def test_a_kind_of_frames_has_at_least_a_third_of_what_all_have_in_common(
    excess: tuple[float, float], solution: tuple[float, float]
) -> None:
    """Of thirty frames of one kind and ten of another, each with its own error only; weights of any size."""
    mine = np.arange(40) >= np.array([[0], [30]])
    mine[0] &= ~mine[1]
    found = _shared_out(7.0 * mine, mine.astype(float), np.where(mine[1], excess[1], excess[0]))
    assert found == pytest.approx(solution, abs=1e-4)
