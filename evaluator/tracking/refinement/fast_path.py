"""The fast path: processing of a mark in a frame without anything unusual.

`fit_mark` finds the mark's colour near its predicted position, fits its disc there, and reports whether anything is
unusual; `follow` then takes the slow path. Afterwards `settle` updates the usual values with the measurement.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from evaluator.tracking.detection.color_kernels import STRENGTH, color_window
from evaluator.tracking.refinement.kernels import AMPLITUDE, BASE, INSIDE, PIXELS, RESIDUAL, USED, X, Y, fit_disc

Array = NDArray[np.float64]
Plane = NDArray[np.unsignedinteger]

# What `fit_mark` says: too little of the colour is there; something is unusual; all is well.
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


def fit_mark(
    luma: Plane, u: Plane | None, v: Plane | None, row_origin: int, row_step: int, cell: Array, x: float, y: float,
    reach: float, path_x: float, path_y: float, color: Array, usual: Array, disc: Array, table: NDArray[np.float32],
    noise: Array, start: Array, found: Array, result: Array,
) -> int:  # fmt: skip
    """Find a mark within reach of (x, y), px, and fit its disc there.

    cell, color, found: of `color_window`. path_x, path_y: px that it moves while the shutter is open. usual: see the
    names at the top. disc, table, noise, start, result: of `fit_disc`; start and disc's smear are filled here.
    """
    radius, (amplitude, base, scatter, _, usual_area) = disc.item(0), usual.tolist()
    color_window(u, v, cell, x, y, radius + reach, color, found)
    area, seen_x, seen_y, _, _ = found.tolist()
    if area < FEW * usual_area:
        return TOO_LITTLE
    crowded = area > MANY * usual_area
    # The colour's centre is good to a chroma sample, the prediction usually to a tenth: take it unless they differ.
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
    # Lights change slowly, or at once.
    rate = _follow_rate(measured, amplitude)
    usual[U_AMPLITUDE] = amplitude + rate * (measured - amplitude)
    usual[U_BASE] = base + rate * (result.item(BASE) - base)
    # Noise is what residuals usually are: a codec leaves more of it on a moving mark than on one at rest. Steps of
    # equal size toward either side follow the median, which a passing disturbance does not move.
    # After a disturbance that lasted they are clearly lower, and must not hide the next one.
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
