"""Errors of a disc that last for many frames, from the offset between its fit in the luma and the centre of its colour.

The reflection of a ring light on a glossy sticker, or what a codec of few bits leaves of its rim, shifts the fitted
disc in the same direction for many frames. The disc still fits and its course is smooth, so that neither residuals nor
neighbouring frames show the error. But the colour is shifted differently: a reflection attracts the disc, which is
bright, and repels the colour, which it whitens. The offset of the two is noisy because chroma is coarse, but the noise
of frames between which the mark has moved by half a chroma sample is independent: the mean product of successive
offsets contains lasting errors only.
"""

from __future__ import annotations

from array import array

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Frames on either side whose offsets are averaged: a reflection changes within a few diameters.
AROUND = 12
FEWEST = 4  # products from which an offset is known to half its value
# Width of a chroma sample over the lasting offset of a mark without fault. In 8 drawn clips of matt discs of 3 to 6 px
# the offset is 0.03 to 0.13 px with samples of 2 px: the place of a sample in its cell, and the colour of the body.
OWN = 0.07
SHARE = 0.5  # of an offset: the error of the disc, if disc and colour are shifted alike in opposite directions
STEP = 0.5  # chroma samples by which a mark must move between two offsets that count
CROWDED, TORN = 1.5, 0.5  # ratios of the area of its colour to the usual one beyond which its centre is not the mark's


class ColorOffsets:
    """Offsets of the centre of a mark's colour from its fitted disc, collected during tracking."""

    def __init__(self) -> None:
        """Start with none."""
        self.sample_px = 1.0  # width of a chroma sample
        self._noted = array("d")  # rows of five: time, place of the disc, offset; 40 bytes a frame

    def note(
        self, time_s: float, place: tuple[float, float], colored: Array, area_px2: float, sample_px: float
    ) -> None:
        """Record a disc fitted at a place, px. colored: of `color_window`; area_px2: usual area of its colour."""
        area, x, y, _, _ = colored.tolist()
        if TORN * area_px2 < area < CROWDED * area_px2:
            self._noted.extend((time_s, *place, x - place[0], y - place[1]))
            self.sample_px = sample_px

    def variance(self, time_s: Array) -> Array:
        """Variance per axis of the lasting error of the disc at times (n,), px²; 0 if too few frames show it."""
        rows = np.array(self._noted).reshape(-1, 5)
        _, last_of_time = np.unique(rows[::-1, 0], return_index=True)  # a frame may be measured again
        noted = rows[::-1][last_of_time]
        noted = noted[_apart(noted[:, 1:3], STEP * self.sample_px)]
        product = (noted[1:, 3:] * noted[:-1, 3:]).mean(axis=1)
        if len(product) < FEWEST:
            return np.zeros(len(time_s))
        sums = np.cumsum(np.concatenate([[0.0], product]))
        middle = np.searchsorted((noted[1:, 0] + noted[:-1, 0]) / 2, time_s)
        first = np.clip(middle - AROUND, 0, max(len(product) - 2 * AROUND, 0))
        last = np.minimum(first + 2 * AROUND, len(product))
        lasting = (sums[last] - sums[first]) / (last - first)
        return np.asarray(SHARE**2 * np.maximum(lasting - (OWN * self.sample_px) ** 2, 0.0))


def _apart(places_px: Array, step_px: float) -> NDArray[np.intp]:
    """Rows of places (n, 2), each at least a step from the one before."""
    kept, at = list[int](), np.full(2, np.inf)
    for row, place in enumerate(places_px):
        if not np.abs(place - at).max() < step_px:
            kept.append(row)
            at = place
    return np.array(kept, np.intp)
