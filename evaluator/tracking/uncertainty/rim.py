"""Repeating errors of a mark, from deviations of its rim from the disc.

For a mark of known shape, the deviation of the rim from the disc is a sum of harmonics of the direction. The first is
the fitted shift; the higher ones are zero except for errors. A disturbance of a part of the rim (a wire, an error of
the learnt shape, codec blocks) has an approximately flat spectrum, so that the higher harmonics show the size of the
error in the first, even if it repeats in every frame. With noise alone, all have the variance of the centre.
"""
# mypy: disallow-untyped-defs=false, disallow-untyped-calls=false
# ruff: noqa: FURB136 - comparisons compile sooner than min and max

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from calibration.compilation import compiled
from evaluator.tracking.refinement.motion_blur import mean_over, path_of

Array = NDArray[np.float64]

# Harmonics in use. The second is also changed by perspective; beyond the fifth a codec keeps little of a mark of 5 px
# radius. Differences between a smear and its model are even and shift nothing: for smeared marks the fourth is left
# out.
FIRST, LAST, SYMMETRIC = 3, 5, 4
SQUARES = 6.0  # squares per frame: cosines and sines of the harmonics
ODD = 2.8  # ratio of the mean square to its usual value beyond which a frame is disturbed; by chance in one of 100
# Ratio of all harmonics to the odd ones from which the shape is not round: a square or oblong mark has even ones only,
# which shift nothing. A disturbance has a flat spectrum; its ratio is so large in 3 of 100 cases (F(2, 4)).
ANGULAR = 4.0
LATELY = 20.0  # frames over which the usual values are averaged
SURE = 3.0  # standard errors of this mean above which noise alone does not explain it
# Factor n/(n - 2) for a variance that is estimated from n squares only: if frames repeat each other, or a single one is
# disturbed, there are no more.
FEW_SQUARES = SQUARES / (SQUARES - 2.0)


class Rim:
    """Variance of a centre, px², from the rim of a mark, beyond that of the noise of its pixels."""

    def __init__(self) -> None:
        """Start with none."""
        self.extra_px2 = 0.0
        self._usual, self._count = (0.0, 0.0), 0.0  # of all harmonics, of the odd ones; frames

    def note(self, power_px2: tuple[float, float], own_px2: float) -> None:
        """Update with a frame: `rim_power`, and the variance of the fit per axis; NaN is ignored."""
        if not (math.isfinite(power_px2[0]) and math.isfinite(own_px2)):
            return
        before, self._count = self._usual, min(self._count + 1.0, LATELY)
        every, odd = (old + (new - old) / self._count for old, new in zip(before, power_px2, strict=True))
        self._usual = every, odd
        angular = self._usual[0] > ANGULAR * self._usual[1]
        power, usual = power_px2[angular], self._usual[angular]
        disturbed = power > ODD * max(before[angular], own_px2)
        chance = 1.0 + SURE * math.sqrt(2.0 / (SQUARES * self._count))
        shown = power if disturbed else usual if usual > chance * own_px2 else 0.0
        self.extra_px2 = FEW_SQUARES * max(shown - own_px2, 0.0)


def rim_power(
    luma: NDArray[np.unsignedinteger], row_origin: int, row_step: int, result: Array, disc: Array,
    table: NDArray[np.float32], noise: Array,
) -> tuple[float, float]:  # fmt: skip
    """Mean square, px², of the rim's harmonics FIRST to LAST about a fitted disc, and of the odd ones; NaN without one.

    Arguments as of `kernels.fit_disc`, after the fit.
    """
    sums = np.zeros((2, LAST + 1))
    every, odd = _rim_power(luma, row_origin, row_step, result, disc, table, path_of(disc), noise, sums)
    return float(every), float(odd)


@compiled(nogil=True)
def _rim_power(luma, row_origin, row_step, result, disc, table, path, noise, sums):  # noqa: ANN001, ANN202 - numba infers the types
    rows, columns = luma.shape
    x, y, amplitude, base, tilt_x, tilt_y = result[0], result[1], result[2], result[3], result[11], result[12]
    radius, blur2, e1, e2, smear_x, smear_y = disc[0], disc[1] * disc[1], disc[2], disc[3], disc[5], disc[6]
    x, y = x - blur2 * disc[8], y - blur2 * disc[9]
    smear2 = smear_x * smear_x + smear_y * smear_y
    edge = 3.5 * math.sqrt(blur2 + smear2 / 12.0)
    # Comparisons instead of min, max and power, each of which takes numba as long to compile as a loop.
    inner, outer = radius - edge if radius - edge > 0.5 else 0.5, radius + edge if radius + edge < disc[4] else disc[4]
    inner2, outer2 = inner * inner, outer * outer
    reach = math.sqrt(outer2 / (1.0 - math.sqrt(e1 * e1 + e2 * e2)))
    certain = 1.0 / (noise[0] * noise[1] * noise[1])
    total = 0.0
    top, bottom = math.ceil((y - reach - row_origin) / row_step), math.floor((y + reach - row_origin) / row_step) + 1
    left, right = math.ceil(x - reach), math.floor(x + reach) + 1
    left, right = left if left > 0 else 0, right if right < columns else columns
    for j in range(top if top > 0 else 0, bottom if bottom < rows else rows):
        dy = row_origin + row_step * j - y
        for i in range(left, right):
            dx = i - x
            square = (1.0 + e1) * dx * dx + 2.0 * e2 * dx * dy + (1.0 - e1) * dy * dy
            if square < inner2 or square > outer2:
                continue
            length = math.sqrt(dx * dx + dy * dy)
            cos, sin, light = dx / length, dy / length, 1.0 + disc[8] * dx + disc[9] * dy
            if path is not None:
                outward_x, outward_y = (1.0 + e1) * dx + e2 * dy, e2 * dx + (1.0 - e1) * dy
                p, pull_x, pull_y = mean_over(path, table, disc[7], dx, dy, outward_x, outward_y)
                steep = -amplitude * light * (pull_x * cos + pull_y * sin)
            else:
                k = int(square * disc[7] + 0.5)
                k = k if k < len(table) else len(table) - 1
                p, steep = table[k, 0], -amplitude * light * table[k, 1] * math.sqrt(square)
            residual = luma[j, i] - base - amplitude * light * p - tilt_x * dx - tilt_y * dy
            beyond = residual * residual * certain
            weight = 1.0 / (1.0 + beyond * beyond)
            total += weight * steep * steep
            pull, cos_m, sin_m = weight * steep * residual, cos, sin
            for m in range(2, LAST + 1):
                cos_m, sin_m = cos_m * cos - sin_m * sin, sin_m * cos + cos_m * sin
                sums[0, m] += pull * cos_m
                sums[1, m] += pull * sin_m
    if total <= 0.0:
        return np.nan, np.nan
    odd, even = 0.0, 0.0
    for m in range(FIRST, LAST + 1):
        power = 2.0 * (sums[0, m] * sums[0, m] + sums[1, m] * sums[1, m]) / (total * total)
        if m == SYMMETRIC:
            even += power
        else:
            odd += power
    odd_mean = odd / (LAST - FIRST)
    return (odd + even) / (LAST - FIRST + 1) if path is None else odd_mean, odd_mean
