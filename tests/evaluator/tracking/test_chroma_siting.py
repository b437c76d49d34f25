"""Samples of colour at the even columns of the luma, or midway: told apart by edges, and marks centred accordingly."""

from __future__ import annotations

from fractions import Fraction

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from evaluator.recording import Frame
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
