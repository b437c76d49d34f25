"""Outlying frames: marks that jump away from their neighbours in time and back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter, percentile_filter

from evaluator.robust import PER_MEDIAN, median_of_rows, quantile_of_rows, robust_sigma

Floats = NDArray[np.float64]

AROUND = 13  # frames, six before and six after: of the six pairs two may hold a jump
OUTLIER_STEPS = 2.5  # plus this number of steps between frames: at the start of motion, the midpoint deviates by 1.75
OUTLIER_SIGMAS = 9.0  # a bend of the path at the start is less; tails of ordinary noise beyond add nothing to a fit
# Steps from which the place of an end is extrapolated: where motion begins within them, it is off by 2 steps at most.
ENDS_FROM = (1, 2, 3)
LEAST_SIGMA_MM = 5e-4  # marks without noise, from another program, bend by as much
# Of the distance of two marks: frames around, of which half may be wrong, and the least deviation. A camera that is
# tilted by 10 degrees, or a lens, changes it by less while a robot drives for half a second.
DISTANCE_AROUND, APART_SHARE = 61, 0.01
MARKS, CHANNELS = (slice(0, 2), slice(2, 4)), (slice(0, 2), slice(2, 3), slice(3, 4))  # columns with common outliers


def without_outliers(values: Floats, parts: tuple[slice, ...] = MARKS, *, corners: bool = False) -> Floats:
    """Coordinates (n, 4), mm, with tracking errors, which jump away from their neighbours and back, set to NaN.

    parts: columns that are tested together: marks, or channels of residuals. Residuals of a good model vary slowly, so
    that they show jumps that are hidden in the motion of the marks. A coordinate is an outlier if its distances from
    what the frames around it (the median of the midpoints of pairs), those before and those after it say all exceed
    OUTLIER_SIGMAS robust standard deviations of the first one and OUTLIER_STEPS times the motion between frames: no
    robot leaves its path for one or two frames.

    corners: a frame at which the path turns within few frames, off those around it alone, is an outlier as well. So are
    residuals on open ground, whose poses of 10 Hz are few and whose model without the lag of its drive is off after
    every change: with these frames, four of 24 steps of a Husky counted as other motions.
    """
    cleaned = values.copy()
    for part in parts:
        seen = np.flatnonzero(np.isfinite(values[:, part]).all(axis=1))
        points = values[seen, part]
        if len(points) < AROUND:
            continue
        half, count = AROUND // 2, len(points)
        # halfway between frames as far before as after: of a straight path, whatever its speed, the place itself
        longer = _continued(points, half)
        pairs = [(longer[half - j :][:count] + longer[half + j :][:count]) / 2 for j in range(1, half + 1)]
        said = median_of_rows(pairs)
        off = points - said
        sigma = PER_MEDIAN * median_of_rows(np.abs(off - median_of_rows(off))) + LEAST_SIGMA_MM
        # of the path as the neighbours say it: one jump is two of the steps, more than 5 % of a run of 30 frames
        steps = np.abs(np.diff(said, axis=0))
        step, least = quantile_of_rows(steps, 0.95), np.abs(off)
        if not corners:
            step = np.maximum(step, _usual_about(steps))
            for side in (_before(longer), _before(longer[::-1])[::-1]):
                least = np.minimum(least, np.abs(side[half : half + count] - points))
        limit = np.maximum(OUTLIER_SIGMAS * sigma, OUTLIER_STEPS * step)
        cleaned[seen[(least > limit).any(axis=1)], part] = np.nan
    return cleaned


def _before(path: Floats) -> Floats:
    """A path (n, k) as the frames before each say it, from the first that has enough of them.

    Where motion begins or ends between two frames, those on one side say where it is; a jump is off both.
    """
    most = 2 * ENDS_FROM[-1]
    said = median_of_rows([2 * path[most - j : -j] - path[most - 2 * j : -2 * j] for j in ENDS_FROM])
    return np.concatenate([path[:most], said])


def _usual_about(steps: Floats) -> Floats:
    """The usual step (n + 1, k) around each frame, from the n steps between them: a quarter may be larger.

    Residuals of a model without a ramp of the motors move while that lasts, and not in the other 95 % of a run; without
    these frames the ramp would be unseen.
    """
    size = min(AROUND, len(steps))
    usual = percentile_filter(steps, 75, size=(size, 1), mode="nearest")
    return np.asarray(np.maximum(np.vstack([usual[:1], usual]), np.vstack([usual, usual[-1:]])))


def without_wrong_pairs(values: Floats) -> Floats:
    """Coordinates (n, 4), mm, of two marks, NaN in frames in which they have another distance than in those around.

    A robot is rigid: one of them is then something else, a reflection for example, also for several frames in a row,
    which a path does not show. The camera changes their distance slowly.
    """
    distance = np.hypot(values[:, 0] - values[:, 2], values[:, 1] - values[:, 3])
    seen = np.flatnonzero(np.isfinite(distance))
    if len(seen) < AROUND:
        return values
    usual, cleaned = distance[seen], values.copy()
    limit = OUTLIER_SIGMAS * robust_sigma(np.diff(usual)) / np.sqrt(2)
    limit = max(limit, APART_SHARE * float(np.median(usual)))
    if np.abs(usual - np.median(usual)).max() > limit:  # few runs
        around = median_filter(usual, min(DISTANCE_AROUND, len(usual)), mode="mirror")
        cleaned[seen[np.abs(usual - around) > limit]] = np.nan
    return cleaned


def _continued(points: Floats, frames: int) -> Floats:
    """A path (n, k) extended by frames on both sides, by point reflection about the extrapolated position of its ends.

    The ends themselves are not used, so that a jump in the first or the last frame is detected.
    """
    before, after = (
        2 * median_of_rows([2 * path[j] - path[2 * j] for j in ENDS_FROM]) - path[frames:0:-1]
        for path in (points, points[::-1])
    )
    return np.concatenate([before, points, after[::-1]])
