"""Errors that a single picture cannot show: those of the video codec, from how smoothly marks move.

A codec moves a mark as a whole by a fraction of its motion vector's step (a quarter of a pixel in H.264) and leaves no
trace in the residuals of the fit. Between pictures the error shows: marks move smoothly, so what a picture's centre
differs from the course of its neighbours is error.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

OFFSETS = np.array([-5, -4, -3, -2, -1, 1, 2, 3, 4, 5])
# Weights that predict the middle of eleven from the quartic through the other ten by least squares: on a circle of 100
# px radius at 0.05 rad a step, the course itself leaves 1e-3 px.
WEIGHTS = np.linalg.pinv(np.vander(OFFSETS, 5, increasing=True))[0]
REACH = 5
LEAST = 24  # differences that a variance is estimated from: its own relative uncertainty is then below 0.3
MOVING_PX = 0.1  # a step that codecs still take for rest, give or take their own error
STRIDES = (1, 2, 4, 8)
STRAIGHT_PX = 6.0  # path over which the centre of a mark follows a quartic to 0.01 px on turns of 20 px radius


def course_error(time_s: Array, centers_px: Array, stride: int = 1) -> Array:
    """What each centre differs from the course of its neighbours.

    stride: pictures between neighbours. Returns (n, 2), NaN where a neighbour is absent or times are uneven.
    """
    n, margin = len(time_s), REACH * stride
    error = np.full((n, 2), np.nan)
    if n <= 2 * margin:
        return error
    rows = np.arange(margin, n - margin)
    around = rows[:, None] + stride * OFFSETS
    error[rows] = centers_px[rows] - np.einsum("j,njk->nk", WEIGHTS, centers_px[around])
    usual = np.median(np.diff(time_s))
    lapse = time_s[around] - time_s[rows][:, None] - stride * OFFSETS * usual
    error[rows[np.abs(lapse).max(axis=1) > 0.1 * usual]] = np.nan
    return error


def hidden_variance(time_s: Array, centers_px: Array, variances: Array, kinds: NDArray[np.str_]) -> Array:
    """Variance per axis, px², to add to every picture's own, from all that the course of a mark tells; (n,).

    A slow mark rests in the codec's memory for some pictures, so that neighbours share their error: neighbours farther
    away tell more. variances: mean of the axes (n,), NaN where absent. kinds: of `codec_variance`.
    """
    # Pictures where something was in the way have an uncertainty of their own, and tell nothing of the codec.
    calm = variances < 3.0 * np.nanmedian(variances) if np.isfinite(variances).any() else np.zeros(len(variances), bool)
    centers_px, variances = np.where(calm[:, None], centers_px, np.nan), np.where(calm, variances, np.nan)
    errors = course_error(time_s, centers_px)
    moving = _moving(centers_px)
    extra = codec_variance(np.where(moving[:, None], errors, np.nan), variances, kinds)
    # At rest a codec keeps one error for long, which nothing shows: it is smaller than in motion, by a third at most.
    rest = codec_variance(np.where(moving[:, None], np.nan, errors), variances, kinds)
    extra = np.where(moving, extra, np.maximum(rest, extra / 3))
    steps = np.hypot(*np.diff(centers_px, axis=0).T)
    speed = float(np.nanmedian(steps)) if np.isfinite(steps).any() else 0.0
    own = float(np.nanmean(variances)) if np.isfinite(variances).any() else 0.0
    most = typical = float(extra.mean())
    for stride in STRIDES[1:]:
        if REACH * stride * speed > STRAIGHT_PX:
            break
        errors = course_error(time_s, centers_px, stride)
        errors = errors[np.isfinite(errors).all(axis=1)]
        if len(errors) >= LEAST * stride:
            most = max(most, robust_square(errors) / (1 + WEIGHTS @ WEIGHTS) - own)
    return extra + (most - typical)


def _moving(centers_px: Array) -> NDArray[np.bool_]:
    """Pictures in which the mark moves by more than MOVING_PX a picture, over three pictures to either side."""
    if len(centers_px) < 7:
        return np.ones(len(centers_px), bool)
    step = np.hypot(*(centers_px[6:] - centers_px[:-6]).T) / 6
    return np.pad(np.nan_to_num(step, nan=np.inf) > MOVING_PX, 3, mode="edge")


def codec_variance(errors: Array, variances: Array, kinds: NDArray[np.str_]) -> Array:
    """Variance to add to every picture, one value for each kind of picture (I, P, B); (n,).

    errors: of `course_error` (n, 2). variances: known already (n,), NaN where absent. kinds: (n,).
    """
    names = np.unique(kinds)
    seen = np.isfinite(errors).all(axis=1)
    rows = np.flatnonzero(seen)
    usable = [name for name in names if (kinds[rows] == name).sum() >= LEAST]
    extra = np.zeros(len(kinds))
    if not usable:
        return extra
    around = rows[:, None] + OFFSETS
    known = variances[rows] + variances[around] @ WEIGHTS**2
    matrix, right = np.zeros((len(usable), len(usable))), np.zeros(len(usable))
    for k, name in enumerate(usable):
        mine = kinds[rows] == name
        right[k] = robust_square(errors[rows[mine]]) - known[mine].mean()
        for m, other in enumerate(usable):
            matrix[k, m] = (k == m) + ((kinds[around[mine]] == other) @ WEIGHTS**2).mean()
    # What all kinds have in common is well known, what tells them apart is not: no kind gets less than a third of it.
    share = np.array([(kinds[rows] == name).mean() for name in usable])
    common = max(float(share @ right / (share @ matrix.sum(axis=1))), 0.0)
    least = np.full(len(usable), common / 3)
    solution = least + _non_negative(matrix, right - matrix @ least)
    for name, value in zip(usable, solution, strict=True):
        extra[kinds == name] = value
    # Kinds too rare to tell (the few I pictures) get the mean of the others: never less than is known of them.
    extra[~np.isin(kinds, usable)] = solution.mean()
    return extra


def robust_square(errors: Array) -> float:
    """Mean square per axis, with what lies beyond 4 robust sigmas (starts, bumps) brought back to there."""
    sigma = 1.4826 * np.median(np.abs(errors)) + 1e-12
    return float(np.mean(np.minimum(errors**2, (4 * sigma) ** 2)))


def _non_negative(matrix: Array, right: Array) -> Array:
    """Least squares with all unknowns at or above zero: the best of all choices of which are zero (there are few)."""
    best, cost = np.zeros(len(right)), float(right @ right)
    for choice in product([False, True], repeat=len(right)):
        free = np.array(choice)
        if not free.any():
            continue
        trial = np.zeros(len(right))
        trial[free] = np.linalg.lstsq(matrix[:, free], right, rcond=None)[0]
        misfit = float(np.sum((matrix @ trial - right) ** 2))
        if (trial >= 0).all() and misfit < cost * (1 - 1e-9):
            best, cost = trial, misfit
    return best
