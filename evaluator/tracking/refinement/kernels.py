"""Compiled inner loops: sub-pixel position of a disc in the luma.

Image coordinates, px. Luma row j lies at y = row_origin + row_step·j. Arguments and results are numbers; disc.py and
follow.py give their meaning.

Functions called by a kernel become part of it (forceinline; the loop over the pixels is optimised separately first).
Otherwise copies of a function that are optimised within different callers would sum in different orders, and which copy
runs would depend on what was compiled and what came from numba's cache. Work arrays come from the caller, and loops and
comparisons replace calls of numpy and Python: each np.zeros, slice, sum, min and max in a kernel takes numba about as
long to compile as the loop around it.
"""
# mypy: disallow-untyped-defs=false, disallow-untyped-calls=false
# ruff: noqa: ANN001, ANN201, ANN202, FURB136 - numba infers the types; comparisons compile sooner than min and max

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from calibration.compilation import compiled
from evaluator.tracking.refinement.motion_blur import mean_over, path_of

# Indices of the results of `fit_disc`.
X, Y, AMPLITUDE, BASE, VAR_X, VAR_Y, COV_XY, RESIDUAL, USED, INSIDE, PIXELS, SLOPE_X, SLOPE_Y = range(13)
RESULTS = 13
UNKNOWNS = 6  # centre, amplitude, base, two slopes
WORK_ROWS = UNKNOWNS + 3  # normal equations, then state, right hand side and step

Array = NDArray[np.float64]

single = np.float32
# Floating-point options that allow the sums of a row to be vectorised; NaN is preserved.
SUMS = {"contract", "arcp", "nsz", "reassoc"}
LANES = 8  # pixels that current processors handle at once


def fit_disc(
    luma: NDArray[np.unsignedinteger], row_origin: int, row_step: int, start: Array, sloping: bool, disc: Array,
    table: NDArray[np.float32], noise: Array, result: Array,
) -> None:  # fmt: skip
    """Fit centre, amplitude and base of a blurred disc to the luma by iteratively reweighted least squares.

    start: x, y, amplitude, base. sloping: whether the background may slope; its two slopes are then fitted as well.
    disc: radius, blur, e1, e2, outer radius of the pixels used, smear along x and y (px during the exposure), entries
    of the table per px², shade along x and y (as `Disc` has it). table: of the disc against the square of the radius,
    its profile and its slope over the radius. noise: variance, softness of the outlier weights in sigmas. result: see
    the names at the top.
    """
    path, work = path_of(disc), np.zeros((WORK_ROWS, UNKNOWNS))
    cut = _fit_disc(luma, row_origin, row_step, start, sloping, disc, table, path, noise, result, work)
    if cut:
        count = result.item(PIXELS)
        result[INSIDE] = count / max(_pixels_without_border(row_origin, row_step, result, disc), count)


@compiled(nogil=True)
def _fit_disc(luma, row_origin, row_step, start, sloping, disc, table, path, noise, result, work):
    """Do what `fit_disc` does except for INSIDE; returns whether the frame's border cuts the fitted pixels.

    path: see `path_of`, or None. work: (WORK_ROWS, UNKNOWNS), zeros. The kernel is the same with and without slopes,
    with one loop over the pixels for each.
    """
    size = 6 if sloping else 4
    normal, state, right, move = work, work[UNKNOWNS], work[UNKNOWNS + 1], work[UNKNOWNS + 2]
    for m in range(4):
        state[m] = start[m]
    squares = weight = count = 0.0
    reach = disc[4] / math.sqrt(1.0 - math.sqrt(disc[2] * disc[2] + disc[3] * disc[3]))
    for _ in range(12):
        window = window_around(luma, row_origin, row_step, state, reach)
        if sloping:
            squares, weight, count = accumulate(
                luma, row_origin, row_step, state, state, window, disc, table, path, noise, normal, right
            )
        else:
            squares, weight, count = accumulate(
                luma, row_origin, row_step, state, None, window, disc, table, path, noise, normal, right
            )
        if count < 6.0 or not solve(normal, right, move, size):
            result[X] = result[Y] = result[RESIDUAL] = np.nan
            return False
        # Beyond the blurred edge the linearization is meaningless.
        length = math.sqrt(move[0] * move[0] + move[1] * move[1])
        longest = 0.35 * disc[0] + disc[1]
        shorten = longest / length if length > longest else 1.0
        state[0] += shorten * move[0]
        state[1] += shorten * move[1]
        for m in range(2, size):
            state[m] += move[m]
        # The next step would be at most 1/20 as long, by the error of the linearization over this one.
        if length < 0.02:
            break
    invert_leading(normal, size, right, result)
    result[X], result[Y], result[AMPLITUDE], result[BASE] = state[0], state[1], state[2], state[3]
    result[SLOPE_X], result[SLOPE_Y] = state[4], state[5]
    freedom = weight - size
    result[RESIDUAL] = squares / freedom if freedom > 1.0 else squares
    result[USED], result[INSIDE], result[PIXELS] = weight / count, 1.0, count
    (rows, columns), x, y = luma.shape, state[0], state[1]
    within = x - reach > 0.0 and x + reach < columns - 1.0
    return not (within and y - reach > row_origin and y + reach < row_origin + row_step * (rows - 1.0))


@compiled(nogil=True, forceinline=True)
def window_around(luma, row_origin, row_step, state, reach):
    """Rows and columns (first, and one beyond the last) of the frame within reach of a centre, in whole lanes."""
    rows, columns = luma.shape
    left, right = math.ceil(state[0] - reach), math.floor(state[0] + reach) + 1
    left, right = left if left > 0 else 0, right if right < columns else columns
    top = math.ceil((state[1] - reach - row_origin) / row_step)
    bottom = math.floor((state[1] + reach - row_origin) / row_step) + 1
    top, bottom = top if top > 0 else 0, bottom if bottom < rows else rows
    # Whole lanes, if the frame is wide enough: pixels beyond the disc have no weight.
    whole = left + (right - left + LANES - 1) // LANES * LANES
    return top, bottom, left, whole if left < right and whole <= columns else right


@compiled(nogil=True, forceinline=True, fastmath=SUMS)
def accumulate(luma, row_origin, row_step, state, slopes, window, disc, table, path, noise, normal, right):  # noqa: PLR0915 - one loop
    """Fill the upper triangle of the normal equations of `fit_disc` at a state, from the pixels in a window.

    path: see `path_of`, or None without motion blur; a separate loop is compiled for None, which nearly all frames use.
    Returns weighted squares, sum of outlier weights, pixels used. One loop in single precision and without branches
    within a row, so that it is vectorised; the rounding error, 1e-7 of the sums, is negligible.
    """
    top, bottom, first, last = window
    x, y = state[0] - disc[1] * disc[1] * disc[8], state[1] - disc[1] * disc[1] * disc[9]  # as `Disc` has it
    amplitude, base = single(state[2]), single(state[3])
    tilt_x, tilt_y = single(state[4]), single(state[5])
    outer2, per_px2, end = single(disc[4] * disc[4]), single(disc[7]), single(len(table) - 1)
    stretch_x, stretch_y, e2 = single(1.0 + disc[2]), single(1.0 - disc[2]), single(disc[3])
    shade_x, shade_y = single(disc[8]), single(disc[9])
    certain, softness = single(1.0 / noise[0]), single(1.0 / (noise[0] * noise[1] * noise[1]))
    edge = 3.5 * math.sqrt(disc[1] * disc[1] + (disc[5] * disc[5] + disc[6] * disc[6]) / 12.0)
    inner = disc[0] - edge if disc[0] > edge else 0.0
    flat_in, flat_out = single(inner * inner), single((disc[0] + edge) * (disc[0] + edge))
    none, half, one, two = single(0.0), single(0.5), single(1.0), single(2.0)
    xx = xy = xp = xb = yy = yp = yb = pp = pb = bb = rx = ry = rp = rb = squares = count = none
    xs = ys = ps = bs = rs = xt = yt = pt = bt = rt = ss = st = tt = none
    for j in range(top, bottom):
        dy = single(row_origin + row_step * j - y)
        across, high = two * e2 * dy, stretch_y * dy * dy
        thin = none if j & 1 else one
        for i in range(first, last):
            dx = single(i - x)
            square = (stretch_x * dx + across) * dx + high
            # Flat parts determine only amplitude and base: a quarter of their pixels suffices.
            flat = (square < flat_in) | (square > flat_out)
            counts = (none if i & 1 else thin) if flat else one
            counts = counts if square <= outer2 else none
            outward_x, outward_y = stretch_x * dx + e2 * dy, e2 * dx + stretch_y * dy
            if path is None:
                place = square * per_px2 + half
                k = np.int32(place if place < end else end)
                p, pull_x, pull_y = table[k, 0], table[k, 1] * outward_x, table[k, 1] * outward_y
            elif counts > none:
                p, pull_x, pull_y = mean_over(path, table, per_px2, dx, dy, outward_x, outward_y)
            else:
                p, pull_x, pull_y = none, none, none
            light = one + shade_x * dx + shade_y * dy
            gx, gy = -amplitude * (light * pull_x + shade_x * p), -amplitude * (light * pull_y + shade_y * p)
            p *= light
            residual = single(luma[j, i]) - base - amplitude * p
            if slopes is not None:
                residual -= tilt_x * dx + tilt_y * dy
            beyond = residual * residual * softness
            w = counts / (one + beyond * beyond)
            wx, wy, wp, wr = w * gx, w * gy, w * p, w * residual
            xx, xy, xp, xb, yy, yp = xx + wx * gx, xy + wx * gy, xp + wx * p, xb + wx, yy + wy * gy, yp + wy * p
            yb, pp, pb, bb = yb + wy, pp + wp * p, pb + wp, bb + w
            rx, ry, rp, rb = rx + wr * gx, ry + wr * gy, rp + wr * p, rb + wr
            squares, count = squares + wr * residual, count + counts
            if slopes is not None:
                ws, wt = w * dx, w * dy
                xs, ys, ps, bs, rs = xs + ws * gx, ys + ws * gy, ps + ws * p, bs + ws, rs + ws * residual
                xt, yt, pt, bt, rt = xt + wt * gx, yt + wt * gy, pt + wt * p, bt + wt, rt + wt * residual
                ss, st, tt = ss + ws * dx, st + ws * dy, tt + wt * dy
    normal[0, 0], normal[0, 1], normal[0, 2], normal[0, 3], normal[1, 1] = xx, xy, xp, xb, yy
    normal[1, 2], normal[1, 3], normal[2, 2], normal[2, 3], normal[3, 3] = yp, yb, pp, pb, bb
    right[0], right[1], right[2], right[3] = rx, ry, rp, rb
    if slopes is not None:
        normal[0, 4], normal[1, 4], normal[2, 4], normal[3, 4], normal[4, 4] = xs, ys, ps, bs, ss
        normal[0, 5], normal[1, 5], normal[2, 5], normal[3, 5], normal[4, 5] = xt, yt, pt, bt, st
        normal[5, 5], right[4], right[5] = tt, rs, rt
    size = 4 if slopes is None else 6
    for m in range(size):
        right[m] *= certain
        for n in range(m, size):
            normal[m, n] *= certain
    return float(certain * squares), float(bb), float(count)


def _pixels_without_border(row_origin: int, row_step: int, result: Array, disc: Array) -> int:
    """Count the pixels that `accumulate` would use around a fitted centre if the frame had no border."""
    x, y, (radius, blur, e1, e2, outer, smear_x, smear_y) = result.item(X), result.item(Y), disc[:7].tolist()
    reach = outer / math.sqrt(1.0 - math.hypot(e1, e2))
    rows = range(math.ceil((y - reach - row_origin) / row_step), math.floor((y + reach - row_origin) / row_step) + 1)
    j, i = np.array(rows)[:, None], np.arange(math.ceil(x - reach), math.floor(x + reach) + 1)
    dx, dy = i - x, row_origin + row_step * j - y
    square = (1.0 + e1) * dx * dx + 2.0 * e2 * dx * dy + (1.0 - e1) * dy * dy
    edge = 3.5 * math.sqrt(blur * blur + (smear_x * smear_x + smear_y * smear_y) / 12.0)
    flat = (square < max(radius - edge, 0.0) ** 2) | (square > (radius + edge) ** 2)
    return int(np.count_nonzero((square <= outer * outer) & ~(flat & ((i & 1) | (j & 1)).astype(bool))))


@compiled(nogil=True, forceinline=True)
def solve(normal, right, move, size):
    """Solve the symmetric system of a size by Cholesky in place of normal's lower triangle; False where singular."""
    for i in range(size):
        for j in range(i + 1):
            total = normal[j, i]
            for k in range(j):
                total -= normal[i, k] * normal[j, k]
            if i == j:
                if total <= 1e-12 * (abs(normal[i, i]) + 1e-300):
                    return False
                normal[i, i] = math.sqrt(total)
            else:
                normal[i, j] = total / normal[j, j]
    for i in range(size):
        total = right[i]
        for k in range(i):
            total -= normal[i, k] * move[k]
        move[i] = total / normal[i, i]
    for i in range(size - 1, -1, -1):
        total = move[i]
        for k in range(i + 1, size):
            total -= normal[k, i] * move[k]
        move[i] = total / normal[i, i]
    return True


@compiled(nogil=True, forceinline=True)
def invert_leading(lower, size, column, result):
    """Covariance of the first two unknowns from the Cholesky factor; column: to work in."""
    var_x = var_y = cov = 0.0
    for i in range(size):
        total = 1.0 if i == 0 else 0.0
        for k in range(i):
            total -= lower[i, k] * column[k]
        column[i] = total / lower[i, i]
        var_x += column[i] * column[i]
    # The column of the second unknown is zero in its first row; the first one is still needed for the covariance.
    for i in range(1, size):
        total = 1.0 if i == 1 else 0.0
        for k in range(1, i):
            total -= lower[i, k] * lower[0, k]
        lower[0, i] = total / lower[i, i]
        var_y += lower[0, i] * lower[0, i]
        cov += column[i] * lower[0, i]
    result[VAR_X], result[VAR_Y], result[COV_XY] = var_x, var_y, cov


def interior_slope(
    luma: NDArray[np.unsignedinteger], row_origin: int, row_step: int, x: float, y: float, radius: float,
    slope: Array,
) -> None:  # fmt: skip
    """Fit a plane to the luma within a radius of (x, y); fills slope with its slopes along x and y, levels a px."""
    _interior_slope(luma, row_origin, row_step, float(x), float(y), radius, slope, np.zeros((5, 3)))


@compiled(nogil=True)
def _interior_slope(luma, row_origin, row_step, x, y, radius, slope, work):
    rows, columns = luma.shape
    normal, right, move = work, work[3], work[4]
    for j in range(
        math.ceil((y - radius - row_origin) / row_step), math.floor((y + radius - row_origin) / row_step) + 1
    ):
        dy = row_origin + row_step * j - y
        for i in range(math.ceil(x - radius), math.floor(x + radius) + 1):
            dx = i - x
            if dx * dx + dy * dy > radius * radius or j < 0 or j >= rows or i < 0 or i >= columns:
                continue
            value = float(luma[j, i])
            normal[0, 0] += 1.0
            normal[0, 1] += dx
            normal[0, 2] += dy
            normal[1, 1] += dx * dx
            normal[1, 2] += dx * dy
            normal[2, 2] += dy * dy
            right[0] += value
            right[1] += dx * value
            right[2] += dy * value
    if normal[0, 0] < 12.0 or not solve(normal, right, move, 3):
        slope[0] = slope[1] = np.nan
        return
    slope[0], slope[1] = move[1], move[2]
