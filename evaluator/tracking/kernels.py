"""Compiled inner loops: where a colour is in a window, and where exactly a disc is in the luma.

Picture frame, px. Luma row j lies at y = row_origin + row_step·j; a chroma sample covers across × down luma samples.
Numbers only in and out; the meaning is in disc.py and follow.py.
"""
# mypy: disallow-untyped-defs=false, disallow-untyped-calls=false
# ruff: noqa: ANN001, ANN201 - numba infers the types

from __future__ import annotations

import math

import numpy as np
from numba import njit

# Places of the numbers that `fit_disc` gives.
X, Y, AMPLITUDE, BASE, VAR_X, VAR_Y, COV_XY, RESIDUAL, USED, INSIDE, PIXELS, SLOPE_X, SLOPE_Y = range(13)
RESULTS = 13

# Liberties of floating point that keep NaN and order: what a fit loses by them is below its rounding.
QUICK = {"contract", "arcp", "nsz"}

# Places of the numbers that `color_window` gives.
AREA, CENTER_X, CENTER_Y, STRENGTH, CLIPPED = range(5)


@njit(cache=True, nogil=True)
def color_window(u, v, cell, x, y, half, color, found):
    """Weigh the pixels of a colour in a square window around (x, y); fills found.

    cell: width and height in px that a chroma sample covers, and where the first one's centre lies (x, y). color: see
    `is_color`. found: area of the pixels that have the colour, px²; their centre; their mean chroma; share of the
    window that lies outside the picture.
    """
    rows, columns = u.shape
    first_i, last_i = math.floor((x - half - cell[2]) / cell[0]), math.ceil((x + half - cell[2]) / cell[0])
    first_j, last_j = math.floor((y - half - cell[3]) / cell[1]), math.ceil((y + half - cell[3]) / cell[1])
    seen, count, weights, sum_x, sum_y = 0, 0, 0.0, 0.0, 0.0
    for j in range(max(first_j, 0), min(last_j, rows - 1) + 1):
        for i in range(max(first_i, 0), min(last_i, columns - 1) + 1):
            seen += 1
            along = is_color(u[j, i], v[j, i], color)
            if along > 0.0:
                count += 1
                weights += along
                sum_x += along * i
                sum_y += along * j
    found[AREA] = count * cell[0] * cell[1]
    found[CENTER_X] = cell[2] + cell[0] * sum_x / weights if count else np.nan
    found[CENTER_Y] = cell[3] + cell[1] * sum_y / weights if count else np.nan
    found[STRENGTH] = weights / count if count else 0.0
    found[CLIPPED] = 1.0 - seen / ((last_i - first_i + 1) * (last_j - first_j + 1))


@njit(cache=True, nogil=True, inline="always")
def is_color(u, v, color):
    """Chroma along a colour's direction if (u, v) is of that colour, else 0.

    color: neutral u, v; unit vector of the colour from it; least chroma; tangent of the half angle about the direction.
    """
    du, dv = u - color[0], v - color[1]
    along = du * color[2] + dv * color[3]
    if along > color[4] and abs(dv * color[2] - du * color[3]) < color[5] * along:
        return along
    return 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def color_scan(u, v, allowed, color, least, mask):
    """Mark all allowed pixels of a colour in mask; returns their number and bounds (rows, then columns, inclusive).

    least: the chroma asked for in place of color's own.
    """
    rows, columns = u.shape
    count, top, bottom, left, right = 0, rows, -1, columns, -1
    wanted = color.copy()
    wanted[4] = least
    neutral_u, neutral_v, toward_u, toward_v = wanted[0], wanted[1], wanted[2], wanted[3]
    mask[:, :] = 0
    for j in range(rows):
        for i in range(columns):
            # Few cells are colourful at all: the first comparison settles nearly all of them.
            if (u[j, i] - neutral_u) * toward_u + (v[j, i] - neutral_v) * toward_v <= least or not allowed[j, i]:
                continue
            if is_color(u[j, i], v[j, i], wanted) > 0.0:
                mask[j, i] = 1
                count += 1
                top, bottom, left, right = min(top, j), max(bottom, j), min(left, i), max(right, i)
    return count, top, bottom, left, right


@njit(cache=True, nogil=True, error_model="numpy")
def fit_disc(luma, row_origin, row_step, start, disc, profile, slope, per_px, noise, result):
    """Fit centre, amplitude and base of a blurred disc to the luma by iteratively reweighted least squares.

    start: x, y, amplitude, base. disc: radius, blur, e1, e2, outer radius of the pixels used, smear along x and y
    (px during the exposure). profile, slope: of the disc against radius, per_px entries a pixel. noise: variance at
    level 0, variance per level, softness of the outlier weights in sigmas. result: see the names at the top.
    start may hold two more numbers, the slopes of a background that is not level; they are then fitted as well.
    """
    size = len(start)
    state, sums = start.copy(), np.empty(4)
    normal, right, move = np.empty((size, size)), np.empty(size), np.empty(size)
    for _ in range(12):
        accumulate(luma, row_origin, row_step, state, disc, profile, slope, per_px, noise, normal, right, sums)
        if sums[2] < 6.0 or not solve(normal, right, move):
            result[X] = result[Y] = result[RESIDUAL] = np.nan
            return
        # A step beyond the blurred edge leaves the range in which the slope means anything.
        length = math.sqrt(move[0] * move[0] + move[1] * move[1])
        shorten = min(1.0, (0.35 * disc[0] + disc[1]) / max(length, 1e-12))
        state[0] += shorten * move[0]
        state[1] += shorten * move[1]
        for m in range(2, size):
            state[m] += move[m]
        # The next step would be shorter by the error of the slope across this one, 1/20 or less.
        if length < 0.02:
            break
    invert_leading(normal, result)
    result[X : BASE + 1] = state[:4]
    result[SLOPE_X], result[SLOPE_Y] = (state[4], state[5]) if size == 6 else (0.0, 0.0)
    result[RESIDUAL] = sums[0] / max(sums[1] - size, 1.0)
    result[USED] = sums[1] / max(sums[2], 1.0)
    result[INSIDE] = sums[2] / max(sums[3], 1.0)
    result[PIXELS] = sums[2]


@njit(cache=True, nogil=True, error_model="numpy", fastmath=QUICK)
def accumulate(luma, row_origin, row_step, state, disc, profile, slope, per_px, noise, normal, right, sums):
    """Fill the upper triangle of the normal equations of `fit_disc` at a state.

    sums: weighted squares, sum of outlier weights, pixels in the picture, pixels in the disc's surroundings. In one
    piece, and in scalars: taken apart, or summed in place, it takes twice as long.
    """
    rows, columns = luma.shape
    x, y, amplitude, base = state[0], state[1], state[2], state[3]
    sloping = len(state) == 6
    tilt_x, tilt_y = (state[4], state[5]) if sloping else (0.0, 0.0)
    radius, e1, e2, outer, smear_x, smear_y = disc[0], disc[2], disc[3], disc[4], disc[5], disc[6]
    blur2, smear2, last = disc[1] * disc[1], smear_x * smear_x + smear_y * smear_y, len(profile) - 2
    smeared = smear2 > 0.5 * blur2
    still, per_level, softness = noise[0], noise[1], 1.0 / (noise[2] * noise[2])
    edge = 3.5 * math.sqrt(blur2 + smear2 / 12.0)
    flat_in, flat_out = max(disc[0] - edge, 0.0) ** 2, (disc[0] + edge) ** 2
    normal[:, :], right[:], sums[:] = 0.0, 0.0, 0.0
    xx = xy = xp = xb = yy = yp = yb = pp = pb = bb = rx = ry = rp = rb = squares = trust = inside = around = 0.0
    reach = outer / math.sqrt(1.0 - math.sqrt(e1 * e1 + e2 * e2))
    for j in range(math.ceil((y - reach - row_origin) / row_step), math.floor((y + reach - row_origin) / row_step) + 1):
        dy = row_origin + row_step * j - y
        for i in range(math.ceil(x - reach), math.floor(x + reach) + 1):
            dx = i - x
            square = (1.0 + e1) * dx * dx + 2.0 * e2 * dx * dy + (1.0 - e1) * dy * dy
            # Flat parts tell only amplitude and base: a quarter of their pixels is plenty.
            flat = square < flat_in or square > flat_out
            if square > outer * outer or (flat and (i + j) & 1 | (i & 1)):
                continue
            around += 1.0
            if j < 0 or j >= rows or i < 0 or i >= columns:
                continue
            r = math.sqrt(max(square, 1e-12))
            outward_x, outward_y = ((1.0 + e1) * dx + e2 * dy) / r, (e2 * dx + (1.0 - e1) * dy) / r
            stretch = 1.0
            if smeared:
                along = smear_x * outward_x + smear_y * outward_y
                stretch = 1.0 / math.sqrt(1.0 + along * along / (12.0 * blur2))
            place = max((radius + (r - radius) * stretch) * per_px, 0.0)
            k = min(int(place), last)
            part = min(place - k, 1.0)
            p = profile[k] + part * (profile[k + 1] - profile[k])
            pull = -amplitude * (slope[k] + part * (slope[k + 1] - slope[k])) * stretch
            gx, gy, level = pull * outward_x, pull * outward_y, base + amplitude * p
            residual, certain = (
                luma[j, i] - level - tilt_x * dx - tilt_y * dy,
                1.0 / (still + per_level * max(level, 0.0)),
            )
            beyond = residual * residual * certain * softness
            soft = 1.0 / (1.0 + beyond * beyond)
            w = soft * certain
            wx, wy, wp, wr = w * gx, w * gy, w * p, w * residual
            xx, xy, xp, xb, yy, yp = xx + wx * gx, xy + wx * gy, xp + wx * p, xb + wx, yy + wy * gy, yp + wy * p
            yb, pp, pb, bb = yb + wy, pp + wp * p, pb + wp, bb + w
            rx, ry, rp, rb = rx + wr * gx, ry + wr * gy, rp + wr * p, rb + wr
            squares, trust, inside = squares + wr * residual, trust + soft, inside + 1.0
            if sloping:
                add_slopes(normal, right, w, dx, dy, gx, gy, p, residual)
    normal[0, 0], normal[0, 1], normal[0, 2], normal[0, 3], normal[1, 1] = xx, xy, xp, xb, yy
    normal[1, 2], normal[1, 3], normal[2, 2], normal[2, 3], normal[3, 3] = yp, yb, pp, pb, bb
    right[0], right[1], right[2], right[3] = rx, ry, rp, rb
    sums[0], sums[1], sums[2], sums[3] = squares, trust, inside, around


@njit(cache=True, nogil=True)
def add_slopes(normal, right, w, dx, dy, gx, gy, p, residual):
    """Add a pixel to what the normal equations know of a background's slopes."""
    for column, derivative in ((4, w * dx), (5, w * dy)):
        normal[0, column] += derivative * gx
        normal[1, column] += derivative * gy
        normal[2, column] += derivative * p
        normal[3, column] += derivative
        normal[4, column] += derivative * dx
        right[column] += derivative * residual
    normal[5, 5] += w * dy * dy


@njit(cache=True, nogil=True)
def solve(normal, right, move):
    """Solve the symmetric system by Cholesky in place of normal's lower triangle; False where singular."""
    size = len(right)
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


@njit(cache=True, nogil=True)
def invert_leading(lower, result):
    """Covariance of the first two unknowns from the Cholesky factor."""
    size = len(lower)
    columns = np.zeros((2, size))
    for c in range(2):
        for i in range(size):
            total = 1.0 if i == c else 0.0
            for k in range(i):
                total -= lower[i, k] * columns[c, k]
            columns[c, i] = total / lower[i, i]
    result[VAR_X] = np.sum(columns[0] * columns[0])
    result[VAR_Y] = np.sum(columns[1] * columns[1])
    result[COV_XY] = np.sum(columns[0] * columns[1])


@njit(cache=True, nogil=True)
def interior_slope(luma, row_origin, row_step, x, y, radius, slope):
    """Fit a plane to the luma within a radius of (x, y); fills slope with its slopes along x and y, levels a px."""
    rows, columns = luma.shape
    normal, right, move = np.zeros((4, 4)), np.zeros(4), np.zeros(4)
    normal[3, 3] = 1.0
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
    if normal[0, 0] < 12.0 or not solve(normal, right, move):
        slope[0] = slope[1] = np.nan
        return
    slope[0], slope[1] = move[1], move[2]
