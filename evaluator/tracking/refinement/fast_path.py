"""Compiled: what is done with a mark in every frame in which nothing is unusual, in one piece.

A glance looks for the mark's colour where it should be, fits its disc there, and says whether anything is unusual;
`follow` then looks closer. Afterwards what is usual follows what was seen.
"""
# mypy: disallow-untyped-defs=false, disallow-untyped-calls=false
# ruff: noqa: ANN001, ANN201 - numba infers the types

from __future__ import annotations

import math

from numba import njit

from evaluator.tracking.detection.color_kernels import AREA, CENTER_X, CENTER_Y, STRENGTH, color_window
from evaluator.tracking.refinement.kernels import AMPLITUDE, BASE, INSIDE, PIXELS, RESIDUAL, USED, X, Y, fit_disc

# What a glance says: too little of the colour is there; something is unusual; all is well.
TOO_LITTLE, UNUSUAL, WELL = range(3)
# Places of what is usual of a mark: its amplitude, base, scatter of the residual (one sigma), least noise, area of its
# colour when all of it shows.
U_AMPLITUDE, U_BASE, U_SCATTER, U_LEAST_NOISE, U_AREA = range(5)

FEW, MANY = 0.35, 1.5  # of the usual area: less is no mark, more has something of its colour beside it
# Residual (mean square over noise) above which something is in the way for certain: 4 sigma for the 130 pixels of a
# mark of 5 px radius. The background's slope is then fitted too, and the light is suspected.
DISTURBED = 1.5
# Sigmas of the residual's usual scatter (as it was learnt: codecs make it larger than chance) from which a sloping
# background is tried, and from which the uncertainty allows for what is in the way.
SUSPECT, ODD = 2.0, 3.0
LEAST_INSIDE, LEAST_USED = 0.9, 0.75  # of a mark's pixels: in the frame, and its own
BRIGHTER = 1.2  # amplitude over what it was, from which the light has changed rather than flickered
PLAUSIBLE = 4.0  # amplitude over what it was, either way, beyond which it is something else
NOISE_STEP = 1.03
CALMER = 0.7  # of the noise: residuals of 100 pixels stay above by chance in 98 %
NOISE_RANGE = 30.0  # least and most noise of a recording, compressed or not, in variance
PER_MEDIAN = 1.4826  # sigma over median deviation


@njit(cache=True, nogil=True, error_model="numpy")
def glance(luma, u, v, row_origin, row_step, cell, x, y, reach, path_x, path_y, color, usual, disc, table, noise, start,
           found, result):  # fmt: skip
    """Look for a mark within reach of (x, y), px, and fit its disc there.

    cell, color, found: of `color_window`. path_x, path_y: px that it moves while the shutter is open. usual: see the
    names at the top. disc, table, noise, start, result: of `fit_disc`; start and disc's smear are filled here.
    """
    radius = disc[0]
    color_window(u, v, cell, x, y, radius + reach, color, found)
    if found[AREA] < FEW * usual[U_AREA]:
        return TOO_LITTLE
    seen_x, seen_y = found[CENTER_X], found[CENTER_Y]
    crowded = found[AREA] > MANY * usual[U_AREA]
    # The colour's centre is good to a chroma sample, the prediction usually to a tenth: take it unless they differ.
    near = crowded or abs(seen_x - x) + abs(seen_y - y) < 0.4 * radius + 1.0
    start[0], start[1] = (x, y) if near else (seen_x, seen_y)
    start[2], start[3] = usual[U_AMPLITUDE], usual[U_BASE]
    smear(disc, path_x, path_y)
    fit_disc(luma, row_origin, row_step, start, None, disc, table, noise, result)
    slack = 0.5 * radius + 1.0
    plain = result[RESIDUAL] <= min(DISTURBED, 1.0 + SUSPECT * usual[U_SCATTER])
    there = abs(result[X] - x) <= reach + slack and abs(result[Y] - y) <= reach + slack
    beside = crowded or abs(result[X] - seen_x) + abs(result[Y] - seen_y) > slack
    brightness = result[AMPLITUDE] / usual[U_AMPLITUDE]
    whole = result[INSIDE] >= LEAST_INSIDE and result[USED] >= LEAST_USED
    if plain and there and whole and not beside and 1.0 / PLAUSIBLE < brightness < PLAUSIBLE:
        return WELL
    return UNUSUAL


@njit(cache=True, nogil=True, forceinline=True)
def smear(disc, path_x, path_y):
    """Smear the disc as its motion does. Beyond a diameter it is a wrong velocity sooner than a fast mark."""
    keep = min(1.0, 2.0 * disc[0] / (math.sqrt(path_x * path_x + path_y * path_y) + 1e-9))
    disc[5], disc[6] = path_x * keep, path_y * keep


@njit(cache=True, nogil=True, error_model="numpy")
def settle(usual, noise, color, found, result):
    """Let what is usual of a mark follow what was just measured of it."""
    # Lights change slowly, or at once.
    rate = follow_rate(result[AMPLITUDE] / usual[U_AMPLITUDE])
    usual[U_AMPLITUDE] += rate * (result[AMPLITUDE] - usual[U_AMPLITUDE])
    usual[U_BASE] += rate * (result[BASE] - usual[U_BASE])
    # Noise is what residuals usually are: a codec leaves more of it on a moving mark than on one at rest. Steps of
    # equal size toward either side follow the median, which a passing disturbance does not move.
    # After a disturbance that lasted they are clearly lower, and must not hide the next one.
    residual = result[RESIDUAL]
    step = NOISE_STEP if residual > 1.0 else 1.0 / NOISE_STEP if residual > CALMER else CALMER
    least = usual[U_LEAST_NOISE]
    noise[0] = min(max(noise[0] * step, least), NOISE_RANGE * least)
    off = PER_MEDIAN * abs(residual - 1.0)
    scatter = usual[U_SCATTER] * (NOISE_STEP if off > usual[U_SCATTER] else 1.0 / NOISE_STEP)
    chance = (2.0 / max(result[PIXELS], 1.0)) ** 0.5
    usual[U_SCATTER] = min(max(scatter, chance), max((DISTURBED - 1.0) / ODD, chance))
    strength = 0.5 * found[STRENGTH]
    color[4] += follow_rate(strength / color[4]) * (strength - color[4])


@njit(cache=True, nogil=True, forceinline=True)
def follow_rate(ratio):
    """Share of a new value in what is usual, from its ratio to it."""
    return 0.1 if 1.0 / BRIGHTER < ratio < BRIGHTER else 1.0
