"""Occluded pixels of a mark: residuals common to neighbours, beyond noise and a small shift.

Planes of a window: the mark's profile, its slopes along x and y, the residual of the luma, and its mean over 3 × 3
pixels.
"""
# mypy: disallow-untyped-defs=false, disallow-untyped-calls=false
# ruff: noqa: ANN001, ANN201 - numba infers the types

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from calibration.compilation import compiled
from evaluator.tracking.refinement.motion_blur import mean_over

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Sigmas of the 3 × 3 mean beyond which its pixels count as occluded: 1 % of the clear pixels are lost.
BEYOND = 3.0
# Least 3 × 3 mean of the residuals, beyond those of a shift of CORE_OFF_PX, that shows an occlusion: in sigmas of
# single pixels, and as a share of the amplitude. Of 10,000 clear marks none exceeds both. Codec blocks, whose errors
# are correlated between neighbours, reach 4 % of the amplitude, with a median of 2 %. A wire over 3 % of a mark reaches
# 30 %, one beside it 9 %, and 4 % if the shape was learnt with the wire. The limits are lower where an occlusion is
# likely: just after one was seen, and while a shape is learnt, there for all frames alike.
CORE, CORE_EXPECTED, CORE_OFF_PX = (4.0, 0.06), (2.6, 0.03), 0.1
# Largest noise of the mean, over that predicted from single pixels: errors within codec blocks are correlated.
MOST = 2.0
PROFILE, ALONG_X, ALONG_Y, LEFT, MEAN, WORK = range(6)  # planes of a window


@compiled(nogil=True)
def model(luma, top_y, row_step, left, state, disc, table, path, planes, used):
    """Fill profile, slopes and residual of the pixels of a window at a state, computed as in `kernels.accumulate`.

    top_y: y of the window's first row; left: its first column; path: of `motion_blur.path_of`, or None.
    """
    e1, e2, amplitude, outer2, shade_x, shade_y = disc[2], disc[3], state[2], disc[4] * disc[4], disc[8], disc[9]
    x, y = state[0] - disc[1] * disc[1] * shade_x, state[1] - disc[1] * disc[1] * shade_y
    for j in range(luma.shape[0]):
        dy = top_y + row_step * j - y
        for i in range(luma.shape[1]):
            dx = left + i - x
            outward_x, outward_y = (1.0 + e1) * dx + e2 * dy, e2 * dx + (1.0 - e1) * dy
            square = outward_x * dx + outward_y * dy
            used[j, i] = square <= outer2
            if path is not None:
                p, pull_x, pull_y = mean_over(path, table, disc[7], dx, dy, outward_x, outward_y)
            else:
                k = int(square * disc[7] + 0.5)
                k = k if k < len(table) else len(table) - 1
                p, pull_x, pull_y = table[k, 0], table[k, 1] * outward_x, table[k, 1] * outward_y
            light = 1.0 + shade_x * dx + shade_y * dy
            planes[ALONG_X, j, i] = -amplitude * (light * pull_x + shade_x * p)
            planes[ALONG_Y, j, i] = -amplitude * (light * pull_y + shade_y * p)
            p *= light
            planes[PROFILE, j, i] = p
            planes[LEFT, j, i] = luma[j, i] - state[3] - amplitude * p - state[4] * dx - state[5] * dy
    smooth(planes)


@compiled(nogil=True, forceinline=True)
def smooth(planes):
    """Fill the mean over 3 × 3 pixels of the residuals; pixels at the border of a window are repeated beyond it."""
    _, tall, wide = planes.shape
    for j in range(tall):
        for i in range(wide):
            before, after = i - 1 if i > 0 else 0, i + 1 if i < wide - 1 else i
            planes[WORK, j, i] = planes[LEFT, j, before] + planes[LEFT, j, i] + planes[LEFT, j, after]
    for j in range(tall):
        above, below = j - 1 if j > 0 else 0, j + 1 if j < tall - 1 else j
        for i in range(wide):
            three = planes[WORK, above, i] + planes[WORK, j, i] + planes[WORK, below, i]
            planes[MEAN, j, i] = three * (1.0 / 9.0)


def stands_out(planes: Array, used: Mask, amplitude: float, noise: float, core: tuple[float, float]) -> bool:
    """Whether an occlusion is significant and not explained by a small shift of the mark."""
    most = _excess(planes, used)
    return bool(
        most > core[1] * abs(amplitude) and most > core[0] * trimmed(planes, LEFT, used, 2.0 * math.sqrt(noise))
    )


def _excess(planes: Array, used: Mask) -> float:
    """Largest 3 × 3 mean of the residuals beyond that of a small shift."""
    steep = np.sqrt(planes[ALONG_X] ** 2 + planes[ALONG_Y] ** 2)
    return float(np.max(np.abs(planes[MEAN]) - CORE_OFF_PX * steep, initial=0.0, where=used))


def trimmed(planes: Array, plane: int, used: Mask, scale: float) -> float:
    """Sigma of the used values of a plane, without outliers; scale: an upper bound of it."""
    squares = planes[plane][used] ** 2
    for _ in range(3):
        near = squares[squares < (2.5 * scale) ** 2]
        scale = math.sqrt(float(near.sum()) / (len(near) + 1))
    return scale


def scale_of(planes: Array, used: Mask, noise: float) -> float:
    """Sigma of the 3 × 3 means of the residuals, without outliers: it includes correlated errors of the frame."""
    least = math.sqrt(noise) / 3.0
    return float(min(max(trimmed(planes, MEAN, used, 6.0 * least), least), MOST * least))


@compiled(nogil=True)
def cover(planes, used, scale, off_px, covered):  # noqa: C901 - one loop
    """Mark occluded pixels and those beside them; returns their share of the information."""
    tall, wide = used.shape
    total = lost = 0.0
    for j in range(tall):
        for i in range(wide):
            covered[j, i] = False
    for j in range(tall):
        for i in range(wide):
            excess = abs(planes[MEAN, j, i]) - BEYOND * scale
            if used[j, i] and excess > 0.0:
                steep2 = planes[ALONG_X, j, i] ** 2 + planes[ALONG_Y, j, i] ** 2
                if excess * excess > off_px * off_px * steep2:
                    for k in range(max(j - 1, 0), min(j + 2, tall)):
                        for m in range(max(i - 1, 0), min(i + 2, wide)):
                            covered[k, m] = True
    for j in range(tall):
        for i in range(wide):
            if used[j, i]:
                information = planes[ALONG_X, j, i] ** 2 + planes[ALONG_Y, j, i] ** 2
                total += information
                lost += information if covered[j, i] else 0.0
    return lost / max(total, 1e-12)
