"""Errors that neighbouring frames share because of the codec's prediction, from frames farther apart."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evaluator.tracking.uncertainty.course import EITHER_SIDE, LEAST, REACH, Course, robust_square

Array = NDArray[np.float64]

STRIDES = (2, 4, 8)  # frames, each twice the one before
# Residual of a path beside its course, px. On turns of 20 px radius it is smaller over a path of STRAIGHT_PX; on wider
# turns, with a radius known from the directions over some frames, over longer paths.
LEAVES_PX, STRAIGHT_PX, DIRECTION = 0.01, 6.0, 5


def shared_variance(time_s: Array, centers_px: Array, near: Course, telling: NDArray[np.bool_], known: float) -> float:
    """Variance per axis, px², beyond the known one, from courses with wider strides.

    near: the course of stride 1; telling: (n,) frames without a change of motion.
    """
    straight, most = straight_frames(centers_px), known
    abrupt = np.append(near.known & ~telling, False)  # no change beyond the ends
    for stride in STRIDES:
        if REACH * stride > straight:
            break
        wide = Course(time_s, centers_px, stride)
        used = wide.known & ~(abrupt[wide.around] & (wide.weights != 0.0)).any(axis=0)
        square, unsure = _square(wide, used)
        # By more than its own standard error: the largest of several estimates is too large by about that.
        if square * (1.0 - unsure) > known:
            most = max(most, square)
    return most - known


def of_distance(time_s: Array, distance_px: Array) -> float:
    """Variance, px², of the distance of two marks with wide strides beyond that with stride 1; at least 0.

    Any motion of a body is common to its marks and leaves their distance unchanged, so that this bounds the errors that
    frames of either mark share. Infinite for too few frames. distance_px: (n,), NaN where absent.
    """
    distance = np.stack([distance_px, distance_px], axis=1)
    near = Course(time_s, distance)
    usual, _ = _square(near, near.known)
    most = -np.inf
    for stride in STRIDES:
        wide = Course(time_s, distance, stride)
        square, unsure = _square(wide, wide.known)
        if square > 0.0:
            most = max(most, square * (1.0 + unsure) - usual)
    return max(most, 0.0) if np.isfinite(most) else np.inf


def _square(course: Course, used: NDArray[np.bool_]) -> tuple[float, float]:
    """Variance of one centre from the errors of frames (n,), and its relative standard error; 0 for too few frames."""
    count = int(used.sum())
    if count < LEAST:
        return 0.0, 1.0
    share = 1.0 + float(course.squares[:, used].sum(axis=0).mean())
    return robust_square(course.error[used]) / share, count**-0.5


def straight_frames(centers_px: Array) -> float:
    """Frames on either side over which the course follows the path of a mark.

    On a circle of radius r a quartic through a path of s to either side leaves at most s⁵/(120 r⁴), Taylor's next term;
    of k frames at a speed v that turn by φ each, s = vk and r = v/φ, that is vφ⁴k⁵/120.
    """
    step = np.diff(centers_px[::DIRECTION], axis=0) / DIRECTION
    step = step[np.isfinite(step).all(axis=1)]
    if len(step) < EITHER_SIDE:
        return np.inf
    speed = float(np.median(np.hypot(*step.T))) + 1e-9
    turn = np.diff(np.unwrap(np.arctan2(step[:, 1], step[:, 0])))
    angle = float(np.median(np.abs(turn))) / DIRECTION + 1e-9
    return float(max(STRAIGHT_PX / speed, (120.0 * LEAVES_PX / (speed * angle**4)) ** 0.2))
