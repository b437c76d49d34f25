"""Motion of the camera: what moves as the background does is at rest, although the camera pans or is held by hand.

Consecutive reduced images are aligned by phase correlation. The shift counts if it also explains what changed away from
the marks; otherwise a robot before a plain floor would be taken for the background.
"""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np
from numpy.typing import NDArray

from evaluator.recording import Frame

Array = NDArray[np.float64]
Single = NDArray[np.float32]

EVERY_MASK = 3  # every fourth frame is compared: a camera that turns fast moves its image by a tenth meanwhile
WIDTH = 160.0  # px of the reduced images: pans by a hundredth of the image are seen
AWAY = 8.0  # radii around a mark that may show its robot
# Share of the changes away from the marks that may remain after a shift: the right one leaves noise and parallax, a
# wrong one, or that of a robot alone, leaves all.
LEFT = 0.6
LEAST_PX = 1.0 / 3.0  # of a reduced image: smaller shifts are within the error of the correlation


class CameraMotion:
    """Path of the background of a recording."""

    def __init__(self) -> None:
        """Start at rest."""
        self._before: Single | None = None
        self._at, self._time_s = np.zeros(2), list[float]()
        self._path = list[Array]()

    def note(self, frame: Frame, marks: Iterable[tuple[float, float, float]]) -> None:
        """Follow the background to a frame; marks: x, y and radius of each, px."""
        if frame.index & EVERY_MASK:
            return
        width, height = frame.size_px
        scale = max(width / WIDTH, 1.0)
        size = max(round(width / scale), 2), max(round(height / scale), 2)
        small = cv2.resize(frame.luma, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        away = np.ones(small.shape, np.uint8)
        for x, y, radius in marks:
            cv2.circle(away, (round(x / scale), round(y / scale)), round(AWAY * radius / scale), 0, -1)
        if self._before is not None and self._before.shape == small.shape:
            self._at = self._at + scale * _shift(self._before, small, away > 0)
        self._before = small
        self._time_s.append(frame.time_s)
        self._path.append(self._at)

    def path(self, time_s: Array) -> Array:
        """Displacement of the background since the first frame at times (n,), px; (n, 2)."""
        if not self._path:
            return np.zeros((len(time_s), 2))
        return np.stack([np.interp(time_s, self._time_s, axis) for axis in np.array(self._path).T], axis=1)


def _shift(before: Single, after: Single, away: NDArray[np.bool_]) -> Array:
    """Shift of the background between two images, px; 0 if a shift does not explain the change away from the marks."""
    size = before.shape[1], before.shape[0]
    window = cv2.createHanningWindow(size, cv2.CV_32F)
    (x, y), _ = cv2.phaseCorrelate((before - before.mean()) * window, (after - after.mean()) * window)
    if np.hypot(x, y) < LEAST_PX:
        return np.zeros(2)
    matrix = np.array([[1.0, 0.0, x], [0.0, 1.0, y]])
    moved = cv2.warpAffine(before, matrix, size)
    inside = cv2.warpAffine(np.ones_like(before), matrix, size) > 0.99
    part = away & inside
    if not part.any():
        return np.zeros(2)
    changed, left = (float(np.abs(after - image)[part].mean()) for image in (before, moved))
    return np.array([x, y]) if left < LEFT * changed else np.zeros(2)
