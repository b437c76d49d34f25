"""Fit of the visible part of a mark that is occluded by a wire, a glint or a scratch.

Outlier weights of single pixels exclude the inside of a wire from a fit, but not its blurred flanks: each of their
pixels is within the noise, but together they shift the fit. An occlusion shows in residuals that neighbouring pixels
share. If their mean over 3 × 3 pixels is larger than noise and a small shift of the mark explain, it and the pixels
around it (within the blur) are excluded and the rest is fitted. The allowed shift decreases from step to step, since
the initial position may be wrong.

The remaining errors are shared by the pixels of one part of the rim. Different parts are independent, so that the
changes of the centre when each part is left out (the jackknife) give its uncertainty, whatever the correlation within a
part.
"""
# mypy: disallow-untyped-defs=false, disallow-untyped-calls=false
# ruff: noqa: ANN001, ANN202 - numba infers the types

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.compilation import compiled
from evaluator.tracking.refinement.kernels import (
    AMPLITUDE,
    BASE,
    COV_XY,
    INSIDE,
    PIXELS,
    RESIDUAL,
    SLOPE_X,
    SLOPE_Y,
    USED,
    VAR_X,
    VAR_Y,
    X,
    Y,
    invert_leading,
    solve,
)
from evaluator.tracking.refinement.motion_blur import path_of
from evaluator.tracking.refinement.occluded_pixels import (
    ALONG_X,
    ALONG_Y,
    LEFT,
    PROFILE,
    cover,
    model,
    scale_of,
    stands_out,
)

Array = NDArray[np.float64]

# px by which the mark may be off during the fit; the last value is the irregularity of the edges of real marks.
OFF_PX = (0.4, 0.3, 0.2, 0.15, 0.1, 0.05, 0.05)
# Share of the information on a mark's centre that an occlusion must take before the occluded pixels are excluded.
# Chance and the blocks of a codec take less.
NOTABLE = 0.03
SLOPING = 12.0  # decrease of the squared residuals, in variances, that two slopes cause by chance once in 400 frames
SLOPES_AT = 2  # step at which slopes are tried: the occluded pixels are known approximately by then
# Share of the shift by a slope that may remain after correction, because light is curved: the reflection of a lamp,
# over the distance in which it fades.
BENT = 0.2
PARTS = 12  # of the rim: 30 degrees each, the width that a thin wire affects on a small mark
FEW_SQUARES = 1.5  # factor for a variance that is estimated from about six squares only
LEAST_PIXELS = 12.0  # fewest pixels to which a disc is fitted
FLAT = 1e-3  # of the steepest slope: flatter pixels determine only amplitude and base, and a quarter of them suffices


def fit_uncovered(
    luma: NDArray[np.unsignedinteger], row_origin: int, row_step: int, fitted: Array, disc: Array,
    table: NDArray[np.float32], noise: Array, result: Array, shown: NDArray[np.bool_] | None,
    core: tuple[float, float], least: float,
) -> tuple[float, float]:  # fmt: skip
    """Fit a disc to its visible pixels.

    fitted: result of `kernels.fit_disc`; its slopes are kept. disc, table, noise: as in `kernels.fit_disc`. result:
    filled as by `kernels.fit_disc`, but with variances from the parts of the rim and the residual of the visible
    pixels. shown: (shape of luma), set to False where the mark is occluded; or None. core: CORE or CORE_EXPECTED.
    least: share of the information on the centre in seemingly occluded pixels, from which the fit is done.

    Returns this share (0 if no residual reaches core), and the share that is occluded in the end: 0 if no fit was done,
    1 if too few pixels are left to fit; result is not written in these two cases.
    """
    top, bottom, left, right = _window(luma.shape, row_origin, row_step, fitted, disc)
    if bottom - top < 5 or right - left < 5:
        return 0.0, 0.0
    # float64, so that the kernels are compiled once for all sample types of recordings.
    window = luma[top:bottom, left:right].astype(np.float64)
    place, covered = (row_origin + row_step * float(top), float(row_step), left), np.zeros(window.shape, np.bool_)
    seeming, share = _fit_window(window, place, fitted, disc, table, noise, result, covered, core, least)
    if shown is not None and 0.0 < share < 1.0:
        shown[top:bottom, left:right] &= ~covered
    return seeming, share


def _fit_window(
    luma: Array, place: tuple[float, float, int], fitted: Array, disc: Array, table: NDArray[np.float32], noise: Array,
    result: Array, covered: NDArray[np.bool_], core: tuple[float, float], least: float,
) -> tuple[float, float]:  # fmt: skip
    """`fit_uncovered` in a window; place: y of its first row, step of its rows, its first column.

    Its kernels are compiled separately, most of them only if an occlusion is found: as one kernel they took a third of
    the tracker's compilation time.
    """
    state = np.zeros(6)
    state[: BASE + 1], state[4:] = fitted[: BASE + 1], fitted[SLOPE_X : SLOPE_Y + 1]
    planes, used, path = np.zeros((6, *luma.shape)), np.zeros(luma.shape, np.bool_), path_of(disc)
    model(luma, *place, state, disc, table, path, planes, used)
    if not stands_out(planes, used, fitted.item(AMPLITUDE), noise.item(0), core):
        return 0.0, 0.0
    scale = scale_of(planes, used, noise.item(0))
    # The occlusion as it appears before the first step, with the last of the shifts.
    seeming = cover(planes, used, scale, OFF_PX[-1], covered)
    if seeming < least:
        return seeming, 0.0
    parts = Parts(np.zeros((PARTS, 6, 6)), np.zeros((PARTS, 6)), np.zeros((6, 6)), np.zeros(6))
    size, level_x, level_y, share = 4, fitted.item(X), fitted.item(Y), seeming
    weight = squares = count = 0.0
    for step, off_px in enumerate(OFF_PX):
        model(luma, *place, state, disc, table, path, planes, used)
        share = cover(planes, used, scale, off_px, covered)
        split = step == len(OFF_PX) - 1
        weight, squares, count = _pull(
            planes, used, covered, state, noise, *place, split, parts.products, parts.pulls, np.ones(6)
        )
        for _ in range(2):
            if weight < LEAST_PIXELS or not parts.step(size):
                return seeming, 1.0
            if size == 6 or step != SLOPES_AT or not parts.sloping():
                break
            size, level_x, level_y = 6, state.item(X) + parts.move.item(X), state.item(Y) + parts.move.item(Y)
        length = math.sqrt(parts.move.item(X) ** 2 + parts.move.item(Y) ** 2)
        shorten = min(1.0, (0.35 * disc.item(0) + disc.item(1)) / max(length, 1e-12))
        state[:2] += shorten * parts.move[:2]
        state[2:size] += parts.move[2:size]
    invert_leading(parts.normal, size, np.zeros(6), result)
    residual = squares / max(weight - size, 1.0)
    scatter = FEW_SQUARES * parts.jackknife(size)
    widen = max(scatter / (result.item(VAR_X) + result.item(VAR_Y)), residual, 1.0)
    result[X : BASE + 1], result[SLOPE_X : SLOPE_Y + 1] = state[: BASE + 1], state[4:]
    off_x, off_y = (BENT * (state.item(X) - level_x), BENT * (state.item(Y) - level_y)) if size == 6 else (0.0, 0.0)
    result[VAR_X], result[VAR_Y] = widen * result[VAR_X] + off_x * off_x, widen * result[VAR_Y] + off_y * off_y
    result[COV_XY] = widen * result[COV_XY] + off_x * off_y
    result[RESIDUAL], result[USED], result[PIXELS], result[INSIDE] = residual, weight / count, weight, fitted[INSIDE]
    return seeming, share


@dataclass(frozen=True)
class Parts:
    """Normal equations of each part of the rim: products (PARTS, 6, 6) and right hand sides, pulls (PARTS, 6).

    normal: (6, 6), their sum, with its Cholesky factor in the lower triangle; move: (6,), the resulting step.
    """

    products: Array
    pulls: Array
    normal: Array
    move: Array

    def step(self, size: int, without: int = -1) -> bool:
        """Solve for the step of the first `size` unknowns from all parts but one (-1: from all); False if singular."""
        return bool(_step(self.products, self.pulls, without, size, self.normal, self.move, np.empty(6)))

    def sloping(self) -> bool:
        """Whether the background slopes: whether two slopes reduce the squares by SLOPING."""
        trial, fall = replace(self, move=np.zeros(6)), 0.0
        for size in (4, 6):
            if not trial.step(size):
                return False
            fall = float(self.pulls.sum(axis=0)[:size] @ trial.move[:size]) - fall
        return fall > SLOPING

    def jackknife(self, size: int) -> float:
        """Sum of squares, px², of the changes of the centre when each part of the rim is left out."""
        total = 0.0
        for part in range(PARTS):
            if self.products[part, 0, 0] + self.products[part, 1, 1] > 0.0:
                if not self.step(size, part):
                    return math.inf
                total += self.move.item(X) ** 2 + self.move.item(Y) ** 2
        return total


def _window(
    shape: tuple[int, ...], row_origin: int, row_step: int, fitted: Array, disc: Array
) -> tuple[int, int, int, int]:
    """Rows and columns (first, and one beyond the last) of the pixels used, and one more on every side."""
    x, y = fitted.item(X), fitted.item(Y)
    if not math.isfinite(x):
        return 0, 0, 0, 0
    reach = disc.item(4) / math.sqrt(1.0 - math.hypot(disc.item(2), disc.item(3)))
    rows, columns = shape
    top = max(math.ceil((y - reach - row_origin) / row_step) - 1, 0)
    bottom = max(min(math.floor((y + reach - row_origin) / row_step) + 1, rows - 1) + 1, top)
    left = max(math.ceil(x - reach) - 1, 0)
    return top, bottom, left, max(min(math.floor(x + reach) + 1, columns - 1) + 1, left)


@compiled(nogil=True)
def _pull(planes, used, covered, state, noise, top_y, row_step, left, split, products, pulls, row):  # noqa: C901 - one loop
    """Fill the normal equations and their right hand side; returns weights, their squares and the pixels.

    split: whether the equations are summed for each part of the rim separately. row: (n,) ones, work array.
    """
    weight = squares = count = steepest = 0.0
    for m in range(PARTS):
        for n in range(6):
            pulls[m, n] = 0.0
            for k in range(6):
                products[m, n, k] = 0.0
    for j in range(used.shape[0]):
        for i in range(used.shape[1]):
            steepest = max(steepest, planes[ALONG_X, j, i] ** 2 + planes[ALONG_Y, j, i] ** 2)
    certain, softness = 1.0 / noise[0], 1.0 / (noise[0] * noise[1] * noise[1])
    flat, part = FLAT * steepest, 0
    for j in range(used.shape[0]):
        for i in range(used.shape[1]):
            if covered[j, i] or not used[j, i]:
                continue
            along_x, along_y, residual = planes[ALONG_X, j, i], planes[ALONG_Y, j, i], planes[LEFT, j, i]
            if (i & 1 or j & 1) and along_x * along_x + along_y * along_y < flat:
                continue
            beyond = residual * residual * softness
            w = 1.0 / (1.0 + beyond * beyond)
            row[0], row[1], row[2] = along_x, along_y, planes[PROFILE, j, i]
            row[4], row[5] = left + i - state[0], top_y + row_step * j - state[1]
            if split:
                part = int((math.atan2(row[5], row[4]) / (2.0 * math.pi) + 1.0) * PARTS) % PARTS
            count, weight = count + 1.0, weight + w
            squares += w * residual * residual * certain
            for m in range(6):
                scaled = w * certain * row[m]
                pulls[part, m] += scaled * residual
                for n in range(m, 6):
                    products[part, m, n] += scaled * row[n]
    return weight, squares, count


@compiled(nogil=True)
def _step(products, pulls, without, size, normal, move, right):
    """Solve for the step from all parts of the rim except one (-1: from all); False if singular. Fills normal, too."""
    for m in range(size):
        right[m] = 0.0
        for n in range(m, size):
            normal[m, n] = 0.0
        for part in range(PARTS):
            if part != without:
                right[m] += pulls[part, m]
                for n in range(m, size):
                    normal[m, n] += products[part, m, n]
    return solve(normal, right, move, size)
