"""Errors that a single frame cannot show: those of the video codec, from how smoothly marks move.

A codec shifts a mark as a whole by a fraction of its motion vector's step (a quarter of a pixel in H.264), without a
trace in the residuals of the fit. The error is visible between frames: marks move smoothly, so that the deviation of a
centre from the course of its neighbours in time is an error.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from evaluator.tracking.uncertainty.course import EXACT_PX2, LEAST, Course, clipped_squares
from evaluator.tracking.uncertainty.motion_changes import changes_of_motion
from evaluator.tracking.uncertainty.shared_errors import of_distance, shared_variance

Array = NDArray[np.float64]

ROUNDS = 3  # of reweighting, after which sigmas have converged to 3 %
FEW = 8  # moving frames that suffice to detect an error in a short motion
MOVING_PX = 0.1  # step below which codecs treat a mark as resting
# Errors of codecs have long tails like Student's t with about as many degrees of freedom: with H.264, HEVC and VP9 0.5
# to 1.5 % of frames lie beyond 4 sigma.
FREEDOM = 4.0
TAIL = 3.0  # sigmas of deviation beyond which the error of a frame counts as one of the tail


def hidden_variance(
    time_s: Array, centers_px: Array, variances: Array, kinds: NDArray[np.str_],
    abrupt: NDArray[np.bool_] | None = None, apart_px: Array | None = None,
) -> Array:  # fmt: skip
    """Variance per axis, px², to add to that of every frame, from the smoothness of the course of a mark; (n,).

    The codec may repeat the image of a slow mark for some frames, so that neighbours share their error; neighbours
    farther away reveal it. variances: mean of the axes (n,), NaN where absent. kinds: of `codec_variance`. abrupt: of
    `changes_of_motion`, if it is known from other marks of the body. apart_px: distance from one of these (n,).
    """
    # Frames with an occlusion have their own uncertainty, and do not show the codec's errors.
    calm = variances < 3.0 * np.nanmedian(variances) if np.isfinite(variances).any() else np.zeros(len(variances), bool)
    centers_px, quiet = np.where(calm[:, None], centers_px, np.nan), np.where(calm, variances, np.nan)
    course = Course(time_s, centers_px)
    moving, stated = _moving(centers_px), course.variance(quiet)
    telling = course.known & ~(changes_of_motion([course]) if abrupt is None else abrupt)
    extra = codec_variance(course, telling & moving, stated, kinds)
    # At rest a codec keeps one invisible error for a long time; it is at most a third smaller than in motion.
    rest = codec_variance(course, telling & ~moving, stated, kinds)
    extra = np.where(moving, extra, np.maximum(rest, extra / 3))
    known = float(extra.mean()) + (float(np.nanmean(quiet)) if np.isfinite(quiet).any() else 0.0)
    shared = shared_variance(time_s, centers_px, course, telling, known)
    if shared > 0.0 and apart_px is not None:
        shared = min(shared, of_distance(time_s, np.where(calm, apart_px, np.nan)))
    extra = extra + shared
    return extra + _tail(course, quiet + extra)


def _tail(course: Course, variances: Array) -> Array:
    """Variance to add to frames that deviate from their course by more than TAIL sigmas; (n,).

    The mean of the variance of an error with Student's t distribution, given the observed deviation.
    """
    square = (course.error**2).sum(axis=1) / course.variance(variances)
    factor = (FREEDOM + np.nan_to_num(square)) / (FREEDOM + course.error.shape[1])
    return np.asarray(np.nan_to_num(variances) * np.where(np.nan_to_num(square) > TAIL**2, factor - 1.0, 0.0))


def _moving(centers_px: Array) -> NDArray[np.bool_]:
    """Frames in which the mark moves by more than MOVING_PX per frame, over three frames on either side."""
    if len(centers_px) < 7:
        return np.ones(len(centers_px), bool)
    step = np.hypot(*(centers_px[6:] - centers_px[:-6]).T) / 6
    return np.pad(np.nan_to_num(step, nan=np.inf) > MOVING_PX, 3, mode="edge")


def codec_variance(course: Course, chosen: NDArray[np.bool_], known: Array, kinds: NDArray[np.str_]) -> Array:
    """Variance to add to every frame, one value for each kind of frame (I, P, B); (n,).

    chosen: frames used for the estimate (n,). known: known variance of the errors of the course (n,), NaN where absent.
    kinds: (n,).
    """
    rows = np.flatnonzero(chosen)
    extra = np.zeros(len(kinds))
    if len(rows) < FEW:
        return extra
    _, kind = np.unique(kinds, return_inverse=True)
    usable = np.flatnonzero(np.bincount(kind[rows]) >= LEAST)
    if len(usable) == 0:
        kind, usable = np.zeros_like(kind), np.array([0])
    mine = kind[rows] == usable[:, None]
    alike = kind[course.around[:, rows]] == usable[:, None, None]
    shares = (course.squares[:, rows] * alike).sum(axis=1)  # shares of the neighbours' variances in that of an error
    known, square = known[rows], np.zeros(len(rows))
    for one in mine:
        square[one] = clipped_squares(course.error[rows[one]])
    # A frame with a large known variance (a smear, an occlusion) says little about the added variance, and an
    # overstated variance would hide the others: squares are weighted by the inverse of their own variance.
    total = known + square.mean() + EXACT_PX2
    for _ in range(ROUNDS):
        weights = mine / total**2
        solution = _shared_out(weights, shares + mine, square - known)
        total = known + solution @ (shares + mine) + EXACT_PX2
    # Rare kinds of frames (I frames) get the mean of the others, but never less than their own estimate.
    of_kind = np.full(kind.max() + 1, solution.mean())
    of_kind[usable] = solution
    return np.asarray(of_kind[kind])


def _shared_out(weights: Array, shares: Array, excess: Array) -> Array:
    """Variance of each of k kinds of frames from the squares of n errors beyond the known variance; (k,).

    weights: (k, n), of the errors in the estimate of their kind, 0 for other kinds. shares: (k, n), of the kinds'
    variances in that of each error. excess: px² (n,).
    """
    weights = weights / weights.sum(axis=1, keepdims=True)
    matrix, right = weights @ shares.T, weights @ excess
    # The common part of all kinds is well determined, differences between them are not: each gets at least a third of
    # it.
    share = np.count_nonzero(weights, axis=1) / weights.shape[1]
    least = np.full(len(right), max(float(share @ right / (share @ matrix.sum(axis=1))), 0.0) / 3)
    return np.asarray(least + _non_negative(matrix, right - matrix @ least))


def _non_negative(matrix: Array, right: Array) -> Array:
    """Non-negative least squares, by trying all subsets of unknowns that are zero (there are few)."""
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
