"""Motion of the background: of a camera that pans, not of a robot before a plain floor."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from evaluator.tracking.camera_motion import CameraMotion

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
    at = np.array([[0, 0], [17, 5], [40, 12], [40, 30], [80, 50]])
    images = [floor[y : y + 360, x : x + 640] + rng.normal(0, 3, (360, 640)) for x, y in at]
    assert seen(images) == pytest.approx(-at.astype(float), abs=1.5)  # of a reduced image a third of a pixel


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
