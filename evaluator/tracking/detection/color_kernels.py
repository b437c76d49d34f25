"""Compiled inner loops: which samples of the colour planes have a colour.

Image coordinates, px; a chroma sample covers across × down luma samples.
"""
# mypy: disallow-untyped-defs=false, disallow-untyped-calls=false
# ruff: noqa: ANN001, ANN201, FURB136 - numba infers the types; comparisons compile sooner than min and max

from __future__ import annotations

import math

import numpy as np

from calibration.compilation import compiled

single = np.float32
# Floating-point flags that allow sums of a row to be vectorised; NaN is still respected.
SUMS = {"contract", "arcp", "nsz", "reassoc"}

# Indices of the results of `color_window`.
AREA, CENTER_X, CENTER_Y, STRENGTH, CLIPPED = range(5)


@compiled(nogil=True, fastmath=SUMS)
def color_window(u, v, cell, x, y, half, color, found):
    """Moments of the pixels of a colour in a square window around (x, y), written to found.

    cell: width and height of a chroma sample in px, and the centre (x, y) of the first one. color: see `is_color`.
    found: area of the pixels of the colour, px²; their centre; their mean chroma; share of the window outside the
    image.
    """
    rows, columns = u.shape
    first_i, last_i = math.floor((x - half - cell[2]) / cell[0]), math.ceil((x + half - cell[2]) / cell[0])
    first_j, last_j = math.floor((y - half - cell[3]) / cell[1]), math.ceil((y + half - cell[3]) / cell[1])
    # Comparisons instead of min and max, each of which takes numba as long to compile as a loop.
    left, right = first_i if first_i > 0 else 0, last_i + 1 if last_i < columns else columns
    top, bottom = first_j if first_j > 0 else 0, last_j + 1 if last_j < rows else rows
    # In single precision and without branches, so that it is vectorised.
    neutral_u, neutral_v, toward_u, toward_v = single(color[0]), single(color[1]), single(color[2]), single(color[3])
    least, tangent, none, one = single(color[4]), single(color[5]), single(0.0), single(1.0)
    count = weights = sum_x = sum_y = 0.0
    for j in range(top, bottom):
        hits = chroma = moment = none
        for i in range(left, right):
            du, dv = single(u[j, i]) - neutral_u, single(v[j, i]) - neutral_v
            along = du * toward_u + dv * toward_v
            inside = (along > least) & (abs(dv * toward_u - du * toward_v) < tangent * along)
            weight = along if inside else none
            hits += one if inside else none
            chroma += weight
            moment += weight * single(i - left)
        count += float(hits)
        weights += float(chroma)
        sum_x += float(moment + chroma * left)
        sum_y += float(chroma * j)
    found[AREA] = count * cell[0] * cell[1]
    found[CENTER_X] = cell[2] + cell[0] * sum_x / weights if count else np.nan
    found[CENTER_Y] = cell[3] + cell[1] * sum_y / weights if count else np.nan
    found[STRENGTH] = weights / count if count else 0.0
    seen = (right - left) * (bottom - top) if right > left and bottom > top else 0
    found[CLIPPED] = 1.0 - seen / ((last_i - first_i + 1) * (last_j - first_j + 1))


@compiled(nogil=True, inline="always")
def is_color(u, v, color):
    """Chroma along a colour's direction if (u, v) has that colour, else 0.

    color: neutral u, v; unit vector of the colour from it; least chroma; tangent of the half angle about the direction.
    """
    du, dv = u - color[0], v - color[1]
    along = du * color[2] + dv * color[3]
    if along > color[4] and abs(dv * color[2] - du * color[3]) < color[5] * along:
        return along
    return 0.0


@compiled(nogil=True)
def color_scan(u, v, allowed, color, least, mask):
    """Mark all allowed pixels of a colour in mask; returns their number and bounds (rows, then columns, inclusive).

    least: minimum chroma, which replaces that of color.
    """
    rows, columns = u.shape
    count, top, bottom, left, right = 0, rows, -1, columns, -1
    wanted = color.copy()
    wanted[4] = least
    neutral_u, neutral_v, toward_u, toward_v = wanted[0], wanted[1], wanted[2], wanted[3]
    mask[:, :] = 0
    for j in range(rows):
        for i in range(columns):
            # Few cells are colourful: the first comparison excludes nearly all of them.
            if (u[j, i] - neutral_u) * toward_u + (v[j, i] - neutral_v) * toward_v <= least or not allowed[j, i]:
                continue
            if is_color(u[j, i], v[j, i], wanted) > 0.0:
                mask[j, i] = 1
                count += 1
                top, bottom, left, right = min(top, j), max(bottom, j), min(left, i), max(right, i)
    return count, top, bottom, left, right


@compiled(nogil=True, fastmath=SUMS)
def chroma_plane(luma, u, v, to_rgb, chroma):
    """Fill chroma: largest minus smallest of R, G, B = to_rgb (3, 4) · (luma, u, v, 1)."""
    rows, columns = chroma.shape
    for j in range(rows):
        for i in range(columns):
            y, b, r = single(luma[j, i]), single(u[j, i]), single(v[j, i])
            red = to_rgb[0, 0] * y + to_rgb[0, 1] * b + to_rgb[0, 2] * r + to_rgb[0, 3]
            green = to_rgb[1, 0] * y + to_rgb[1, 1] * b + to_rgb[1, 2] * r + to_rgb[1, 3]
            blue = to_rgb[2, 0] * y + to_rgb[2, 1] * b + to_rgb[2, 2] * r + to_rgb[2, 3]
            chroma[j, i] = max(red, green, blue) - min(red, green, blue)
