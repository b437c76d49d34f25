"""Clips of a square tag that drives around, drawn by sub-pixels without the product's renderer; truth is exact."""

from __future__ import annotations

import cv2
import numpy as np

from evaluator.tracking import TrackingSettings
from evaluator.tracking.luma_marks.tags import tag_names
from tests.evaluator.tracking.plain_video import GOOD, Clip, Encoding, finished, loop, texture

FINE = 4  # sub-pixels a pixel, either way
CELL = 24  # px of a cell in the image of the tag
DICTIONARIES = {"apriltag": (cv2.aruco.DICT_APRILTAG_36H11, 8), "aruco": (cv2.aruco.DICT_4X4_50, 6)}
SIZE = (480, 360)


def tag_clip(
    rng: np.random.Generator, kind: str = "apriltag", encoding: Encoding = GOOD, *, side_px: float = 52.0,
    frames: int = 60, step: float = 0.03, blur_px: float = 0.8, number: int = 7, strength: float = 12.0,
) -> Clip:  # fmt: skip
    """A tag of a number with its white margin on a textured floor; step: rad a frame around an ellipse of 100 px."""
    dictionary, cells = DICTIONARIES[kind]
    drawn = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(dictionary), number, cells * CELL)
    tag = np.pad(drawn.astype(np.float32), CELL, constant_values=255) * (200 / 255) + 25
    low, high = CELL - 0.5, CELL - 0.5 + cells * CELL
    points = np.array([[(low + high) / 2] * 2, [low, low], [high, low], [high, high], [low, high]])
    floor = texture(rng, SIZE, strength)
    path, heading = loop(frames, (SIZE[0] / 2, SIZE[1] / 2), (100.0, 80.0), step)
    names = tag_names(f"tag_{number}")
    truth = {name: np.empty((frames, 2)) for name in names}
    images = []
    for k in range(frames):
        cos, sin = np.cos(heading[k]), np.sin(heading[k])
        turn = np.array([[cos, -sin], [sin, cos]]) * (side_px / (cells * CELL))
        canvas = floor.copy()
        _stamp(canvas, tag, turn, path[k] - turn @ points[0], round(side_px) + 4, blur_px)
        for name, point in zip(names, points, strict=True):
            truth[name][k] = path[k] + turn @ (point - points[0])
        images.append(finished(rng, canvas))
    settings = TrackingSettings.model_validate({"mark": {f"tag_{number}": {"kind": kind}}})
    return Clip(images, truth, side_px / 2, encoding, settings)


def _stamp(canvas: np.ndarray, tag: np.ndarray, turn: np.ndarray, shift: np.ndarray, half: int, blur_px: float) -> None:
    """Lay the tag onto the canvas, in place: a point u of the tag comes to turn @ u + shift."""
    middle = turn @ (np.array(tag.shape[::-1]) / 2) + shift
    first = np.floor(middle).astype(int) - half
    side = 2 * half
    # Sub-pixel i lies at (i + 0.5) / FINE - 0.5 px of the part.
    to_fine = np.column_stack([FINE * turn, FINE * (shift - first + 0.5) - 0.5])
    fine = (side * FINE, side * FINE)
    share = (cv2.warpAffine(np.ones_like(tag), to_fine, fine) > 0.5).astype(np.float32)
    level = cv2.warpAffine(tag, to_fine, fine, borderMode=cv2.BORDER_REPLICATE) * share
    level, share = (
        cv2.GaussianBlur(layer, (0, 0), blur_px * FINE).reshape(side, FINE, side, FINE).mean(axis=(1, 3))[..., None]
        for layer in (level, share)
    )
    part = canvas[first[1] : first[1] + side, first[0] : first[0] + side]
    part[:] = part * (1 - share) + level
