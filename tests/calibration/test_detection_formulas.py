"""The parts of dot detection against what they are by definition: model and its derivatives, moments, noise, doubts."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import correlate2d
from scipy.stats import norm

from calibration.detection import candidates
from calibration.detection.candidates import _blobs, all_candidates, noise_of
from calibration.detection.disturbed import _usual, doubted, useful
from calibration.detection.dots import Dots, _whole
from calibration.detection.ellipse_fit import collect_pixels, derivatives, fit_dots
from calibration.detection.image import color_bgr, dark_dots
from calibration.detection.initial_ellipses import start_values
from calibration.detection.noise_correlation import REACH, _lags, correlation_factors
from calibration.detection.roundness import out_of_round
from calibration.errors import CalibrationError

Array = np.ndarray
RADIUS, BLUR = 9.0, 1.2


def pixels_at(x: Array, y: Array, value: float = 0.0) -> Array:
    return np.stack([x, y, np.full(len(x), value)]).astype(float)


def model_at(x: Array, y: Array, parameters: Array) -> tuple[Array, Array]:
    """Light of the model at points, and its derivatives (10, n)."""
    rows = np.empty((11, len(x)))
    derivatives(pixels_at(x, y), len(x), parameters, rows)
    return -rows[10], rows[:10]  # of pixels that hold nought


def circle(blur: float = BLUR, slope: tuple[float, float] = (0.0, 0.0)) -> Array:
    """A dark disc at (30.3, 29.6): background 200, contrast 120."""
    return np.array([30.3, 29.6, RADIUS**-2, 0.0, RADIUS**-2, blur, 200.0, -120.0, *slope])


ELLIPSE = np.array([30.3, 29.6, 0.0150, 0.0035, 0.0100, 1.5, 200.0, -120.0, 0.004, -0.003])


def drawn(parameters: Array, size: int = 61) -> np.ndarray:
    y, x = np.mgrid[:size, :size]
    return model_at(x.ravel(), y.ravel(), parameters)[0].reshape(size, size).astype(np.float32)


@pytest.mark.parametrize("angle", [0.0, 1.0, 2.5, -2.0])
def test_light_along_a_ray_from_a_disc_is_the_normal_distribution_of_the_distance_from_its_edge(angle: float) -> None:
    distance = np.linspace(-3.9, 3.9, 27) * BLUR
    radius = RADIUS + distance
    x, y = 30.3 + radius * np.cos(angle), 29.6 + radius * np.sin(angle)
    light = 1 + 0.01 * radius * np.cos(angle) - 0.02 * radius * np.sin(angle)
    found, _ = model_at(x, y, circle(slope=(0.01, -0.02)))
    np.testing.assert_allclose(found, light * (200 - 120 * norm.cdf(-distance / BLUR)), rtol=1e-6)


def test_edge_of_an_ellipse_is_half_dark_and_far_from_it_the_light_is_even() -> None:
    values, vectors = np.linalg.eigh([[0.015, 0.0035], [0.0035, 0.010]])
    edge = np.array([30.3, 29.6])[:, None] + vectors / np.sqrt(values)  # ends of both axes
    light = 1 + 0.004 * (edge[0] - 30.3) - 0.003 * (edge[1] - 29.6)
    np.testing.assert_allclose(model_at(*edge, ELLIPSE)[0], light * (200 - 60), rtol=1e-6)
    inside, outside = model_at(np.array([30.3, 60.3]), np.array([29.6, 29.6]), ELLIPSE)[0]
    assert (inside, outside) == pytest.approx((80.0, 1.12 * 200), rel=1e-3)  # four blurs from the edge it is flat


@pytest.mark.parametrize("parameters", [circle(slope=(0.01, -0.02)), ELLIPSE])
def test_derivatives_of_the_light_are_those_of_differences(parameters: Array) -> None:
    angle, q = (part.ravel() for part in np.meshgrid(np.linspace(0, 6, 20), np.linspace(0.75, 1.3, 8)))
    values, vectors = np.linalg.eigh([[parameters[2], parameters[3]], [parameters[3], parameters[4]]])
    x, y = parameters[:2, None] + (vectors / np.sqrt(values)) @ (q * np.stack([np.cos(angle), np.sin(angle)]))
    _, found = model_at(x, y, parameters)
    for k, step in enumerate((1e-2, 1e-2, 1e-4, 1e-4, 1e-4, 1e-2, 1.0, 1.0, 1e-3, 1e-3)):
        moved = step * np.eye(10)[k]
        slope = (model_at(x, y, parameters + moved)[0] - model_at(x, y, parameters - moved)[0]) / (2 * step)
        np.testing.assert_allclose(found[k], slope, atol=2e-3 * np.abs(slope).max())


def test_pixels_of_a_dot_are_those_within_reach_of_its_edge() -> None:
    plane = np.arange(61 * 61, dtype=np.float32).reshape(61, 61)
    pixels = np.empty((3, 61 * 61))
    for center in ((30.3, 29.6), (3.0, 57.0)):  # the second is cut by the rim of the image
        start = circle()
        start[:2] = center
        count = collect_pixels(plane, start, 4.0, RADIUS, pixels)
        y, x = np.mgrid[:61, :61]
        near = np.hypot(x - center[0], y - center[1]) <= RADIUS + 4.0
        assert set(zip(*pixels[:2, :count].astype(int).tolist(), strict=True)) == set(
            zip(x[near].tolist(), y[near].tolist(), strict=True)
        )
        np.testing.assert_array_equal(pixels[2, :count], pixels[1, :count] * 61 + pixels[0, :count])


@pytest.mark.parametrize("parameters", [circle(slope=(0.01, -0.02)), ELLIPSE])
def test_fit_finds_what_was_drawn_and_knows_it_as_the_noise_allows(parameters: Array) -> None:
    start = parameters + np.array([0.4, -0.3, 5e-4, -5e-4, 4e-4, 0.3, 5.0, 9.0, 0.0, 0.0])
    noise = 2.0 * np.random.default_rng(0).normal(size=(61, 61)).astype(np.float32)
    exact, _, left = fit_dots(drawn(parameters), start[None], np.array([8.0]))
    np.testing.assert_allclose(exact[0], parameters, rtol=2e-4, atol=3e-4)
    assert left[0] < 0.05
    fitted, covariance, scatter = fit_dots(drawn(parameters) + noise, start[None], np.array([8.0]))
    assert scatter[0] == pytest.approx(2.0, rel=0.1)
    pixels = np.empty((3, 61 * 61))
    count = collect_pixels(drawn(parameters), start, 8.0, 12.0, pixels)
    rows = model_at(*pixels[:2, :count], fitted[0])[1]
    expected = scatter[0] ** 2 * np.linalg.inv(rows @ rows.T)[:2, :2]
    np.testing.assert_allclose(covariance[0], expected, rtol=0.02, atol=0.02 * expected[0, 0])
    assert np.abs(fitted[0, :2] - parameters[:2]).max() < 4 * np.sqrt(expected.max())


@pytest.mark.parametrize("parameters", [circle(), ELLIPSE])
def test_a_dot_is_measured_at_half_height_before_it_is_fitted(parameters: Array) -> None:
    """From moments that are a fifth too large and a centre that is off by a pixel."""
    inverse = np.linalg.inv([[parameters[2], parameters[3]], [parameters[3], parameters[4]]]) / 4
    moments = 1.2 * np.array([[inverse[0, 0], inverse[0, 1], inverse[1, 1]]])
    (start,), (reach,), (good,) = start_values(
        drawn(parameters), parameters[None, :2] + [1.0, -1.0], moments, np.array([np.inf])
    )
    assert good
    assert start[:2] == pytest.approx(parameters[:2], abs=0.3)  # of whole pixels
    assert start[2:5] == pytest.approx(parameters[2:5], abs=0.06 * parameters[2])
    assert start[5] == pytest.approx(parameters[5], rel=0.2)
    assert start[6:8] == pytest.approx(parameters[6:8], rel=0.06)
    longest = 1 / np.sqrt(np.linalg.eigvalsh([[start[2], start[3]], [start[3], start[4]]])[0])
    assert reach == pytest.approx(max(6 * start[5], 0.7 * longest))
    near = start_values(drawn(parameters), parameters[None, :2], moments, np.array([2 * longest + 6.0]))[1]
    assert near[0] == pytest.approx(3.0, abs=0.5)  # half of the way to the next dot belongs to that
    bright = start_values(-drawn(parameters), parameters[None, :2], moments, np.array([np.inf]))[2]
    assert not bright[0]


def disc(size: int, radius: float, x: float, y: float, stretch: float = 1.0) -> Array:
    down, across = np.mgrid[:size, :size]
    return np.asarray(np.hypot((across - x) / stretch, down - y) <= radius)


def test_moments_of_a_blob_are_those_of_its_ellipse() -> None:
    found = _blobs(disc(80, 12.0, 40.0, 36.0, 2.0))
    assert found.center_px[0] == pytest.approx([40.0, 36.0])
    assert found.moments_px2[0] == pytest.approx([24.0**2 / 4, 0.0, 12.0**2 / 4], rel=0.03, abs=1e-9)
    assert found.area_px[0] == pytest.approx(np.pi * 24 * 12, rel=0.02)
    y, x = np.mgrid[:80, :80] - 40.0
    leaning = _blobs(0.010 * x**2 - 0.008 * x * y + 0.006 * y**2 <= 1)
    expected = np.linalg.inv([[0.010, -0.004], [-0.004, 0.006]]) / 4
    assert leaning.moments_px2[0] == pytest.approx(expected[[0, 0, 1], [0, 1, 1]], rel=0.02)


@pytest.mark.parametrize(
    ("mask", "kept"),
    [
        (disc(80, 8.0, 40.0, 40.0, 3.7), True),
        (disc(80, 7.0, 40.0, 40.0, 4.4), False),  # longer than a circle is seen at 75 degrees
        (disc(60, 10.0, 10.0, 30.0), True),
        (disc(60, 10.0, 9.0, 30.0), False),  # touches the rim
        (disc(60, 10.0, 50.0, 30.0), False),
        (disc(60, 10.0, 30.0, 9.0), False),
        (disc(60, 10.0, 30.0, 50.0), False),
        (disc(30, 9.0, 14.5, 14.5), False),  # more than a quarter of the image
        (disc(60, 10.0, 30.0, 30.0) & ~disc(60, 6.0, 30.0, 30.0), False),  # a ring
    ],
)
def test_blobs_are_kept_where_they_are_filled_ellipses_wholly_in_view(mask: Array, kept: bool) -> None:
    assert len(_blobs(mask)) == kept


def test_an_l_is_no_dot_and_a_square_may_be_one() -> None:
    letter, square = np.zeros((60, 60), bool), np.zeros((60, 60), bool)
    letter[20:40, 20:25] = letter[35:40, 20:40] = True
    square[20:40, 20:40] = True
    assert (len(_blobs(letter)), len(_blobs(square))) == (0, 1)
    tiny = np.zeros((60, 60), bool)
    tiny[20:22, 20:24] = True
    assert len(_blobs(tiny)) == 0  # eight pixels


@pytest.mark.parametrize(("off", "whole"), [(0.01, True), (-0.01, False)])
@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_dot_whose_edge_blur_and_all_reaches_the_rim_is_cut(axis: int, side: int, off: float, whole: bool) -> None:
    """Of the ellipse's box the half width is √(A⁻¹) of that axis; the rim lies half a pixel beyond the last pixel."""
    fitted, size = ELLIPSE.copy(), (61, 81)
    inverse = np.linalg.inv([[fitted[2], fitted[3]], [fitted[3], fitted[4]]])
    reach = np.sqrt(inverse[axis, axis]) + 2.5 * fitted[5]
    fitted[axis] = reach - 0.5 + off if side == 0 else size[1 - axis] - 0.5 - reach - off
    assert bool(_whole(fitted[None], size)[0]) == whole


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_blobs_of_a_large_image_are_found_in_a_reduced_one_where_they_are(
    monkeypatch: pytest.MonkeyPatch, sign: float
) -> None:
    y, x = np.mgrid[:530, :610]
    plane = (200.0 - sign * 100.0 * (np.hypot(x - 301.3, y - 240.7) < 60.0)).astype(np.float32)
    plane += np.random.default_rng(1).normal(0, 1, plane.shape).astype(np.float32)
    monkeypatch.setattr(candidates, "LARGE_PX", plane.size // 9)
    (found,) = all_candidates(plane, 1.0, (sign,))
    disc = np.abs(found.area_px / (np.pi * 60.0**2) - 1) < 0.1
    assert disc.sum() > candidates.LEVELS
    assert np.abs(found.center_px[disc].mean(axis=0) - (301.3, 240.7)).max() < 0.1
    assert np.abs(found.center_px[disc] - (301.3, 240.7)).max() < 0.6  # a fifth of a reduced pixel


def test_noise_of_an_image_is_that_of_its_flat_ground() -> None:
    plane = drawn(circle()) + 3.0 * np.random.default_rng(1).normal(size=(61, 61)).astype(np.float32)
    assert noise_of(plane) == pytest.approx(3.0, rel=0.08)


def test_sums_of_products_at_a_lag_are_the_autocorrelation() -> None:
    rng = np.random.default_rng(2)
    y, x = (part.ravel() for part in np.mgrid[:5, :6])
    values = rng.normal(size=(2, 30))
    found = _lags(np.stack([x, y]).astype(float) + REACH, values, 12)
    for row, image in zip(found, values.reshape(2, 5, 6), strict=True):
        whole = correlate2d(np.pad(image, REACH), np.pad(image, REACH))
        middle = np.array(whole.shape) // 2
        cut = tuple(slice(m - REACH, m + REACH + 1) for m in middle)
        np.testing.assert_allclose(row, whole[cut], atol=1e-12)


@pytest.mark.parametrize("alike", [(1, 1), (1, 3), (2, 3)])
def test_noise_that_is_alike_in_neighbouring_pixels_widens_the_centres_as_its_covariance_says(
    alike: tuple[int, int],
) -> None:
    """Means of white noise over some rows and columns; of the pixels of a dot the covariance is dense and known.

    What the fit takes out of residuals is put back as if they were white, up to a seventh too little.
    """
    places = [(x, y) for x in range(30, 400, 60) for y in range(30, 400, 60)]
    white = np.random.default_rng(3).normal(size=(430, 430))
    noise = np.mean([np.roll(white, (i, j), (0, 1)) for i in range(alike[0]) for j in range(alike[1])], axis=0)
    plane, starts = np.full((430, 430), 200.0), []
    for x, y in places:
        dot = circle(blur=4.0)
        dot[:2] = x, y
        down, across = np.mgrid[y - 25 : y + 26, x - 25 : x + 26].astype(float)
        plane[y - 25 : y + 26, x - 25 : x + 26] = model_at(across.ravel(), down.ravel(), dot)[0].reshape(51, 51)
        starts.append(dot)
    image, reach = (plane + noise).astype(np.float32), np.full(len(places), 12.0)
    fitted, _, left = fit_dots(image, np.array(starts), reach)
    pixels = np.empty((3, 61 * 61))
    count = collect_pixels(image, starts[0], 12.0, RADIUS, pixels)
    x, y = pixels[:2, :count]
    rows = model_at(x, y, starts[0])[1]
    influence = np.linalg.solve(rows @ rows.T, rows)[:2]
    shares = [np.maximum(1 - np.abs(of[:, None] - of) / width, 0) for of, width in zip((y, x), alike, strict=True)]
    widened = np.einsum("ip,pq,iq->i", influence, shares[0] * shares[1], influence) / (influence**2).sum(axis=1)
    share = correlation_factors(image, fitted, reach, left) / np.sqrt(widened)
    assert share == pytest.approx([1.0, 1.0], abs=1e-6 if alike == (1, 1) else 0.15)


@pytest.mark.parametrize(("order", "size"), [(3, 0.06), (4, 0.09), (6, 0.05)])
@pytest.mark.parametrize("lean", [0.0, 0.004])
def test_departure_of_figures_from_ellipses_is_found_by_its_order_and_size(
    order: int, size: float, lean: float
) -> None:
    matrix = np.array([[0.008, lean], [lean, 0.012]])
    value, vector = np.linalg.eigh(matrix)
    root = vector * np.sqrt(value) @ vector.T
    y, x = np.mgrid[:61, :61] - 30.0
    u = np.moveaxis(np.stack([x, y], -1) @ root.T, -1, 0)
    radius = np.hypot(*u)
    rim = 1 + size * np.cos(order * np.arctan2(u[1], u[0]) - 0.7)
    gradient = np.hypot(*np.moveaxis(np.stack([x, y], -1) @ matrix, -1, 0)) / np.maximum(radius, 1e-9)
    plane = (200 - 120 * norm.cdf((rim - radius) / np.maximum(gradient, 1e-9) / BLUR)).astype(np.float32)
    count = 20
    dots = Dots(
        size_px=(61, 61),
        centers_px=np.full((count, 2), 30.0),
        covariance_px2=np.zeros((count, 2, 2)),
        diameter_px=np.full(count, 20.0),
        contrast=np.full(count, 120.0),
        background=np.full(count, 200.0),
        blur_px=np.full(count, BLUR),
        noise=np.ones(count),
        shape=np.tile(matrix[[0, 0, 1], [0, 1, 1]], (count, 1)),
        color=np.zeros((count, 1)),
        plane=plane,
    )
    found, amplitude = out_of_round(dots, np.arange(count))
    assert found == order
    assert amplitude == pytest.approx(size, rel=0.15)
    assert out_of_round(dots, np.arange(11))[1] == 0.0  # too few to tell


def test_usual_residual_is_the_median_of_the_sound_dots_and_a_suspect_one_is_four_of_their_deviations_beyond() -> None:
    quantiles = norm.ppf((np.arange(400) + 0.5) / 400)
    for spoilt, share in ((0.5, 0.0), (0.5, 0.3), (0.7, 0.5)):
        noise = 3.0 * np.exp(0.05 * quantiles)
        noise[400 - int(400 * share) :] = 50.0  # the largest are disturbed, and much
        usual, limit = _usual(noise, spoilt)
        assert usual == pytest.approx(3.0, rel=0.01)
        assert limit == pytest.approx(3.0 * np.exp(4 * 0.05), rel=0.01)
    assert _usual(np.full(8, 2.0)) == pytest.approx((2.0, 2.0 * np.exp(0.1)))  # a tenth at least
    assert _usual(np.full(7, 2.0)) == (0.0, np.inf)


def test_what_disturbs_a_dot_makes_its_centre_doubtful_by_its_share_of_the_contrast_in_blurs() -> None:
    noise = np.full(20, 3.0)
    noise[7] = 5.0
    fitted = np.tile(circle(), (20, 1))
    found = doubted(fitted, np.tile(1e-4 * np.eye(2), (20, 1, 1)), noise)
    moved = 12.0 * 4.0 / 120.0 * BLUR  # beyond noise, a residual of 4 of 120 levels
    np.testing.assert_allclose(found[7], (1e-4 + moved**2) * np.eye(2))
    np.testing.assert_allclose(np.delete(found, 7, axis=0), np.tile(1e-4 * np.eye(2), (19, 1, 1)))


@pytest.mark.parametrize(("times", "kept"), [(7.9, True), (8.1, False)])
def test_a_dot_eight_times_as_uncertain_as_usual_says_nothing(times: float, kept: bool) -> None:
    covariance = np.tile(np.diag([1e-4, 2e-4]), (9, 1, 1))
    covariance[4] *= times**2
    assert useful(covariance)[4] == kept


def test_dots_are_dark_on_the_axis_from_their_colour_to_the_background() -> None:
    assert color_bgr("orange") == pytest.approx([0.0, 165 / 255, 1.0])
    assert color_bgr(" #102030 ") == pytest.approx([48 / 255, 32 / 255, 16 / 255])
    with pytest.raises(CalibrationError, match="reddish"):
        color_bgr("reddish")
    gray = np.array([[10, 20]], dtype=np.uint8)
    assert dark_dots(gray, "black", "white").tolist() == [[10.0, 20.0]]
    assert dark_dots(gray, "white", "black").tolist() == [[-10.0, -20.0]]
    red_on_white = np.array([[[0, 0, 255], [255, 255, 255]]], dtype=np.uint8)
    assert dark_dots(red_on_white, "red", "white")[0] == pytest.approx([0.0, 255.0])
    white_on_red = dark_dots(red_on_white, "white", "red")[0]
    assert white_on_red[1] < white_on_red[0]
    with pytest.raises(CalibrationError, match="same color"):
        dark_dots(red_on_white, "red", "#ff0000")
