"""Motion of the background: of a camera that pans, not of a robot before a plain floor."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from evaluator.tracking.camera_motion import CameraMotion, _shift

SIZE = 640, 360


def seen(images: list[np.ndarray], marks: list[list[tuple[float, float, float]]] | None = None) -> np.ndarray:
    """Path of the background in images, of which each is the fourth frame after the one before."""
    camera = CameraMotion()
    for k, image in enumerate(images):
        luma = image.clip(0, 255).astype(np.uint8)
        frame: Any = SimpleNamespace(index=4 * k, time_s=0.1 * k, size_px=SIZE, luma=luma)
        camera.note(frame, marks[k] if marks else [])
    return camera.path(0.1 * np.arange(len(images)))


def grain(rng: np.random.Generator, width: int, height: int) -> np.ndarray:
    layer = cv2.GaussianBlur(rng.normal(size=(height, width)), (0, 0), 6.0)
    return np.asarray(120.0 + 20.0 * layer / layer.std())


def test_background_is_where_the_camera_has_moved_it() -> None:
    rng = np.random.default_rng(2)
    floor = grain(rng, 900, 480)
    at = np.array([[0, 0], [17, 5], [40, 12], [40, 12], [40, 30], [80, 50], [83, 50]])
    images = [floor[y : y + 360, x : x + 640] + rng.normal(0, 3, (360, 640)) for x, y in at]
    assert seen(images) == pytest.approx(-at.astype(float), abs=1.5)  # of a reduced image a third of a pixel


def test_a_shift_over_a_faint_floor_is_known_to_a_tenth_of_a_pixel() -> None:
    """Of reduced images; what the window makes of their mean brightness does not draw it."""
    rng = np.random.default_rng(0)
    errors = []
    for _ in range(12):
        layer = cv2.GaussianBlur(rng.normal(size=(120, 220)), (0, 0), 1.5)
        floor = (120.0 + 1.5 * layer / layer.std()).astype(np.float32)
        x, y = rng.integers(-8, 9, 2)
        before, after = floor[15:105, 20:180], floor[15 + y : 105 + y, 20 + x : 180 + x]
        errors.append(np.hypot(*np.add(_shift(before, after, np.ones(before.shape, np.bool_)), [x, y])))
    assert np.mean(errors) < 0.1


def test_nothing_is_known_of_a_background_that_the_marks_hide() -> None:
    floor = grain(np.random.default_rng(2), 700, 360)
    marks = [(320.0, 180.0, 60.0)]  # its robot fills the image
    np.testing.assert_array_equal(seen([floor[:, :640], floor[:, 40:680]], [marks, marks]), 0.0)


def test_a_robot_before_a_plain_floor_does_not_move_it() -> None:
    rng = np.random.default_rng(3)
    images, marks = [], []
    for k in range(5):
        image = 180.0 + rng.normal(0, 2, (360, 640))
        image[100:180, 60 + 30 * k : 140 + 30 * k] = 40.0
        images.append(image)
        marks.append([(80.0 + 30 * k, 140.0, 8.0), (120.0 + 30 * k, 140.0, 8.0)])
    np.testing.assert_array_equal(seen(images, marks), 0.0)


def test_nothing_is_known_to_have_moved_without_frames() -> None:
    np.testing.assert_array_equal(CameraMotion().path(np.arange(3.0)), 0.0)
