"""Blobs that may be dots: adaptive threshold at several window sizes, connected regions, and their moments."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.compilation import compiled

Array = NDArray[np.float64]
Plane = NDArray[np.float32]

# Windows for the local mean. A window must hold a dot and some background; each serves dots of about a tenth to half of
# its width, so a step of two leaves no gap. The smallest
# comes last: it is for dots that stand closer than ten pixels.
WINDOWS = (31, 63, 127, 255, 511, 15)
SMALLEST_AREA_PX = 9  # below 3 × 3 pixels ten parameters cannot be fitted
# Limits of area/(4π√det(second moments)), which is 1 for a filled ellipse, 0.955 for a square, below 0.8 for an
# L-shaped letter; pixel steps and noise change it by some percent for small ellipses. The fit tests further.
FILLED = (0.85, 1.12)
# For an exhaustive search: windows for dots wider than a quarter of the image's height, and levels for dots so close to
# dark structures that no local mean separates them.
WIDE_WINDOWS = (1023, 2047, 4095)
LEVELS = 12
MOST_BLOBS = 3000  # largest blobs used of one mask: more are texture, and the limit bounds the time of a search
NOISE_SAMPLES = 50_000  # pixels, which determine the noise to 0.5 %
LONGEST_AXIS_RATIO = 4.0  # a circle seen at 75 degrees


@dataclass(frozen=True)
class Candidates:
    """Blobs of about elliptical shape: centre (n, 2) px, second moments (n, 3) xx, xy, yy px², area (n,) px."""

    center_px: Array
    moments_px2: Array
    area_px: Array

    def __len__(self) -> int:
        """Count of blobs."""
        return len(self.area_px)

    def take(self, index: NDArray[np.intp]) -> Candidates:
        """Some of the blobs."""
        return Candidates(self.center_px[index], self.moments_px2[index], self.area_px[index])


@compiled()
def _sums(labels, count):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Area, first and second moments of each region about the corner of the image: (count, 6), region 0 left out."""
    sums = np.zeros((count, 6))
    for y in range(labels.shape[0]):
        for x in range(labels.shape[1]):
            if labels[y, x] > 0:
                row = sums[labels[y, x]]
                row[0] += 1.0
                row[1] += x
                row[2] += y
                row[3] += x * x
                row[4] += x * y
                row[5] += y * y
    return sums[1:]


def candidates_by_window(plane: Plane, noise: float) -> Iterator[tuple[int, Candidates]]:
    """Dark blobs of about elliptical shape, window by window; noise: from `noise_of`."""
    for window in WINDOWS:
        if window <= 2 * min(plane.shape):
            yield window, _at_window(plane, window, noise)


def all_candidates(plane: Plane, noise: float) -> Candidates:
    """Dark blobs of about elliptical shape from all windows and from global levels, with duplicates.

    noise: from `noise_of`.
    """
    found = [_at_window(plane, w, noise) for w in (*WINDOWS, *WIDE_WINDOWS) if w <= 2 * min(plane.shape)]
    levels = np.quantile(plane[:: max(1, plane.shape[0] // 500)], np.linspace(0, 1, LEVELS + 2)[1:-1])
    low, high = np.quantile(plane, [0.005, 0.995])
    span = np.linspace(float(low), float(high), LEVELS + 2)[1:-1]
    found += [_blobs(plane < level) for level in np.unique(np.concatenate([levels, span]))]
    found = [each.take(np.argsort(-each.area_px, kind="stable")[:MOST_BLOBS]) for each in found]
    return Candidates(*(np.concatenate([getattr(each, name) for each in found]) for name in Candidates.__annotations__))


def noise_of(plane: Plane) -> float:
    """Standard deviation of white noise, from the median second difference along rows (most of an image is smooth)."""
    step = max(1, plane.size // NOISE_SAMPLES)
    rows = plane[::step]
    second = rows[:, 2:] - 2 * rows[:, 1:-1] + rows[:, :-2]
    return float(np.median(np.abs(second)) / 0.6745 / np.sqrt(6.0))


def _at_window(plane: Plane, window: int, noise: float) -> Candidates:
    mean = cv2.blur(plane, (window, window), borderType=cv2.BORDER_REFLECT)
    span = cv2.blur(cv2.absdiff(plane, mean), (window, window), borderType=cv2.BORDER_REFLECT)
    # Half the mean deviation keeps the threshold between the two levels for dots that fill 5 to 60 % of the window;
    # four sigmas of noise keep flat ground empty.
    return _blobs(plane < mean - np.maximum(0.5 * span, 4.0 * noise))


def _blobs(mask: NDArray[np.bool_]) -> Candidates:
    """Regions of a mask that are about elliptical and completely in view."""
    count, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=4, ltype=cv2.CV_32S)
    sums = _sums(labels, count)
    sums = sums[sums[:, 0] >= SMALLEST_AREA_PX]
    area = sums[:, 0]
    mean_x, mean_y = sums[:, 1] / area, sums[:, 2] / area
    # a pixel is a square: 1/12 px² is its own second moment
    xx = sums[:, 3] / area - mean_x**2 + 1 / 12
    xy = sums[:, 4] / area - mean_x * mean_y
    yy = sums[:, 5] / area - mean_y**2 + 1 / 12
    determinant = np.maximum(xx * yy - xy**2, 1e-9)
    filled = area / (4 * np.pi * np.sqrt(determinant))
    root = np.sqrt((xx - yy) ** 2 + 4 * xy**2)
    ratio = np.sqrt((xx + yy + root) / np.maximum(xx + yy - root, 1e-9))
    keep = (filled > FILLED[0]) & (filled < FILLED[1]) & (ratio < LONGEST_AXIS_RATIO)
    keep &= area < 0.25 * mask.size
    # what touches the rim of the image is cut
    reach_x, reach_y = 2 * np.sqrt(xx), 2 * np.sqrt(yy)
    keep &= (mean_x - reach_x > -0.5) & (mean_x + reach_x < mask.shape[1] - 0.5)
    keep &= (mean_y - reach_y > -0.5) & (mean_y + reach_y < mask.shape[0] - 0.5)
    return Candidates(np.stack([mean_x, mean_y], 1)[keep], np.stack([xx, xy, yy], 1)[keep], area[keep])
