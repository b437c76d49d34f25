"""Blobs that may be dots: adaptive threshold at several window sizes, connected regions, and their moments."""

from __future__ import annotations

from collections.abc import Callable, Iterator
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
# Above this number of pixels wide windows and levels are evaluated on a reduced image, whose blobs are as good a start
# for the fit; no window becomes narrower than FINE_WINDOW.
LARGE_PX, FINE_WINDOW = 60_000_000, 127
STRIP = 256  # rows
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


NO_CANDIDATES = Candidates(np.empty((0, 2)), np.empty((0, 3)), np.empty(0))
BySign = Callable[[float], Candidates]  # from the sign of contrast


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


def candidates_by_window(plane: Plane, noise: float) -> Iterator[tuple[int, BySign]]:
    """Window by window: its width, and a function from the sign of contrast to blobs of about elliptical shape.

    noise: from `noise_of`. Sign 1 finds blobs that are darker than their surroundings, -1 brighter ones.
    """
    for window in WINDOWS:
        if window <= 2 * min(plane.shape):
            yield window, _at_window(plane, window, noise)


def all_candidates(plane: Plane, noise: float, signs: tuple[float, ...]) -> list[Candidates]:
    """Blobs of about elliptical shape from all windows and from global levels, with duplicates, for each sign.

    noise: from `noise_of`. signs: as in `candidates_by_window`.
    """
    found: list[list[Candidates]] = [[] for _ in signs]
    for window in (*WINDOWS, *WIDE_WINDOWS):
        if window <= 2 * min(plane.shape):
            at_window = _at_window(plane, window, noise)
            for sign, blobs in zip(signs, found, strict=True):
                blobs.append(_largest(at_window(sign)))
    factor = _reduction(plane, LARGE_PX)
    small = _reduced(plane, factor)
    for sign, blobs in zip(signs, found, strict=True):
        levels = np.quantile(sign * plane[:: max(1, plane.shape[0] // 500)], np.linspace(0, 1, LEVELS + 2)[1:-1])
        low, high = np.quantile(small, [0.005, 0.995]) if sign > 0 else -np.quantile(small, [0.995, 0.005])
        span = np.linspace(float(low), float(high), LEVELS + 2)[1:-1]
        for level in np.unique(np.concatenate([levels, span])):
            mask = small < level if sign > 0 else small > -level
            blobs.append(_largest(_enlarged(_blobs(mask), factor)))
    return [
        Candidates(*(np.concatenate([getattr(each, name) for each in blobs]) for name in Candidates.__annotations__))
        for blobs in found
    ]


def _largest(blobs: Candidates) -> Candidates:
    return blobs.take(np.argsort(-blobs.area_px, kind="stable")[:MOST_BLOBS])


def noise_of(plane: Plane) -> float:
    """Standard deviation of white noise, from the median second difference along rows (most of an image is smooth)."""
    step = max(1, plane.size // NOISE_SAMPLES)
    rows = plane[::step]
    second = rows[:, 2:] - 2 * rows[:, 1:-1] + rows[:, :-2]
    return float(np.median(np.abs(second)) / 0.6745 / np.sqrt(6.0))  # Φ⁻¹(3/4), and 1 + 4 + 1 variances


def _at_window(plane: Plane, window: int, noise: float) -> BySign:
    """Blobs by sign, against a mean and a threshold that both signs share."""
    factor = max(1, window // FINE_WINDOW) if plane.size > LARGE_PX else 1
    plane, side = _reduced(plane, factor), window // factor | 1
    noise = noise if factor == 1 else noise_of(plane)
    mean = cv2.blur(plane, (side, side), borderType=cv2.BORDER_REFLECT)
    span = cv2.absdiff(plane, mean)
    span = cv2.blur(span, (side, side), borderType=cv2.BORDER_REFLECT)
    # Half the mean deviation keeps the threshold between the two levels for dots that fill 5 to 60 % of the window;
    # four sigmas of noise keep flat ground empty.
    np.multiply(span, 0.5, out=span)
    np.maximum(span, 4.0 * noise, out=span)

    def blobs(sign: float) -> Candidates:
        mask = np.empty(plane.shape, bool)
        for top in range(0, len(plane), STRIP):  # no further copies of a large image
            rows = slice(top, top + STRIP)
            threshold = mean[rows] - span[rows] if sign > 0 else mean[rows] + span[rows]
            mask[rows] = plane[rows] < threshold if sign > 0 else plane[rows] > threshold
        return _enlarged(_blobs(mask), factor)

    return blobs


def _reduction(plane: Plane, most_px: float) -> int:
    """Factor by which both sides of an image are reduced to at most a number of pixels."""
    return max(1, int(np.ceil(np.sqrt(plane.size / most_px))))


def _reduced(plane: Plane, factor: int) -> Plane:
    """An image of means of factor × factor pixels; the last incomplete rows and columns are left out."""
    if factor == 1:
        return plane
    height, width = (side // factor for side in plane.shape)
    whole = plane[: height * factor, : width * factor]
    return np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA), np.float32)


def _enlarged(blobs: Candidates, factor: int) -> Candidates:
    """Blobs of a reduced image in px of the whole one."""
    if factor == 1:
        return blobs
    center = factor * (blobs.center_px + 0.5) - 0.5
    return Candidates(center, factor**2 * blobs.moments_px2, factor**2 * blobs.area_px)


def _blobs(mask: NDArray[np.bool_]) -> Candidates:
    """Regions of a mask that are about elliptical and completely in view."""
    count, labels = cv2.connectedComponents(mask.view(np.uint8), connectivity=4, ltype=cv2.CV_32S)
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
