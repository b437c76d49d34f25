"""What a recording tells of its own errors, each part in closed form: exposure, outline, distance, tag and rim."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.tracking.uncertainty.combine import _allow_for_onsets, refine
from evaluator.tracking.uncertainty.exposure import exposed
from evaluator.tracking.uncertainty.outline import widen_by_outline
from evaluator.tracking.uncertainty.rigid_pair import Distance, wrong_ends
from evaluator.tracking.uncertainty.rim import Rim
from evaluator.tracking.uncertainty.tag_shape import _mean_square, _smooth, widen_by_shape

FRAME_S = 1 / 60


def line(n: int, speed_px: float = 1.0) -> np.ndarray:
    """Places of a mark on a line at a speed in px a frame, (n, 2)."""
    return np.outer(np.arange(n), [0.8 * speed_px, -0.6 * speed_px])


def test_exposure_of_a_steady_change_of_speed_is_off_by_a_twenty_fourth_of_it() -> None:
    """Speed that changes by a over an exposure T leaves the average off the middle by a·T²/24."""
    time, share, unsure = FRAME_S * np.arange(30), 0.6, 0.05
    places = np.column_stack([500.0 * time**2, -200.0 * time**2])
    shift, variance = exposed(time, places, np.full((30, 2), 1e-6), (share, unsure))
    full = np.array([1000.0, -400.0]) * FRAME_S**2 / 24
    np.testing.assert_allclose(shift, np.tile(full * share**2, (30, 1)), rtol=1e-6)
    np.testing.assert_allclose(variance, np.tile((full * 2 * share * unsure) ** 2, (30, 1)), rtol=1e-6)


def test_jump_of_speed_leaves_the_average_off_by_its_mean_square_over_320_where_it_is_certain() -> None:
    time, share = FRAME_S * np.arange(30), 0.5
    jump = 60.0  # px/s, 1 px a frame
    places = np.column_stack([jump * np.maximum(time - time[15], 0.0), 0 * time])
    _, variance = exposed(time, places, np.full((30, 2), 1e-4), (share, 0.0))
    assert variance[15] == pytest.approx([(1.0 * share) ** 2 / 320, 0.0])
    assert np.delete(variance, 15, axis=0).max() == pytest.approx(0.0, abs=1e-12)
    # Three sigmas of its own, sqrt(17.5) times that of a centre: 1 px is certain up to a sigma of 0.0797 px.
    for sigma, certain in ((0.077, True), (0.082, False)):
        _, variance = exposed(time, places, np.full((30, 2), sigma**2), (share, 0.0))
        assert (variance[15, 0] > 0) == certain
    assert exposed(time[:2], places[:2], np.full((2, 2), 1e-4), (share, 0.0))[0].tolist() == [[0.0, 0.0]] * 2


def outlined(frames: int, rng: np.random.Generator, sigma: float) -> tuple[np.ndarray, np.ndarray, list[Any]]:
    """A mark of 20 by 8 px at 30 degrees whose sides scatter about what slant makes of them."""
    time = FRAME_S * np.arange(frames)
    values = np.column_stack([line(frames), np.tile([1e-4, 1e-4, 0.0], (frames, 1))])
    slant = 0.01 * np.arange(frames)
    sides = [20 + slant + sigma * rng.normal(size=frames), 8 + slant + sigma * rng.normal(size=frames)]
    return time, values, list(zip(time, *sides, np.full(frames, np.pi / 6), strict=True))


def test_centre_is_as_unsure_along_a_mark_as_half_its_length_and_across_as_a_quarter_of_its_width() -> None:
    time, values, outline = outlined(2000, np.random.default_rng(8), 0.2)
    widen_by_outline(time, values, outline)
    along, across = np.array([np.cos(np.pi / 6), np.sin(np.pi / 6)]), np.array([-np.sin(np.pi / 6), np.cos(np.pi / 6)])
    covariance = np.array([[values[7, 2], values[7, 4]], [values[7, 4], values[7, 3]]])
    assert along @ covariance @ along == pytest.approx(0.1**2, rel=0.1)
    assert across @ covariance @ across == pytest.approx(0.05**2, rel=0.1)
    assert along @ covariance @ across == pytest.approx(0.0, abs=1e-4)


def test_outline_that_changes_as_slant_makes_it_or_is_seen_in_few_frames_widens_nothing() -> None:
    for frames, sigma in ((200, 0.005), (29, 0.2)):
        time, values, outline = outlined(frames, np.random.default_rng(9), sigma)
        before = values.copy()
        widen_by_outline(time, values, outline)
        np.testing.assert_array_equal(values, before)


def test_where_something_hides_an_end_of_a_mark_its_centre_is_unsure_by_half_of_what_is_hidden() -> None:
    """A recording may begin so, with the mark at rest, when a third of all frames are alike."""
    time, values, outline = outlined(200, np.random.default_rng(9), 0.005)
    values[:60, :2] = values[0, :2]
    hidden = [(t, long - 4.0 * (k < 60), short, angle) for k, (t, long, short, angle) in enumerate(outline)]
    widen_by_outline(time, values, hidden)
    assert np.sqrt(values[:60, 2:4].sum(axis=1)) == pytest.approx(2.0, rel=0.2)
    assert np.sqrt(values[60:, 2:4].sum(axis=1)).max() < 0.05


@pytest.mark.parametrize(("frames", "told"), [(60, True), (59, False)])
def test_length_may_change_smoothly_with_direction_and_from_sixty_frames_on_to_second_order_with_place(
    frames: int, told: bool
) -> None:
    time, angle = FRAME_S * np.arange(frames), 0.1 * np.arange(frames)
    x, y = 100 * (1 + 0.02 * angle) * np.array([np.cos(0.7 * angle), np.sin(0.7 * angle)])
    slant = 0.3 * np.cos(2 * angle) - 0.2 * np.sin(2 * angle) + 0.2 * np.cos(4 * angle) + 0.1 * np.sin(4 * angle)
    perspective = 1e-4 * (0.5 * x**2 - 0.3 * x * y - 0.4 * y**2) + 1e-3 * (x - y)
    before = np.column_stack([x, y, np.tile([1e-6, 1e-6, 0.0], (frames, 1))])
    values = before.copy()
    widen_by_outline(time, values, list(zip(time, 20 + slant + perspective, 8 + slant, angle, strict=True)))
    assert (values[:, 2].max() < 1e-5) == told


def test_a_frame_whose_outline_is_noted_twice_counts_once() -> None:
    time, values, outline = outlined(29, np.random.default_rng(9), 0.2)
    widen_by_outline(time, values, [*outline, *outline])
    assert (values[:, 2] == 1e-4).all()


def test_a_light_is_as_unsure_as_its_course_shows() -> None:
    rng = np.random.default_rng(12)
    places = line(400) + 0.05 * rng.normal(size=(400, 2))
    numbers = {"lamp": np.column_stack([places, np.tile([1e-4, 1e-4, 0.0], (400, 1))])}
    refine(FRAME_S * np.arange(400), ["P"] * 400, numbers, {"lamp": ["ok"] * 400}, {})
    assert np.median(numbers["lamp"][:, 2:4]) == pytest.approx(0.05**2, rel=0.2)


def pair(frames: int, noise: float, stated: float = 0.01) -> tuple[np.ndarray, np.ndarray]:
    """Two marks 20 px apart on a line across their way, with noise; (n, 5) each."""
    rng = np.random.default_rng(10)
    variances = np.tile([stated**2, stated**2, 0.0], (frames, 1))
    places = [line(frames) + offset for offset in ([6.0, 8.0], [-6.0, -8.0])]
    one, other = (np.column_stack([p + noise * rng.normal(size=p.shape), variances]) for p in places)
    return one, other


def test_distance_has_the_variance_of_both_marks_along_their_line() -> None:
    one, other = pair(200, 0.0)
    distance = Distance(one[:, :2], other[:, :2])
    skew = np.tile([0.04, 0.01, 0.015], (200, 1))
    expected = 0.6**2 * 0.04 + 0.8**2 * 0.01 + 2 * 0.6 * 0.8 * 0.015
    assert distance.variance(skew, 0 * skew) == pytest.approx(np.full(200, expected))
    assert distance.variance(skew, skew) == pytest.approx(np.full(200, 2 * expected))


def test_ratio_is_the_square_of_noise_over_what_is_stated_and_unknown_of_fewer_than_48_frames() -> None:
    one, other = pair(3000, 0.03)
    distance = Distance(one[:, :2], other[:, :2])
    assert distance.ratio(distance.variance(one[:, 2:], other[:, 2:])) == pytest.approx(9.0, rel=0.1)
    for frames, told in ((47, False), (48, True)):
        one, other = pair(frames, 0.03)
        distance = Distance(one[:, :2], other[:, :2])
        assert np.isfinite(distance.ratio(distance.variance(one[:, 2:], other[:, 2:]))) == told


def test_distances_beyond_twice_the_clip_are_wrong_ends_and_tell_nothing_of_the_usual_error() -> None:
    """Of errors of 1 the robust sigma is 1.4826: squares count up to four of them, and not at all beyond eight."""
    for far, mean in ((11.0, (95 + 5 * (4 * 1.4826) ** 2) / 100), (12.0, 1.0)):
        distance: Any = SimpleNamespace(error=np.where(np.arange(100) < 5, far, 1.0), freedom=0.5)
        distance.error[50:] *= -1
        assert Distance.ratio(distance, np.ones(100)) == pytest.approx(mean / 0.5)
        assert Distance.ratio(distance, np.full(100, 4.0)) == pytest.approx(mean / 0.5 / 4)


@pytest.mark.parametrize(("sigmas", "wrong"), [(4.2, False), (4.8, True)])
def test_a_distance_is_wrong_beyond_four_and_a_half_of_its_sigmas(sigmas: float, wrong: bool) -> None:
    one, other = pair(300, 1e-6)
    one[150, :2] += sigmas * np.sqrt(2) * 0.01 * np.array([0.6, 0.8])
    first, second = wrong_ends(FRAME_S * np.arange(300), (one, other))
    assert np.flatnonzero(first).tolist() == ([150] if wrong else [])
    assert not second.any()


@pytest.mark.parametrize(("times", "both"), [(1.8, True), (2.2, False)])
def test_of_a_wrong_pair_the_one_twice_as_far_off_its_course_is_wrong(times: float, both: bool) -> None:
    one, other = pair(300, 1e-6)
    one[150, :2] += times * 0.1 * np.array([0.6, 0.8])
    other[150, :2] -= 0.1 * np.array([0.6, 0.8])
    first, second = wrong_ends(FRAME_S * np.arange(300), (one, other))
    assert (first[150], second[150]) == (True, both)


def tag(frames: int, sigma: float, stated: float) -> dict[str, np.ndarray]:
    """Corners and centre of a square tag of 30 px that drives and turns; every corner errs by itself."""
    rng = np.random.default_rng(11)
    heading = 0.01 * np.arange(frames)
    numbers = {}
    for name, corner in (("a", 1 + 1j), ("b", -1 + 1j), ("c", -1 - 1j), ("d", 1 - 1j), ("center", 0j)):
        place = 15 * corner * np.exp(1j * heading) + 2 * np.arange(frames)
        noise = sigma * rng.normal(size=(frames, 2)) if corner else 0.0
        xy = np.column_stack([place.real, place.imag]) + noise
        numbers[name] = np.column_stack([xy, np.tile([stated**2, stated**2, 0.0], (frames, 1))])
    return numbers


def test_corners_that_err_by_themselves_change_the_shape_by_half_of_their_squares() -> None:
    """Of borders 0.68 of the squares would: the variances grow by the scatter over that."""
    numbers = tag(1000, 0.06, 0.02)
    widen_by_shape(numbers, ["a", "b", "c", "d"], "center")
    grown = 9 * 0.5 / ((6.1 * 0.75 + 0.25) / 7.1)
    for values in numbers.values():
        assert values[0, 2:5] == pytest.approx([grown * 4e-4, grown * 4e-4, 0.0], rel=0.08)


@pytest.mark.parametrize(("frames", "widened"), [(39, False), (40, True)])
def test_forty_frames_tell_the_scatter_of_a_shape_and_a_smaller_one_narrows_nothing(frames: int, widened: bool) -> None:
    numbers = tag(frames, 0.1, 0.02)
    widen_by_shape(numbers, ["a", "b", "c", "d"], "center")
    assert (numbers["a"][0, 2] > 4e-4) == widened
    calm = tag(200, 0.01, 0.02)
    widen_by_shape(calm, ["a", "b", "c", "d"], "center")
    assert calm["a"][0, 2] == 4e-4


def test_slant_perspective_and_lens_change_a_shape_without_scatter() -> None:
    """They follow the position, and four harmonics of the heading; a fifth one is scatter."""
    rng = np.random.default_rng(5)
    heading, place = np.linspace(0.0, 8.0, 60), 50.0 * (rng.normal(size=60) + 1j * rng.normal(size=60))
    waves = [np.exp(1j * order * heading) for order in (1, 2, 3, 4)]
    terms = np.stack([np.ones(60), place.real, place.imag, *(part for one in waves for part in (one.real, one.imag))])
    shape, usual = (rng.normal(size=(4, 11)) @ terms).T, _smooth(place, heading)
    assert _mean_square(shape, usual) < 1e-18
    assert _mean_square(shape + np.cos(5 * heading)[:, None], usual) > 1.0
    scatter = [_mean_square(shape + 0.1 * rng.normal(size=(60, 4)), usual) for _ in range(20)]
    assert np.mean(scatter) == pytest.approx(4 * 0.1**2, rel=0.05)


def test_shapes_that_a_wire_bends_tell_nothing_of_the_usual_scatter() -> None:
    clean, bent = tag(400, 0.06, 0.02), tag(400, 0.06, 0.02)
    bent["a"][::20, :2] += 0.06 * 10.0  # a mode holds a quarter of it, and scatters half as much as a corner: 5 sigmas
    for numbers in (clean, bent):
        widen_by_shape(numbers, ["a", "b", "c", "d"], "center")
    assert bent["center"][0, 2] == pytest.approx(clean["center"][0, 2], rel=0.1)


def rims(powers: list[float], own: float = 1.0) -> list[float]:
    rim, extra = Rim(), []
    for power in powers:
        rim.note((power, power), own)
        extra.append(rim.extra_px2)
    return extra


def test_a_rim_beyond_chance_widens_its_centre_by_three_halves_of_what_noise_leaves() -> None:
    """Twice the variance is beyond three sigmas of chance, 1 + 3·sqrt(2/6n), from the fourth frame on."""
    assert rims([2.0] * 6) == [0.0, 0.0, 0.0, 1.5, 1.5, 1.5]
    assert rims([np.nan, 2.0, np.inf] * 3) == [0.0] * 9  # three frames that tell something
    assert rims([0.5] * 9) == [0.0] * 9


def test_a_rim_nearly_three_times_the_usual_is_that_of_a_disturbed_frame_and_counts_as_it_is() -> None:
    assert rims([1.0] * 50 + [2.7])[-1] == 0.0
    assert rims([1.0] * 50 + [2.9])[-1] == pytest.approx(1.5 * 1.9)
    # What is usual is a mean over some twenty frames; after ten of 2 it is beyond the 1.39 that chance explains.
    grown = rims([1.0] * 50 + [2.0] * 20)
    mean = 2 - 0.95 ** np.arange(1, 21)
    assert grown[50:] == pytest.approx(np.where(mean > 1 + 3 * np.sqrt(2 / 120), 1.5 * (mean - 1), 0.0))


def test_frames_within_three_of_a_disturbed_one_are_a_quarter_as_unsure() -> None:
    values = np.column_stack([line(20), np.tile([0.01, 0.02, 0.0], (20, 1))])
    values[10, 2:4] = [4.0, 8.0]
    _allow_for_onsets(values)
    expected = np.tile([0.01, 0.02], (20, 1))
    expected[7:14] = [1.0, 2.0]
    expected[10] = [4.0, 8.0]
    np.testing.assert_allclose(values[:, 2:4], expected)
