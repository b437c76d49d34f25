"""What a mark looks like, and what is found in it: disc, smear, light, shape and cover, each in closed form.

Kernels are called as plain Python: any change shows at once, and nothing is compiled.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evaluator.tracking.refinement import motion_blur, occluded_pixels
from evaluator.tracking.refinement.disc import PER_PX, Disc, make_disc, outer_px, shaped_as, tabulate
from evaluator.tracking.refinement.learn_shape import cut_patch
from evaluator.tracking.refinement.occluded_pixels import ALONG_X, ALONG_Y, LEFT, MEAN, WORK
from evaluator.tracking.refinement.shading import LightNotes, interior_px, learn_shading
from evaluator.tracking.refinement.shape_kernel import PRODUCTS, add_products

DISC = make_disc(8.0, 0.9, (0.0, 0.0), (120.0, 40.0), 4.0)


@pytest.mark.parametrize(("radius", "blur"), [(3.0, 0.7), (8.0, 0.9), (20.0, 2.0)])
def test_blur_keeps_the_area_of_a_disc_and_halves_its_luma_at_the_edge(radius: float, blur: float) -> None:
    r = np.arange(len(tabulate(radius, blur)[0])) / PER_PX
    profile, slope, grown = tabulate(radius, blur)
    assert 2 * np.pi * np.sum(profile * r) / PER_PX == pytest.approx(np.pi * radius**2, rel=1e-3)
    assert profile[0] == pytest.approx(1 - np.exp(-((radius / blur) ** 2) / 2), abs=1e-3)  # Gaussian over a disc
    assert profile[int(radius * PER_PX)] == pytest.approx(0.5, abs=0.3 * blur / radius)
    np.testing.assert_allclose(slope[1:-1], (profile[2:] - profile[:-2]) * PER_PX / 2, atol=1e-3 / blur)
    step = 1e-3 * radius
    wider, narrower = (tabulate(radius + way * step, blur)[0][: len(r) - 5] for way in (1, -1))
    np.testing.assert_allclose(grown[: len(r) - 5], (wider - narrower) / (2 * step), atol=2e-3 / blur)


def test_table_by_the_square_of_the_radius_holds_the_profile_and_its_slope_over_the_radius() -> None:
    per_px2 = DISC.numbers()[7]
    assert per_px2 == pytest.approx(128 / 16)  # 128 entries for a pixel of radius at the edge
    for r in (2.0, 7.5, 8.0, 9.0):
        profile, over = DISC.table[int(r * r * per_px2 + 0.5)]
        at = int(r * PER_PX)
        assert profile == pytest.approx(DISC.profile[at], abs=3e-3)
        assert over == pytest.approx(DISC.slope[at] / r, abs=1e-3)
    assert not np.any((np.abs(DISC.table) < 1e-15) & (DISC.table != 0))


@pytest.mark.parametrize(
    ("radius", "blur", "outer"), [(4.0, 0.5, 6.0), (4.0, 1.0, 6.5), (12.0, 1.0, 16.0), (8.0, 0.9, 12.0)]
)
def test_pixels_used_reach_half_a_radius_beyond_the_edge_up_to_four_and_two_and_a_half_blurs_at_least(
    radius: float, blur: float, outer: float
) -> None:
    assert outer_px(radius, blur) == pytest.approx(outer)
    assert replace(DISC, radius_px=radius, blur_px=blur).outer_px == pytest.approx(outer)


def test_slants_are_unlike_beyond_three_sigmas_of_both() -> None:
    """An edge is known to 2·sqrt(2·√π·s·σ²/(6·π·R))/(R·A) in six frames."""
    unsure = 2 / 8 * np.sqrt(2 * np.sqrt(np.pi) * 0.9 / (np.pi * 8) * 4 / 6) / 120
    other = replace(DISC, e1=0.03, e2=-0.04, amplitude=-120.0)
    assert DISC.unlike(other) == pytest.approx(0.05 - 6 * unsure)
    assert DISC.unclear == pytest.approx(4 / 120**2)
    shaped = shaped_as(replace(DISC, amplitude=50.0, base=9.0), make_disc(5.0, 0.7, (0.1, 0.2), (1.0, 2.0), 9.0))
    assert (shaped.radius_px, shaped.e1, shaped.e2, shaped.amplitude, shaped.base, shaped.noise) == (
        *(5.0, 0.1, 0.2, 50.0, 9.0, 9.0),
    )


def smeared(disc: Disc, smear: tuple[float, float], monkeypatch: pytest.MonkeyPatch) -> np.ndarray | None:
    monkeypatch.setattr(motion_blur, "_fill_path", motion_blur._fill_path.py_func)
    return motion_blur.path_of(disc.numbers(smear))


@pytest.mark.parametrize("smear", [(2.0, 0.0), (3.0, -4.0), (0.0, 11.0)])
def test_a_smeared_disc_is_its_mean_over_the_path(smear: tuple[float, float], monkeypatch: pytest.MonkeyPatch) -> None:
    disc = make_disc(8.0, 0.9, (0.1, -0.05), (120.0, 40.0), 4.0)
    path = smeared(disc, smear, monkeypatch)
    assert path is not None
    assert len(path) == 2 * np.ceil(np.hypot(*smear) / 1.8)  # two points in each part of two blurs

    def slanted(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.interp(
            np.sqrt(1.1 * x * x - 0.1 * x * y + 0.9 * y * y), np.arange(len(disc.profile)) / PER_PX, disc.profile
        )

    def mean(x: float, y: float) -> float:
        t = (np.arange(400) + 0.5) / 400 - 0.5
        return float(slanted(x - t * smear[0], y - t * smear[1]).mean())

    for x, y in ((8.0, 1.0), (-5.0, 6.0), (1.0, -9.0)):
        outward = 1.1 * x - 0.05 * y, -0.05 * x + 0.9 * y
        found = motion_blur.mean_over.py_func(path, disc.table, disc.numbers()[7], x, y, *outward)
        assert found[0] == pytest.approx(mean(x, y), abs=8e-3)
        slope = [(mean(x + a, y + b) - mean(x - a, y - b)) / 0.2 for a, b in ((0.1, 0.0), (0.0, 0.1))]
        assert found[1:] == pytest.approx(slope, abs=0.02)


@pytest.mark.parametrize(("share", "smears"), [(0.70, False), (0.72, True)])
def test_a_path_smears_whose_square_is_half_that_of_the_blur(
    share: float, smears: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert (smeared(DISC, (0.6 * share * 0.9, 0.8 * share * 0.9), monkeypatch) is not None) == smears


def test_shift_by_uneven_light_is_root_pi_times_blur_and_radius_and_more_on_a_bright_floor() -> None:
    """On black (½∫P²)/(π∫P'²r dr) is √π·s·R; a floor as bright as the mark adds twice as much again."""
    places = np.random.default_rng(0).uniform(0, 400, (60, 2))
    big = make_disc(40.0, 0.9, (0.0, 0.0), (120.0, 16.0), 4.0)
    gains = []
    for base in (16.0, 136.0):
        shading = learn_shading(replace(big, base=base), 16.0, places, np.zeros((60, 2)))
        assert shading is not None
        gains.append(shading.gain)
    assert gains[0] == pytest.approx(np.sqrt(np.pi) * 0.9 * 40, rel=0.05)
    assert gains[1] == pytest.approx(3 * gains[0], rel=0.02)


def test_light_is_a_plane_of_relative_slopes_and_its_shift_has_the_variance_of_the_fit() -> None:
    rng = np.random.default_rng(1)
    places = rng.uniform(0, 400, (500, 2))
    plane = np.array([[4e-4, -3e-4], [2e-6, 0.0], [0.0, -1e-6]])
    beta = np.column_stack([np.ones(500), places - places.mean(axis=0)]) @ plane
    shading = learn_shading(DISC, 16.0, places, (beta + 1e-4 * rng.normal(size=(500, 2))) * (120 + 40 - 16))
    assert shading is not None
    assert shading.coefficients == pytest.approx(plane, abs=2e-5)
    shift, variance = shading.shift(places[:1])
    assert shift[0] == pytest.approx(shading.gain * beta[0], rel=0.1)
    middle = shading.shift(places.mean(axis=0)[None])[1]
    assert middle[0] == pytest.approx((shading.gain * 1e-4) ** 2 / 500, rel=0.2)  # of 500 slopes
    assert variance[0] > middle[0]


@pytest.mark.parametrize(("frames", "told"), [(7, False), (8, True)])
def test_eight_frames_tell_uneven_light(frames: int, told: bool) -> None:
    places, slopes = np.random.default_rng(2).uniform(0, 99, (30, 2)), np.zeros((30, 2))
    slopes[frames:] = np.nan
    assert (learn_shading(DISC, 16.0, places, slopes) is not None) == told
    assert learn_shading(replace(DISC, amplitude=-5.0), 16.0, places, slopes) is None
    assert LightNotes().learnt(DISC) is None


def test_inside_of_a_mark_is_two_and_a_half_blurs_within_its_edge_and_more_than_four_pixels() -> None:
    assert interior_px(replace(DISC, radius_px=7.0, blur_px=1.0)) == pytest.approx(4.5)
    assert interior_px(replace(DISC, radius_px=6.4, blur_px=1.0)) == 0.0
    notes = LightNotes()
    for time, sloped in ((0.0, True), (1.0, True), (1.0, False)):
        notes.note_fit(time, sloped=sloped)
    assert notes.shifted(np.array([0.0, 1.0, 2.0])).tolist() == [False, True, True]


def test_derivatives_that_a_shape_is_learnt_by_are_those_of_its_residuals() -> None:
    """The products with the residual are half the slope of the sum of squares, each with its sign."""
    radius, blur = 4.0, 0.8
    rng = np.random.default_rng(3)
    x, y = (axis.ravel().astype(float) for axis in np.meshgrid(np.arange(13), np.arange(13)))
    value, weight = 40 + 100 * (np.hypot(x - 6, y - 6) < 4) + rng.normal(size=169), rng.uniform(0.5, 1.0, 169)

    def summed(parameters: np.ndarray) -> tuple[float, np.ndarray]:
        products, residual = np.zeros((1, PRODUCTS, PRODUCTS)), np.empty(169)
        shape = np.array([*np.exp(parameters[6:8]), *parameters[8:]])
        count = add_products(
            x, y, value, weight, np.array([0, 169]), shape, 30.0, parameters[None, :6],
            tabulate(shape[0], shape[1]), PER_PX, products, residual,
        )  # fmt: skip
        assert count == 169
        return float(products[0, -1, -1]), products[0, :-1, -1]

    at = np.array([6.1, 5.9, 95.0, 41.0, 0.3, -0.2, np.log(radius), np.log(blur), 0.08, -0.05, 0.06, -0.04])
    pull = summed(at)[1]
    for place, step in enumerate([1e-2, 1e-2, 1e-2, 1e-2, 1e-3, 1e-3, 2e-3, 2e-3, 2e-3, 2e-3, 1e-3, 1e-3]):
        change = step * np.eye(12)[place]
        slope = (summed(at + change)[0] - summed(at - change)[0]) / (2 * step)
        assert pull[place] == pytest.approx(-slope / 2, rel=0.02, abs=2e-3 * np.abs(pull).max()), place


@pytest.mark.parametrize(("origin", "step"), [(0, 1), (1, 2)])
def test_patch_holds_the_samples_within_its_half_at_their_places_in_the_frame(origin: int, step: int) -> None:
    luma = np.arange(600, dtype=np.uint16).reshape(20, 30)
    patch = cut_patch(luma, (origin, step), (10.4, 12.0), 3.0)
    assert sorted(set(patch.x)) == [8, 9, 10, 11, 12, 13]
    assert sorted(set(patch.y)) == ([9, 10, 11, 12, 13, 14, 15] if step == 1 else [9, 11, 13, 15])
    np.testing.assert_array_equal(patch.value, luma[((patch.y - origin) / step).astype(int), patch.x.astype(int)])
    assert cut_patch(luma, (0, 1), (1.0, 1.0), 3.0).x.min() == 0
    assert len(cut_patch(luma, (0, 1), (60.0, 5.0), 3.0).value) == 0


def planes_of(shape: tuple[int, int] = (9, 11)) -> np.ndarray:
    return np.zeros((6, *shape))


def test_mean_of_nine_residuals_repeats_the_border_of_its_window() -> None:
    planes = planes_of()
    planes[LEFT, 4, 5], planes[LEFT, 0, 0] = 9.0, 9.0
    occluded_pixels.smooth.py_func(planes)
    assert planes[MEAN, 3:6, 4:7] == pytest.approx(np.ones((3, 3)))
    assert planes[MEAN, 0, 0] == pytest.approx(4.0)  # the corner counts four times
    assert planes[MEAN, 0, 1] == pytest.approx(2.0)
    assert planes[MEAN].sum() == pytest.approx(9 + 4 + 2 + 2 + 1)
    assert planes[WORK, 4, 4:7].tolist() == [9.0, 9.0, 9.0]


def test_excess_is_what_a_shift_of_a_tenth_of_a_pixel_leaves() -> None:
    planes, used = planes_of(), np.ones((9, 11), bool)
    planes[MEAN, 4, 5], planes[ALONG_X, 4, 5], planes[ALONG_Y, 4, 5] = -7.0, 30.0, 40.0
    assert occluded_pixels._excess(planes, used) == pytest.approx(7 - 0.1 * 50)
    planes[MEAN, 2, 2] = 9.0
    used[2, 2] = False
    assert occluded_pixels._excess(planes, used) == pytest.approx(2.0)


def test_sigma_of_what_is_left_is_that_of_its_normal_part() -> None:
    rng = np.random.default_rng(7)
    planes, used = planes_of((60, 60)), np.ones((60, 60), bool)
    planes[LEFT] = 2.0 * rng.normal(size=(60, 60))
    planes[LEFT, :5] = 60.0
    assert occluded_pixels.trimmed(planes, LEFT, used, 8.0) == pytest.approx(2.0, rel=0.1)
    used[5:] = False
    assert occluded_pixels.trimmed(planes, LEFT, used, 8.0) == 0.0


@pytest.mark.parametrize(("common", "expected"), [(0.1, 1.0), (1.5, 1.5), (9.0, 2.0)])
def test_noise_of_a_mean_is_once_to_twice_a_third_of_a_pixels(
    common: float, expected: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []
    monkeypatch.setattr(occluded_pixels, "trimmed", lambda *said: asked.append(said[3]) or common)
    assert occluded_pixels.scale_of(planes_of(), np.ones((9, 11), bool), 9.0) == pytest.approx(expected)
    assert asked == [6.0]


@pytest.mark.parametrize(
    ("most", "noise", "stands"), [(7.3, 1.0, True), (7.1, 1.0, False), (8.3, 4.0, True), (7.7, 4.0, False)]
)
def test_something_lies_across_a_mark_beyond_four_sigmas_and_a_share_of_its_contrast(
    most: float, noise: float, stands: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 120 levels 0.06 is 7.2; four sigmas of 2 levels are 8."""
    monkeypatch.setattr(occluded_pixels, "_excess", lambda *_: most)
    monkeypatch.setattr(occluded_pixels, "trimmed", lambda *said: said[3] / 2)
    args = planes_of(), np.ones((9, 11), bool), -120.0, noise
    assert occluded_pixels.stands_out(*args, occluded_pixels.CORE) == stands
    assert occluded_pixels.CORE_EXPECTED[1] * 120 == pytest.approx(3.6)
    assert occluded_pixels.stands_out(*args, occluded_pixels.CORE_EXPECTED)


@pytest.mark.parametrize(
    ("mean", "steep", "covers"), [(3.1, 0.0, True), (2.9, 0.0, False), (5.0, 11.0, False), (5.0, 9.0, True)]
)
def test_pixels_are_covered_beyond_three_sigmas_and_a_shift_and_so_are_those_beside(
    mean: float, steep: float, covers: bool
) -> None:
    planes, used, covered = planes_of(), np.ones((9, 11), bool), np.ones((9, 11), bool)
    planes[MEAN, 4, 5] = -mean
    planes[ALONG_X] = 2.0  # information, all alike but there
    planes[ALONG_X, 4, 5], planes[ALONG_Y, 4, 5] = 0.6 * steep, 0.8 * steep
    lost = occluded_pixels.cover.py_func(planes, used, 1.0, 0.2, covered)
    expected = np.zeros((9, 11), bool)
    expected[3:6, 4:7] = covers
    np.testing.assert_array_equal(covered, expected)
    assert lost == pytest.approx((8 * 4 + steep**2) / (98 * 4 + steep**2) if covers else 0.0)
