"""Deviation of each centre from the smooth path of its neighbours in time, which is tracking error."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evaluator.robust import PER_MEDIAN

Array = NDArray[np.float64]

REACH = 5  # neighbours on either side
OFFSETS = np.delete(np.arange(-REACH, REACH + 1), REACH)  # of the neighbours, in frames
# The course is the quartic through the neighbours by least squares: on a circle of 100 px radius at 0.05 rad a step it
# leaves 1e-3 px. A frame's error needs two more neighbours than the quartic has unknowns, with two of them on either
# side.
ORDER, NEIGHBORS, EITHER_SIDE = 5, 7, 2
EVEN = 1e-3  # of the span: tolerance within which neighbours count as evenly timed and share one set of weights
BEYOND = 4.0  # times the usual range: a neighbour farther away, beyond a gap in time, is not used
LEAST = 24  # differences needed for a variance, whose relative uncertainty is then below 0.3
EXACT_PX2 = 1e-12  # floor of variances in weights: synthetic paths may be exact
CLOCK = 0.06  # of an interval: largest shift by rounding to a clock of 1 ms, at up to 120 frames a second


def steady_times(time_s: Array) -> Array:
    """Times of a recording of constant rate, corrected for rounding by its container; others unchanged; (n,).

    Some containers round by half a millisecond, in which a mark moves by 0.1 px: more than the error of its centre.
    """
    steps = np.diff(time_s)
    if len(steps) < LEAST:
        return time_s
    count = np.concatenate([[0.0], np.cumsum(np.rint(steps / np.median(steps)))])
    middle = count - count.mean()
    interval = float(middle @ time_s / (middle @ middle))
    steady = time_s.mean() + interval * middle
    return steady if np.abs(steady - time_s).max() < CLOCK * interval else time_s


class Course:
    """Deviation of each centre from the course of its neighbours.

    error: (n, 2), NaN if too few neighbours are present. around: rows of the neighbours, weights: theirs, 0 where
    absent, squares: of the weights; all (10, n).
    """

    def __init__(self, time_s: Array, centers_px: Array, stride: int = 1) -> None:
        """time_s: (n,). centers_px: (n, 2), NaN where absent. stride: frames between neighbours."""
        n = len(time_s)
        around = np.arange(n) + stride * OFFSETS[:, None]
        self.around = np.clip(around, 0, max(n - 1, 0))
        seen: NDArray[np.bool_] = np.asarray(np.isfinite(centers_px).all(axis=1))
        usable = (around == self.around) & seen[self.around]
        lapse = time_s[self.around] - time_s
        usual = stride * OFFSETS * float(np.median(np.diff(time_s))) if n > 1 else OFFSETS.astype(float)
        usable &= np.abs(lapse) < BEYOND * abs(usual[0])
        before, after = usable[:REACH].sum(axis=0), usable[REACH:].sum(axis=0)
        enough = (before + after >= NEIGHBORS) & (before >= EITHER_SIDE) & (after >= EITHER_SIDE)
        self.known: NDArray[np.bool_] = seen & enough
        even = self.known & (np.where(usable, np.abs(lapse - usual[:, None]), 0.0).max(axis=0) < EVEN * abs(usual[0]))
        self.weights = np.zeros((len(OFFSETS), n))
        # Evenly timed frames with the same neighbours seen share their weights; nearly all do.
        pattern = (1 << np.arange(len(OFFSETS))) @ usable[:, even]
        _, first, which = np.unique(pattern, return_index=True, return_inverse=True)
        seen_alike = usable[:, even][:, first].T
        self.weights[:, even] = to_the_middle(np.broadcast_to(usual, seen_alike.shape), seen_alike)[which].T
        odd = self.known & ~even
        self.weights[:, odd] = to_the_middle(lapse[:, odd].T, usable[:, odd].T).T
        self.squares = self.weights**2
        course = [(self.weights * axis[self.around]).sum(axis=0) for axis in np.nan_to_num(centers_px).T]
        self.error = np.where(self.known[:, None], centers_px - np.stack(course, axis=1), np.nan)

    def variance(self, variances: Array) -> Array:
        """Variance of the errors, from that of the centres (n,), NaN where absent."""
        return np.asarray(variances + (self.squares * np.nan_to_num(variances)[self.around]).sum(axis=0))


def to_the_middle(lapse_s: Array, usable: NDArray[np.bool_]) -> Array:
    """Weights with which neighbours give the value of their polynomial at lapse 0; all (m, 10)."""
    farthest = np.where(usable, np.abs(lapse_s), 0.0).max(axis=-1, initial=1e-9, keepdims=True)
    powers = (np.where(usable, lapse_s, 0.0) / farthest)[..., None] ** np.arange(ORDER) * usable[..., None]
    # The value at lapse 0 is the first coefficient. If unevenly timed neighbours do not determine all coefficients, the
    # pseudoinverse takes the smallest ones.
    return np.asarray(np.linalg.pinv(powers)[..., 0, :])


def robust_square(errors: Array) -> float:
    """Mean square per axis, with values beyond 4 robust sigmas (starts, bumps) clipped."""
    return float(np.mean(clipped_squares(errors)))


def clipped_squares(errors: Array) -> Array:
    """Mean square of the axes of each error, clipped as in `robust_square`; (n,)."""
    sigma = PER_MEDIAN * np.median(np.abs(errors)) + 1e-12
    return np.asarray(np.minimum(errors**2, (4 * sigma) ** 2).mean(axis=1))
