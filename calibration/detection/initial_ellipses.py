"""Initial values of the dot fit: each blob is measured again at half height between its core and its surroundings.

The threshold that finds blobs need not lie at half height, so that a blurred or crowded blob is measured too wide or
too narrow, and a fit started from it may fail.
"""

from __future__ import annotations

from math import ceil, cos, pi, sin, sqrt

import numpy as np

from calibration.compilation import compiled


@compiled()
def start_values(plane, centers, moments, gap):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Initial parameters (n, 10) of fit_dots, its reach (n,) in px, and whether the blob is valid (n,).

    plane: (h, w) float32, dots dark. centers: (n, 2), moments: (n, 3) of the blobs. gap: (n,) px to the next blob's
    centre.
    """
    n = len(centers)
    starts, reach, good = np.zeros((n, 10)), np.zeros(n), np.zeros(n, dtype=np.bool_)
    for i in range(n):
        good[i] = _one(plane, centers[i], moments[i], gap[i], starts[i])
        if good[i]:
            a11, a12, a22 = starts[i, 2], starts[i, 3], starts[i, 4]
            longest = _longest(a22, a12, a11) / sqrt(a11 * a22 - a12 * a12)
            # six blur widths hold the edge even where the start misjudges it (measured: less loses blurred dots);
            # a third of the dot's size determines the slope of the light
            wide = max(3.0, 6.0 * starts[i, 5], 0.7 * longest)
            reach[i] = min(wide, max(0.5 * gap[i] - longest, 1.5))
    return starts, reach, good


@compiled()
def _longest(xx, xy, yy):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Root of the larger eigenvalue."""
    return sqrt(0.5 * (xx + yy + sqrt((xx - yy) ** 2 + 4.0 * xy * xy)))


@compiled()
def _ring(plane, cx, cy, radius):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Median of 16 pixels on a circle, without those outside the image."""
    values = np.empty(16)
    count = 0
    for k in range(16):
        x, y = round(cx + radius * cos(k * pi / 8)), round(cy + radius * sin(k * pi / 8))
        if 0 <= x < plane.shape[1] and 0 <= y < plane.shape[0]:
            value, place = plane[y, x], count
            while place > 0 and values[place - 1] > value:
                values[place] = values[place - 1]
                place -= 1
            values[place] = value
            count += 1
    return 0.5 * (values[(count - 1) // 2] + values[count // 2]) if count >= 6 else np.nan


@compiled()
def _one(plane, center, moment, gap, start):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    cx, cy = center
    longest = 2.0 * _longest(moment[0], moment[1], moment[2])
    background = _ring(plane, cx, cy, min(1.5 * longest + 2.0, max(0.5 * gap, longest)))
    half = ceil(longest + 1.0)
    ix, iy = round(cx), round(cy)
    left, right = max(ix - half, 1), min(ix + half, plane.shape[1] - 2)
    top, bottom = max(iy - half, 1), min(iy + half, plane.shape[0] - 2)
    core, weight = 0.0, 0.0
    for y in range(max(iy - 1, top), min(iy + 1, bottom) + 1):
        for x in range(max(ix - 1, left), min(ix + 1, right) + 1):
            core += plane[y, x]
            weight += 1.0
    if weight == 0.0 or not core / weight < background:
        return False
    core /= weight
    level = 0.5 * (core + background)
    area = sx = sy = sxx = sxy = syy = steepest = 0.0
    for y in range(top, bottom + 1):
        for x in range(left, right + 1):
            dx, dy = x - cx, y - cy
            if dx * dx + dy * dy > (longest + 1.0) ** 2 or plane[y, x] >= level:
                continue
            area += 1.0
            sx += dx
            sy += dy
            sxx += dx * dx
            sxy += dx * dy
            syy += dy * dy
            across, down = plane[y, x + 1] - plane[y, x - 1], plane[y + 1, x] - plane[y - 1, x]
            steepest = max(steepest, 0.25 * (across * across + down * down))
    if area < 5.0:
        return False
    mx, my = sx / area, sy / area
    xx, xy, yy = sxx / area - mx * mx + 1 / 12, sxy / area - mx * my, syy / area - my * my + 1 / 12
    determinant = xx * yy - xy * xy
    if determinant < 1e-3 or mx * mx + my * my > longest * longest:
        return False
    start[0], start[1] = cx + mx, cy + my
    # the boundary of an ellipse with second moments M is xᵀ M⁻¹ x = 4
    start[2], start[3], start[4] = yy / (4 * determinant), -xy / (4 * determinant), xx / (4 * determinant)
    contrast = background - core
    start[5] = min(max(contrast / (sqrt(2 * pi) * sqrt(steepest) + 1e-12), 0.4), longest)
    start[6], start[7] = background, -contrast
    return True
