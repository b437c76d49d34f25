"""The fast path: processing of a mark in a frame without anything unusual.

`fit_mark` finds the mark's colour near its predicted position, fits its disc there, and reports whether anything is
unusual; `follow` then takes the slow path. Afterwards `settle` updates the usual values with the measurement.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from evaluator.robust import PER_MEDIAN
from evaluator.tracking.detection.color_kernels import STRENGTH, color_window
from evaluator.tracking.refinement.kernels import AMPLITUDE, BASE, INSIDE, PIXELS, RESIDUAL, USED, X, Y, fit_disc

Array = NDArray[np.float64]
Plane = NDArray[np.unsignedinteger]

# Results of `fit_mark`: too little of the colour is present; something is unusual; nothing is unusual.
TOO_LITTLE, UNUSUAL, WELL = range(3)
# Indices of a mark's usual values: amplitude, base, scatter of the residual (one sigma), least noise, area of its
# colour when it is completely visible.
U_AMPLITUDE, U_BASE, U_SCATTER, U_LEAST_NOISE, U_AREA = range(5)

FEW, MANY = 0.35, 1.5  # of the usual area: below, it is no mark; above, something of its colour is beside it
# Residual (mean square over noise) that proves a disturbance: 4 sigma for the 130 pixels of a mark of 5 px radius. A
# slope of the background is then fitted too, and a change of the light is considered.
DISTURBED = 1.5
# Residual, in sigmas of its usual scatter (learnt, because codecs make it larger than chance), from which a sloping
# background is tried, and from which the uncertainty is increased because of a disturbance.
SUSPECT, ODD = 2.0, 3.0
LEAST_INSIDE, LEAST_USED = 0.9, 0.75  # least share of a mark's pixels within the frame, and with full weight in the fit
BRIGHTER = 1.2  # ratio of amplitudes from which the light has changed; flicker is smaller
PLAUSIBLE = 4.0  # ratio of amplitudes, in either direction, beyond which it is another object
NOISE_STEP = 1.03  # change of the noise in a frame: a noise of twice the size is followed within 23 frames
CALMER = 0.7  # of the noise: 98 % of the residuals of 100 pixels exceed it by chance
NOISE_RANGE = 30.0  # ratio of the largest to the smallest noise variance of recordings, compressed or not


def fit_mark(
    luma: Plane, u: Plane | None, v: Plane | None, row_origin: int, row_step: int, cell: Array, x: float, y: float,
    reach: float, path_x: float, path_y: float, color: Array, usual: Array, disc: Array, table: NDArray[np.float32],
    noise: Array, start: Array, found: Array, result: Array,
) -> int:  # fmt: skip
    """Find a mark within reach of (x, y), px, and fit its disc there.

    cell, color, found: see `color_window`. path_x, path_y: px that it moves while the shutter is open. usual: see the
    names at the top. disc, table, noise, start, result: see `fit_disc`; start and the disc's smear are set here.
    """
    radius, (amplitude, base, scatter, _, usual_area) = disc.item(0), usual.tolist()
    color_window(u, v, cell, x, y, radius + reach, color, found)
    area, seen_x, seen_y, _, _ = found.tolist()
    if area < FEW * usual_area:
        return TOO_LITTLE
    crowded = area > MANY * usual_area
    # The colour's centre errs by a chroma sample, the prediction usually by a tenth of one: use it unless they differ.
    near = crowded or abs(seen_x - x) + abs(seen_y - y) < 0.4 * radius + 1.0
    start[:] = (x, y, amplitude, base) if near else (seen_x, seen_y, amplitude, base)
    smear(disc, path_x, path_y)
    fit_disc(luma, row_origin, row_step, start, False, disc, table, noise, result)
    fit = result.tolist()
    slack = 0.5 * radius + 1.0
    plain = fit[RESIDUAL] <= min(DISTURBED, 1.0 + SUSPECT * scatter)
    there = abs(fit[X] - x) <= reach + slack and abs(fit[Y] - y) <= reach + slack
    beside = crowded or abs(fit[X] - seen_x) + abs(fit[Y] - seen_y) > slack
    brightness = fit[AMPLITUDE] / amplitude if amplitude else math.nan
    whole = fit[INSIDE] >= LEAST_INSIDE and fit[USED] >= LEAST_USED
    if plain and there and whole and not beside and 1.0 / PLAUSIBLE < brightness < PLAUSIBLE:
        return WELL
    return UNUSUAL


def smear(disc: Array, path_x: float, path_y: float) -> None:
    """Set the motion blur of a disc, at most a diameter: beyond it the velocity is probably wrong."""
    keep = min(1.0, 2.0 * disc.item(0) / (math.sqrt(path_x * path_x + path_y * path_y) + 1e-9))
    disc[5], disc[6] = path_x * keep, path_y * keep


def settle(usual: Array, noise: Array, color: Array, found: Array, result: Array) -> None:
    """Update the usual values of a mark with its last measurement."""
    amplitude, base, scatter, least, _ = usual.tolist()
    measured, residual = result.item(AMPLITUDE), result.item(RESIDUAL)
    # Light changes slowly or suddenly.
    rate = _follow_rate(measured, amplitude)
    usual[U_AMPLITUDE] = amplitude + rate * (measured - amplitude)
    usual[U_BASE] = base + rate * (result.item(BASE) - base)
    # Noise is the usual residual: a codec leaves more of it on a moving mark than on one at rest. Steps of equal size
    # in both directions follow the median, which a short disturbance does not move. After a long disturbance the
    # residuals are clearly lower; the noise is then reduced, so that it does not hide the next disturbance.
    step = NOISE_STEP if residual > 1.0 else 1.0 / NOISE_STEP if residual > CALMER else CALMER
    noise[0] = min(max(noise.item(0) * step, least), NOISE_RANGE * least)
    off = PER_MEDIAN * abs(residual - 1.0)
    scatter *= NOISE_STEP if off > scatter else 1.0 / NOISE_STEP
    chance = math.sqrt(2.0 / max(result.item(PIXELS), 1.0))
    usual[U_SCATTER] = min(max(scatter, chance), max((DISTURBED - 1.0) / ODD, chance))
    strength, usual_strength = 0.5 * found.item(STRENGTH), color.item(4)
    color[4] = usual_strength + _follow_rate(strength, usual_strength) * (strength - usual_strength)


def _follow_rate(measured: float, usual: float) -> float:
    """Weight of a new value in the usual one."""
    return 0.1 if usual and 1.0 / BRIGHTER < measured / usual < BRIGHTER else 1.0
