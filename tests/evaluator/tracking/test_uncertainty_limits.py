"""Limits of what tells an error of a centre from motion, each from either side, in closed form."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.tracking.refinement import kernels
from evaluator.tracking.refinement.disc import PER_PX, make_disc
from evaluator.tracking.refinement.motion_blur import mean_over, path_of
from evaluator.tracking.uncertainty import motion_changes, shared_errors
from evaluator.tracking.uncertainty.codec import _shared_out, hidden_variance
from evaluator.tracking.uncertainty.course import Course
from evaluator.tracking.uncertainty.exposure import exposed
from evaluator.tracking.uncertainty.outline import _scatter
from evaluator.tracking.uncertainty.rigid_pair import _off_course
from evaluator.tracking.uncertainty.rim import Rim, rim_power
from tests.evaluator.tracking.test_combine_formulas import COUNT, FRAME_S, TIME_S, circle, numbers_of


def changed(marks: list[dict[int, float]], monkeypatch: pytest.MonkeyPatch, **singles: float) -> list[int]:
    """Frames that are told to run across a change of motion, of courses of 200 frames.

    marks: of each mark, in variances, how much of the errors around some frames a bend explains, median elsewhere.
    singles: how much one frame alone explains.
    """
    bent, _ = motion_changes._patterns()
    courses: list[Any] = []
    for mark in marks:
        change, single = np.full(COUNT, np.log(4.0)), np.zeros(COUNT)  # the median of a variance of one
        for frame, variances in mark.items():
            change[frame] = variances
        for name, variances in singles.items():
            single[int(name.removeprefix("at"))] = variances
        courses.append(SimpleNamespace(known=np.ones(COUNT, bool), error=(0.3 * change, 0.3 * single)))
    monkeypatch.setattr(motion_changes, "_likeness", lambda error, pattern: error[int(pattern is not bent)])
    return np.flatnonzero(motion_changes.changes_of_motion(courses)).tolist()


def test_a_change_of_motion_is_told_from_five_sigmas_on_that_all_marks_of_a_body_have_seen(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    around = list(range(45, 56))
    assert changed([{50: 25.5}], monkeypatch) == around
    assert changed([{50: 24.5}], monkeypatch) == []
    assert changed([{50: 30.0}, {50: 20.5}], monkeypatch) == around  # of two, 25 each on average
    assert changed([{50: 30.0}, {50: 19.5}], monkeypatch) == []
    assert changed([{50: 90.0}, {50: 4.1}], monkeypatch) == around  # and two sigmas of each
    assert changed([{50: 90.0}, {50: 3.9}], monkeypatch) == []
    assert changed([{50: 30.0, 54: 40.0}], monkeypatch) == list(range(49, 60))  # the largest around
    assert changed([{50: 30.0}], monkeypatch, at54=31.0) == []  # one frame's error explains more
    assert changed([{50: 30.0}], monkeypatch, at54=29.0) == around
    often = dict.fromkeys((30, 70, 110, 150), 30.0)
    assert changed([often], monkeypatch) == []  # what recurs is the codec's
    assert len(changed([dict(list(often.items())[:3])], monkeypatch)) == 33


def test_patterns_are_the_deviations_of_a_path_with_a_bend_and_of_one_with_a_single_error() -> None:
    frames, middle = np.arange(COUNT), COUNT // 2
    around = np.arange(-motion_changes.REACH, motion_changes.REACH + 1) + middle
    for pattern, off in zip(
        motion_changes._patterns(), (np.maximum(frames - middle, 0.0), 1.0 * (frames == middle)), strict=True
    ):
        path = np.column_stack([0.3 * frames, 0.1 * frames]) + off[:, None]
        np.testing.assert_allclose(Course(TIME_S, path).error[around, 0], pattern, atol=1e-9)


def test_no_kind_of_frame_has_less_than_a_third_of_what_all_have_in_common() -> None:
    kinds = np.repeat(np.eye(2), 50, axis=1)  # 50 frames of each, whose neighbours count for nothing
    assert _shared_out(kinds, kinds, np.repeat([0.0, 2.0], 50)) == pytest.approx([1 / 3, 2.0])
    assert _shared_out(kinds, kinds, np.repeat([-3.0, 2.0], 50)) == pytest.approx([0.0, 2.0])


def test_frames_whose_variance_is_three_times_the_usual_tell_nothing_of_the_codec() -> None:
    rng = np.random.default_rng(6)
    for times, told in ((2.5, True), (3.5, False)):
        places, variances = circle() + 0.01 * rng.normal(size=(COUNT, 2)), np.full(COUNT, 1e-4)
        odd = np.arange(COUNT) % 8 == 0
        variances[odd] *= times
        places[odd] += 0.3 * rng.normal(size=(odd.sum(), 2))
        extra = hidden_variance(TIME_S, places, variances, np.full(COUNT, "P"))
        assert (np.nanmedian(extra[~odd]) > 1e-4) == told


def test_a_frame_beside_a_gap_is_exposed_for_no_longer_than_one_in_the_midst() -> None:
    times = np.delete(TIME_S, [100, 101])
    places = np.stack([500.0 * times**2, 0.0 * times], axis=1)
    shift = exposed(times, places, np.full((len(times), 2), 1e-8), (0.5, 0.0))[0][:, 0]
    usual = 1000.0 * (0.5 * FRAME_S) ** 2 / 24
    assert shift[50] == pytest.approx(usual, rel=1e-6)
    assert (shift[98:102] < 2.5 * usual).all()


def test_how_far_a_mark_is_off_its_course_counts_its_own_variance_and_those_of_its_neighbours() -> None:
    """The cubic through five frames on either side."""
    mark = numbers_of(np.stack([0.01 * np.arange(40.0) ** 3, np.arange(40.0)], axis=1))
    mark[20, 0] += 1.0
    usable = np.arange(40) != 20
    since = np.delete(np.arange(-5.0, 6.0), 5)
    weights = np.linalg.pinv(np.vander(since, 4, increasing=True))[0]
    sigma = 0.01 * np.sqrt(1 + np.sum(weights**2))
    assert _off_course(FRAME_S * np.arange(40), mark, usable, 20) == pytest.approx(1 / sigma, rel=1e-6)
    mark[22] = np.nan, np.nan, 1e-4, 1e-4, 0.0
    usable[18] = False
    mark[18, 0] += 50.0  # is not to be used
    assert _off_course(FRAME_S * np.arange(40), mark, usable, 20) == pytest.approx(1 / sigma, rel=0.2)
    usable[:15] = usable[27:] = False
    assert np.isnan(_off_course(FRAME_S * np.arange(40), mark, usable, 20))  # fewer than ten


@pytest.mark.parametrize(("odd", "shown"), [(1.1, 4.0), (0.9, 0.9)])
def test_a_rim_whose_even_harmonics_are_three_times_the_odd_ones_is_that_of_a_shape_that_is_not_round(
    odd: float, shown: float
) -> None:
    """All harmonics have 4 px² on the mean, noise 0.1: of a square or oblong mark only odd ones count."""
    rim = Rim()
    for _ in range(40):
        rim.note((4.0, odd), 0.1)
    assert rim.extra_px2 == pytest.approx(1.5 * (shown - 0.1))


@pytest.mark.parametrize(
    ("squares", "straight", "shared"),
    [
        ((1.2, 1.2, 1.2), 99.0, 0.0),  # less than its own standard error, a fifth, beyond what is known
        ((1.3, 1.2, 1.2), 99.0, 0.3),
        ((1.3, 1.5, 1.4), 99.0, 0.5),  # the largest
        ((1.3, 1.5, 2.0), 40.0, 1.0),
        ((1.3, 1.5, 2.0), 39.0, 0.5),  # the widest course leaves the path
        ((1.3, 1.5, 2.0), 9.0, 0.0),
    ],
)
def test_what_neighbours_share_is_what_wider_courses_show_beyond_what_is_known(
    squares: tuple[float, ...], straight: float, shared: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = iter(squares)
    monkeypatch.setattr(shared_errors, "straight_frames", lambda _: straight)
    monkeypatch.setattr(shared_errors, "_square", lambda *_: (next(given), 0.2))
    near: Any = Course(TIME_S, circle())
    found = shared_errors.shared_variance(TIME_S, circle(), near, near.known, 1.0)
    assert found == pytest.approx(shared)


def test_what_two_marks_do_together_bounds_what_either_shares_by_the_largest_and_its_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for values, bound in (((1.0, 1.5, 2.0, 0.0), 1.4), ((3.0, 1.5, 2.0, 1.0), 0.0), ((1.0, 0.0, 0.0, 0.0), np.inf)):
        given = iter(values)
        monkeypatch.setattr(shared_errors, "_square", lambda *_, given=given: (next(given), 0.2))
        assert shared_errors.of_distance(TIME_S, np.full(COUNT, 40.0)) == pytest.approx(bound)


def bumpy(harmonic: int, smear: tuple[float, float], tilt: tuple[float, float]) -> tuple[float, float]:
    """Power of the rim of a disc of 8 px that is off by 0.2 px times the cosine of some turns of the direction."""
    disc = make_disc(8.0, 1.2, (0.0, 0.0), (120.0, 60.0), 4.0)
    numbers, (x, y) = disc.numbers(smear), (24.3, 23.6)
    path = path_of(numbers)

    def share(dx: float, dy: float) -> float:
        if path is not None:
            return float(getattr(mean_over, "py_func", mean_over)(path, disc.table, numbers[7], dx, dy, dx, dy)[0])
        return float(np.interp(np.hypot(dx, dy), np.arange(len(disc.profile)) / PER_PX, disc.profile, right=0.0))

    luma = np.zeros((48, 48))
    for (j, i), _ in np.ndenumerate(luma):
        dx, dy = i - x, j - y
        r, angle = np.hypot(dx, dy), np.arctan2(dy, dx)
        off = 1.0 - 0.2 * np.cos(harmonic * angle) / max(r, 1.0)
        luma[j, i] = 60.0 + 120.0 * share(off * dx, off * dy) + tilt[0] * dx + tilt[1] * dy
    result = np.zeros(kernels.RESULTS)
    result[[kernels.X, kernels.Y, kernels.AMPLITUDE, kernels.BASE]] = x, y, 120.0, 60.0
    result[[kernels.SLOPE_X, kernels.SLOPE_Y]] = tilt
    return rim_power(np.rint(luma).astype(np.uint8), 0, 1, result, numbers, disc.table, np.array([4.0, 20.0]))


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (1.5, -1.0)])
def test_a_rim_shows_its_harmonics_by_half_the_square_of_each(tilt: tuple[float, float]) -> None:
    """Of three odd and even ones; light that slopes is none of the rim."""
    third, fourth = bumpy(3, (0.0, 0.0), tilt), bumpy(4, (0.0, 0.0), tilt)
    assert third == pytest.approx((0.02 / 3, 0.02 / 2), rel=0.1)
    assert fourth == pytest.approx((0.02 / 3, 0.0), abs=5e-4)
    assert max(bumpy(1, (0.0, 0.0), tilt)) < 5e-4


def test_of_a_smeared_rim_only_odd_harmonics_count() -> None:
    """Its sides are as steep as ever and its ends are not: a bump all around is seen for the most part."""
    every, odd = bumpy(3, (5.0, -4.0), (0.0, 0.0))
    assert every == odd
    assert odd == pytest.approx(0.02 / 2, rel=0.35)
    assert bumpy(4, (5.0, -4.0), (0.0, 0.0))[0] < 1e-3


def test_the_scatter_of_a_length_counts_what_its_usual_course_takes_of_it() -> None:
    """Thirty lengths, and seven terms of place and direction that are fitted to them."""
    rng = np.random.default_rng(8)
    usual = np.column_stack([np.ones(30), rng.normal(size=(30, 6))])
    squares = [_scatter(20.0 + rng.normal(size=30), usual)[0] ** 2 for _ in range(99)]
    assert np.mean(squares) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("stride", [1, 4])
def test_a_course_is_the_quartic_through_the_five_nearest_on_either_side(stride: int) -> None:
    """The weights of Savitzky and Golay without the frame itself."""
    course = Course(TIME_S, circle(), stride)
    near = np.array([-5, -4, -3, -2, -1, 1, 2, 3, 4, 5])
    assert course.around[:, 100].tolist() == (100 + stride * near).tolist()
    np.testing.assert_allclose(
        course.weights[:, 100], np.linalg.pinv(np.vander(near, 5, increasing=True))[0], atol=1e-9
    )
    assert np.flatnonzero(~course.known).tolist() == [*range(2 * stride), *range(COUNT - 2 * stride, COUNT)]
