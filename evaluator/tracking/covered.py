"""Fit what shows of a mark that something lies across: a wire, a glint, a scratch.

Weights that single pixels lose as outliers keep the inside of a wire out of a fit, but not its blurred flanks, each of
whose pixels is within the noise: together they pull. What lies across shows in residuals that neighbouring pixels
share. Where their mean over 3 × 3 pixels is more than noise and a small shift of the mark explain, it and the pixels
around it (the blur's reach) are left out, and the rest is fitted; the shift that is allowed for shrinks from step to
step, since at first it is the mark that may be off.

What remains are errors that the pixels of one part of the rim share. Parts of the rim err independently, so that the
steps that the centre makes as each of them is left out (the jackknife) tell its uncertainty, whatever the errors
within a part have in common.
"""
# mypy: disallow-untyped-defs=false, disallow-untyped-calls=false
# ruff: noqa: ANN001, ANN201, ANN202 - numba infers the types

from __future__ import annotations

import math

import numpy as np
from numba import njit

from evaluator.tracking.kernels import (
    BASE,
    COV_XY,
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

# Sigmas of the mean of 3 × 3 pixels beyond which something covers them: 1 % of the clear pixels are lost.
BEYOND = 3.0
# What the mean of 3 × 3 residuals reaches, beyond a shift of CORE_OFF_PX, where something lies across a mark: sigmas of
# the picture's single pixels, and share of the amplitude. Of 10,000 clear marks none reaches both; codec blocks, whose
# errors are shared by all neighbours, reach 4 % of the amplitude, at the median 2 %. A wire over 3 % of a mark reaches
# 30 %, one beside it 9 %; 4 % where the shape that it is seen against was learnt under it. Less is asked for where it
# is likely: just after something was seen, and while learning, from all pictures alike.
CORE, CORE_EXPECTED, CORE_OFF_PX = (4.0, 0.06), (2.6, 0.03), 0.1
# px by which the mark may be off while it is fitted; the last one is about what the edge of a real mark is untrue by.
OFF_PX = np.array([0.4, 0.3, 0.2, 0.15, 0.1, 0.05, 0.05])
# Share of a mark's information on its centre that what covers it takes, from which the fit without is taken. By chance
# and by the blocks of a codec it takes less.
NOTABLE = 0.03
SLOPING = 12.0  # fall of the squares, in variances, that two slopes bring by chance once in 400 pictures
SLOPES_AT = 2  # step at which slopes are looked for: what covers the mark is about known then
# Of the shift that a slope makes, what may be left where it is taken out: what bends (the light of a lamp's reflection,
# over the distance that it fades in).
BENT = 0.2
PARTS = 12  # of the rim: 30 degrees each, as much as a thin wire blurs on a small mark
FEW_SQUARES = 1.5  # mean of a variance that is known from about six squares alone
MOST = (
    2.0  # times what single pixels' noise would have the mean's be: errors of a codec's blocks are shared by neighbours
)
LEAST_PIXELS = 12.0  # that a disc is fitted to
FLAT = 1e-3  # of the steepest slope: pixels below it tell only amplitude and base, and a quarter of them is plenty
PROFILE, ALONG_X, ALONG_Y, LEFT, MEAN, WORK = range(6)  # planes of a window


@njit(cache=True, nogil=True, error_model="numpy")
def fit_uncovered(luma, row_origin, row_step, fitted, disc, table, noise, result, shown, core, least):
    """Fit a disc to those of its pixels that nothing covers.

    fitted: what `kernels.fit_disc` gave, with the slopes that are kept. disc, table, noise: as it takes them. result:
    as it gives them, but with variances as parts of the rim show them and a residual of the pixels that are left.
    shown: of the luma's shape, set to False where it is covered; or empty. core: CORE or CORE_EXPECTED. least: share of
    the information on the centre, of pixels that seem covered at first, from which the fit is done. Returns that share
    (0 where nothing stands out as far as core), and the share that is covered in the end: 0 where no fit was done, 1
    where nothing is left to fit; nothing is written then.
    """
    top, bottom, left, right = _window(luma, row_origin, row_step, fitted, disc)
    if bottom - top < 5 or right - left < 5:
        return 0.0, 0.0
    place = row_origin + row_step * top, row_step, left
    state = np.zeros(6)
    state[: BASE + 1], state[4], state[5] = fitted[: BASE + 1], fitted[SLOPE_X], fitted[SLOPE_Y]
    planes = np.zeros((6, bottom - top, right - left))
    used, covered = np.zeros((2, bottom - top, right - left), np.bool_)
    normal, move, products, pulls = np.zeros((6, 6)), np.zeros(6), np.zeros((PARTS, 6, 6)), np.zeros((PARTS, 6))
    size, level_x, level_y = 4, fitted[X], fitted[Y]
    seeming = share = scale = weight = squares = count = 0.0
    for step in range(len(OFF_PX)):
        _model(luma[top:bottom, left:right], place, state, disc, table, planes, used)
        if step == 0:
            if not _stands_out(planes, used, state[2], noise[0], core):
                return 0.0, 0.0
            scale = _scale(planes, used, noise[0])
            seeming = _cover(planes, used, scale, OFF_PX[-1], covered)
            if seeming < least:
                return seeming, 0.0
        share = _cover(planes, used, scale, OFF_PX[step], covered)
        split = step == len(OFF_PX) - 1
        weight, squares, count = _pull(planes, used, covered, state, noise, place, split, products, pulls)
        for _ in range(2):
            normal[:size, :size] = products[:, :size, :size].sum(axis=0)
            if weight < LEAST_PIXELS or not solve(normal[:size, :size], pulls[:, :size].sum(axis=0), move[:size]):
                return seeming, 1.0
            if size == 6 or step != SLOPES_AT or not _slopes(products, pulls):
                break
            size, level_x, level_y = 6, state[0] + move[0], state[1] + move[1]
        length = math.sqrt(move[0] * move[0] + move[1] * move[1])
        move[:2] *= min(1.0, (0.35 * disc[0] + disc[1]) / max(length, 1e-12))
        state[:size] += move[:size]
    invert_leading(normal[:size, :size], result)
    residual = squares / max(weight - size, 1.0)
    scatter = FEW_SQUARES * _jackknife(products[:, :size, :size], pulls[:, :size], move[:size])
    widen = max(scatter / (result[VAR_X] + result[VAR_Y]), residual, 1.0)
    result[VAR_X : COV_XY + 1] *= widen
    result[X : BASE + 1], result[SLOPE_X], result[SLOPE_Y] = state[: BASE + 1], state[4], state[5]
    off_x, off_y = (BENT * (state[0] - level_x), BENT * (state[1] - level_y)) if size == 6 else (0.0, 0.0)
    result[VAR_X : COV_XY + 1] += np.array([off_x * off_x, off_y * off_y, off_x * off_y])
    if shown.shape == luma.shape:
        shown[top:bottom, left:right] &= ~covered
    result[RESIDUAL], result[USED], result[PIXELS] = residual, weight / count, weight
    return seeming, share


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def _window(luma, row_origin, row_step, fitted, disc):
    """Rows and columns (first, and one beyond the last) of the pixels used, and one more on every side."""
    x, y = fitted[X], fitted[Y]
    reach = disc[4] / math.sqrt(1.0 - math.sqrt(disc[2] * disc[2] + disc[3] * disc[3]))
    rows, columns = luma.shape
    top = max(math.ceil((y - reach - row_origin) / row_step) - 1, 0)
    bottom = max(min(math.floor((y + reach - row_origin) / row_step) + 1, rows - 1) + 1, top)
    left = max(math.ceil(x - reach) - 1, 0)
    return top, bottom, left, max(min(math.floor(x + reach) + 1, columns - 1) + 1, left)


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def _model(luma, place, state, disc, table, planes, used):
    """Fill profile, slopes and residual of the pixels of a window at a state, as `kernels.accumulate` has them."""
    top_y, row_step, left = place
    radius, blur2, e1, e2, smear_x, smear_y = disc[0], disc[1] * disc[1], disc[2], disc[3], disc[5], disc[6]
    smear2, amplitude, outer2 = smear_x * smear_x + smear_y * smear_y, state[2], disc[4] * disc[4]
    smeared = smear2 > 0.5 * blur2
    for j in range(luma.shape[0]):
        dy = top_y + row_step * j - state[1]
        for i in range(luma.shape[1]):
            dx = left + i - state[0]
            outward_x, outward_y = (1.0 + e1) * dx + e2 * dy, e2 * dx + (1.0 - e1) * dy
            square = outward_x * dx + outward_y * dy
            used[j, i] = square <= outer2
            pull = -amplitude
            if smeared:
                r = math.sqrt(max(square, 1e-6))
                along = smear_x * outward_x + smear_y * outward_y
                stretch = 1.0 / math.sqrt(1.0 + along * along / (12.0 * blur2 * r * r))
                nearer = max(radius + (r - radius) * stretch, 0.0)
                pull *= stretch * nearer / r
                square = nearer * nearer
            k = min(int(square * disc[7] + 0.5), len(table) - 1)
            pull *= table[k, 1]
            planes[PROFILE, j, i] = table[k, 0]
            planes[ALONG_X, j, i], planes[ALONG_Y, j, i] = pull * outward_x, pull * outward_y
            planes[LEFT, j, i] = luma[j, i] - state[3] - amplitude * table[k, 0] - state[4] * dx - state[5] * dy
    _mean(planes[LEFT], planes[WORK], planes[MEAN])


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def _mean(plane, work, mean):
    """Mean over 3 × 3 pixels; a window's border repeats itself."""
    tall, wide = plane.shape
    for j in range(tall):
        for i in range(wide):
            work[j, i] = plane[j, max(i - 1, 0)] + plane[j, i] + plane[j, min(i + 1, wide - 1)]
    for j in range(tall):
        above, below = max(j - 1, 0), min(j + 1, tall - 1)
        for i in range(wide):
            mean[j, i] = (work[above, i] + work[j, i] + work[below, i]) * (1.0 / 9.0)


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def _stands_out(planes, used, amplitude, noise, core):
    """Whether anything across the mark is beyond doubt, and more than a small shift explains."""
    most = 0.0
    for j in range(used.shape[0]):
        for i in range(used.shape[1]):
            mean = abs(planes[MEAN, j, i])
            if used[j, i] and mean > most:
                steep = math.sqrt(planes[ALONG_X, j, i] ** 2 + planes[ALONG_Y, j, i] ** 2)
                most = max(most, mean - CORE_OFF_PX * steep)
    return most > core[1] * abs(amplitude) and most > core[0] * _trimmed(planes[LEFT], used, 2.0 * math.sqrt(noise))


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def _trimmed(plane, used, scale):
    """Sigma of the values used, without those far off; scale: more than it is."""
    for _ in range(3):
        most, total, count = (2.5 * scale) ** 2, 0.0, 1
        for j in range(used.shape[0]):
            for i in range(used.shape[1]):
                square = plane[j, i] * plane[j, i]
                if used[j, i] and square < most:
                    total += square
                    count += 1
        scale = math.sqrt(total / count)
    return scale


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def _scale(planes, used, noise):
    """Sigma of the mean of 3 × 3 residuals, without those far off: what the picture's own errors have in common."""
    least = math.sqrt(noise) / 3.0
    return min(max(_trimmed(planes[MEAN], used, 6.0 * least), least), MOST * least)


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def _cover(planes, used, scale, off_px, covered):
    """Mark the pixels that are covered, and those beside them; returns the share of the information they have."""
    tall, wide = used.shape
    covered[:, :] = False
    total = lost = 0.0
    for j in range(tall):
        for i in range(wide):
            excess = abs(planes[MEAN, j, i]) - BEYOND * scale
            if used[j, i] and excess > 0.0:
                steep2 = planes[ALONG_X, j, i] ** 2 + planes[ALONG_Y, j, i] ** 2
                if excess * excess > off_px * off_px * steep2:
                    covered[max(j - 1, 0) : j + 2, max(i - 1, 0) : i + 2] = True
    for j in range(tall):
        for i in range(wide):
            if used[j, i]:
                information = planes[ALONG_X, j, i] ** 2 + planes[ALONG_Y, j, i] ** 2
                total += information
                lost += information if covered[j, i] else 0.0
    return lost / max(total, 1e-12)


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def _pull(planes, used, covered, state, noise, place, split, products, pulls):
    """Fill the normal equations and their right hand side; returns weights, their squares and the pixels.

    split: whether for every part of the rim by itself, rather than all for the first.
    """
    top_y, row_step, left = place
    products[:, :, :], pulls[:, :] = 0.0, 0.0
    weight = squares = count = 0.0
    certain, softness = 1.0 / noise[0], 1.0 / (noise[0] * noise[1] * noise[1])
    flat, part, row = FLAT * _steepest(planes), 0, np.ones(6)
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


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def _steepest(planes):
    """Square of the steepest slope in a window."""
    most = 0.0
    for j in range(planes.shape[1]):
        for i in range(planes.shape[2]):
            most = max(most, planes[ALONG_X, j, i] ** 2 + planes[ALONG_Y, j, i] ** 2)
    return most


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def _slopes(products, pulls):
    """Whether the light behind the mark slopes: whether two more unknowns bring the squares down by SLOPING."""
    fall = 0.0
    for size in (4, 6):
        move, right = np.zeros(size), pulls[:, :size].sum(axis=0)
        if not solve(products[:, :size, :size].sum(axis=0), right, move):
            return False
        fall = (right * move).sum() - fall
    return fall > SLOPING


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def _jackknife(products, pulls, move):
    """Sum of the squares, px², of the steps that the centre makes as each part of the rim is left out."""
    total, normal, right = 0.0, np.zeros(products.shape[1:]), pulls.sum(axis=0)
    for part in range(PARTS):
        if products[part, 0, 0] + products[part, 1, 1] > 0.0:
            normal[:, :] = products.sum(axis=0) - products[part]
            if not solve(normal, right - pulls[part], move):
                return np.inf
            total += move[0] * move[0] + move[1] * move[1]
    return total
