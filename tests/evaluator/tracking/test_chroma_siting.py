"""Samples of colour at the even columns of the luma, or midway: told apart by edges, and marks centred accordingly."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from evaluator.recording import Frame
from evaluator.tracking.detection import chroma_siting as module
from evaluator.tracking.detection.chroma_siting import COSITED, MIDWAY, first_column
from evaluator.tracking.following.follow_blob import start_blob
from tests.evaluator.tracking.synthetic import BLACK, GREEN, LUMA, PLATE, YELLOW, coverage

# Weights of the columns about an even one, from two to its left: as cameras write, and as programs that convert RGB do.
SITED = {COSITED: (0.0, 0.25, 0.5, 0.25), MIDWAY: (0.0, 0.0, 0.5, 0.5)}


def stored(image: NDArray[np.float64], place: float, *, cosited: bool | None = True, down: int = 2) -> Frame:
    """A frame whose colour planes are sampled with their samples at a place."""
    luma = image @ LUMA
    u, v = 128 + (image[..., 2] - luma) / 1.772, 128 + (image[..., 0] - luma) / 1.402
    kernel = np.array([SITED[place]])
    small = [
        cv2.filter2D(plane, -1, kernel, anchor=(2, 0))[:, ::2].reshape(-1, down, plane.shape[1] // 2).mean(axis=1)
        for plane in (u, v)
    ]
    y, cb, cr = (np.clip(np.rint(plane), 0, 255).astype(np.uint8) for plane in (luma, *small))
    return Frame(0, 0, Fraction(1, 60), y, cb, cr, 8, True, "bt601", 0, 1, "", False, None, cosited)


def robot(body: tuple[int, int, int], marks: dict[tuple[int, int, int], tuple[float, float]]) -> NDArray[np.float64]:
    """A plate with a robot and discs of 16 px on it."""
    image = np.tile(np.array(PLATE, float), (120, 160, 1))
    image[30:90, 40:120] = body
    for color, center in marks.items():
        image += coverage((160, 120), center, 8.0, 0.9)[..., None] * (np.array(color) - image)
    return image + np.random.default_rng(3).normal(0.0, 1.0, image.shape)


@pytest.mark.parametrize("down", [1, 2])  # 4:2:2 and 4:2:0
@pytest.mark.parametrize("place", [COSITED, MIDWAY])
@pytest.mark.parametrize("usual", [True, None])
def test_place_of_the_samples_is_told_from_two_marks(place: float, down: int, *, usual: bool | None) -> None:
    image = robot(BLACK, {GREEN: (60.3, 50.8), YELLOW: (97.6, 61.1)})
    assert first_column(stored(image, place, cosited=usual, down=down)) == place


def test_samples_are_in_their_usual_place_if_the_image_does_not_tell() -> None:
    grey = np.tile(np.array(PLATE, float), (48, 64, 1))
    assert first_column(stored(grey, MIDWAY)) == COSITED
    assert first_column(stored(grey, MIDWAY, cosited=None)) == MIDWAY
    assert first_column(stored(grey, MIDWAY, cosited=False)) == MIDWAY
    image = robot(BLACK, {GREEN: (60.3, 50.8), YELLOW: (97.6, 61.1)})
    assert first_column(stored(image, COSITED, cosited=False)) == MIDWAY


@pytest.mark.parametrize("place", [COSITED, MIDWAY])
def test_mark_as_light_as_its_body_is_centred_by_its_colour_wherever_the_samples_are(place: float) -> None:
    level = round(float(np.array(GREEN) @ LUMA))
    center = (60.3, 50.8)
    frame = stored(robot((level, level, level), {GREEN: center}), place)
    assert frame.u is not None
    assert frame.v is not None
    u, v = float(frame.u[25, 30]) - 128.0, float(frame.v[25, 30]) - 128.0
    size = float(np.hypot(u, v))
    color = np.array([128.0, 128.0, u / size, v / size, 0.45 * size, 0.6])
    cell = np.array([2.0, 2.0, place, 0.5])
    one = start_blob(frame, cell, center, 8.0, color, None).look_at(frame, cell, center, 4.0, 0.0)
    assert (one.x, one.y) == pytest.approx(center, abs=0.05)


def textured(distance_px: float, *, depth: int = 8, down: int = 2, contrast: float = 1.0) -> Frame:
    """A frame whose colour is a third of its luma, sampled at a distance from the middle between two columns."""
    rng, levels = np.random.default_rng(5), 1 << (depth - 8)
    y, x = np.mgrid[0:96, 0:128].astype(float)
    size, across = contrast * rng.uniform(2.0, 4.0, 20), rng.uniform(0.1, 0.5, 20)  # waves of 12 to 60 columns
    along, phase = rng.uniform(0.05, 0.2, 20), rng.uniform(0.0, 2 * np.pi, 20)

    def image(right_px: float) -> NDArray[np.float64]:
        return np.cos(np.multiply.outer(x + right_px, across) + np.multiply.outer(y, along) + phase) @ size

    right = image(0.5 + distance_px)  # of column 2k; blurred as the means over columns and rows are
    blurred = cv2.filter2D(right, -1, np.array([[1.0, 6.0, 1.0]]) / 8.0)[:, ::2]
    plane = 128.0 + blurred.reshape(-1, down, blurred.shape[1]).mean(axis=1) / 3.0
    noise = rng.normal(0.0, 0.2 * contrast, plane.shape)
    planes = [np.clip(np.rint(levels * one), 0, 256 * levels - 1) for one in (110.0 + image(0.0), plane + noise, plane)]
    luma, u, v = (one.astype(np.uint8 if depth == 8 else np.uint16) for one in planes)
    return Frame(0, 0, Fraction(1, 60), luma, u, v, depth, True, "bt601", 0, 1, "", False, None, True)


@pytest.mark.parametrize(("depth", "down"), [(8, 1), (8, 2), (10, 2)])
@pytest.mark.parametrize("distance_px", [-0.5, -0.2, 0.0, 0.4])
def test_distance_of_colour_from_luma_is_measured_wherever_it_lies(distance_px: float, depth: int, down: int) -> None:
    found, sigma = module._distance_px(textured(distance_px, depth=depth, down=down))
    assert found == pytest.approx(distance_px, abs=0.03)
    assert sigma < 0.05


@pytest.mark.parametrize(("contrast", "is_seen"), [(0.06, True), (0.035, False)])
def test_faint_colour_tells_the_distance_at_any_depth_of_samples_alike(contrast: float, *, is_seen: bool) -> None:
    for depth in (10, 12):  # most changes of it are 0.3 or 0.2 levels of 8 bits a sample
        found, sigma = module._distance_px(textured(0.2, depth=depth, contrast=contrast))
        assert bool(np.isfinite(sigma)) == is_seen
        assert found == pytest.approx(0.2 if is_seen else 0.0, abs=0.05)


def test_standard_error_of_the_distance_is_the_scatter_of_its_median(monkeypatch: pytest.MonkeyPatch) -> None:
    rng, frame = np.random.default_rng(4), textured(0.0)
    monkeypatch.setattr(module, "_windows", lambda *_: [np.s_[:2, :2]] * 60)
    monkeypatch.setattr(module, "_in_window", lambda *_: (rng.normal(0.1, 0.4), 1.0))
    found, sigma = np.array([module._distance_px(frame) for _ in range(200)]).T
    assert np.mean(found) == pytest.approx(0.1, abs=0.02)
    assert np.mean(sigma) == pytest.approx(np.std(found), rel=0.2)
    monkeypatch.setattr(module, "_in_window", lambda *_: (0.1, 1.0))  # as alike as edges of one camera may be
    assert module._distance_px(frame)[1] == pytest.approx(1.25 * 0.17 / np.sqrt(120))
    for windows, told in ((1, False), (2, True)):  # of two planes: four tell something
        monkeypatch.setattr(module, "_windows", lambda *_, count=windows: [np.s_[:2, :2]] * count)
        assert bool(np.isfinite(module._distance_px(frame)[1])) == told


def test_error_of_the_distance_in_a_window_follows_the_noise_of_its_colour() -> None:
    rng, share, distance = np.random.default_rng(6), 0.4, 0.3
    luma = np.cumsum(rng.normal(2.0, 5.0, (13, 13)), axis=1)  # rises along the row: slope and level go together
    slope = np.gradient(luma, axis=1) + 0.02 * luma
    color = [share * (luma + distance * slope) + rng.normal(0.0, 2.0, luma.shape) for _ in range(400)]
    found, variance = np.array([module._in_window(one, luma, slope) for one in color]).T
    assert np.mean(found) == pytest.approx(distance, abs=0.05)
    assert np.mean(variance) - 0.17**2 == pytest.approx(np.var(found) * 4.5 / 4.0, rel=0.15)  # half a level² is added


def test_colour_lies_between_the_columns_that_a_sample_spans() -> None:
    grey = np.tile(np.array(PLATE, float), (48, 64, 1))
    frame = stored(grey, MIDWAY)
    for across, first in ((1, 0.0), (4, 1.5)):  # 4:4:4 and 4:1:1
        assert first_column(replace(frame, luma=np.repeat(frame.u, across, axis=1))) == first


@pytest.mark.parametrize(("unexplained", "counts"), [(0.0, True), (0.29, True), (0.31, False), (1.0, False)])
def test_a_window_counts_where_luma_and_its_slope_leave_less_than_three_tenths_of_the_colour(
    unexplained: float, *, counts: bool
) -> None:
    wave = 2 * np.pi * np.arange(12) / 12
    luma, slope, other = (
        np.tile(function(by * wave), (12, 1)) for function, by in ((np.sin, 1), (np.cos, 1), (np.sin, 3))
    )
    color = np.sqrt(1 - unexplained) * (0.8 * luma + 0.6 * slope) + np.sqrt(unexplained) * other
    found = module._in_window(color.astype(np.float32), luma.astype(np.float32), slope.astype(np.float32))
    assert (found is not None) == counts
    if found is not None:
        assert found[0] == pytest.approx(0.75, rel=1e-5)


@pytest.mark.parametrize(
    ("distance", "sigma", "place"),
    [
        *((-0.5, 0.09, COSITED), (-0.5, 0.11, MIDWAY), (-0.69, 0.09, COSITED), (-0.31, 0.09, COSITED)),
        *((-0.29, 0.0, MIDWAY), (-0.71, 0.0, MIDWAY)),
    ],
)
def test_a_distance_tells_a_place_within_a_fifth_of_a_pixel_by_half_of_which_it_is_sure(
    distance: float, sigma: float, place: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_distance_px", lambda _: (distance, sigma))
    frame = replace(textured(0.0), cosited=None)  # where it does not tell, midway
    assert first_column(frame) == place
