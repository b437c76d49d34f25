"""Errors of two marks on one body, from changes of their distance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evaluator.robust import PER_MEDIAN
from evaluator.tracking.uncertainty.course import LEAST, robust_square

Array = NDArray[np.float64]

# Sigmas of a distance beyond which one of its ends is wrong: chance reaches them once in 1.5e5 frames. An error of one
# mark of 9 sigmas along the line is found in 97 % of frames.
BEYOND = 4.5
NEAR = 10  # frames that determine a mark's course: a cubic through them follows all motion but starts and stops
CLEARLY = 2.0  # ratio of the deviations from the course, beyond which the more deviating mark is the wrong one
FEWEST = 2 * LEAST  # frames: the ten unknowns of the surface leave four fifths of the degrees of freedom
CLIPPED = 4.0  # robust sigmas beyond which a distance has no influence on the surface


class Distance:
    """Deviation of the distance of two marks from its expectation.

    error: px, (n,), NaN where a mark is absent or too few frames show both. along: unit vectors from the first to the
    second mark (n, 2). freedom: share of the degrees of freedom that remains after the fit of the expected distance.
    """

    def __init__(self, first_px: Array, second_px: Array) -> None:
        """first_px, second_px: (n, 2), NaN where absent.

        Perspective and lens change the distance smoothly with position and direction: the expectation is a second-order
        surface in position, with the first two harmonics of direction, fitted without outliers.
        """
        apart = second_px - first_px
        distance = np.hypot(apart[:, 0], apart[:, 1])
        self.error = np.full(len(distance), np.nan)
        self.along = apart / np.maximum(distance, 1e-9)[:, None]
        self.freedom = 1.0
        seen = np.isfinite(distance)
        if seen.sum() < FEWEST:
            return
        surface = _smooth((first_px[seen] + second_px[seen]) / 2, np.arctan2(apart[seen, 1], apart[seen, 0]))
        measured = distance[seen]
        left = measured - np.median(measured)
        for _ in range(4):
            keep = np.abs(left) <= CLIPPED * PER_MEDIAN * np.median(np.abs(left)) + 1e-9
            used = surface[keep]
            ridge = 1e-9 * len(used) * np.eye(surface.shape[1])
            left = measured - surface @ np.linalg.solve(used.T @ used + ridge, used.T @ measured[keep])
        self.error[seen] = left
        self.freedom = 1.0 - surface.shape[1] / len(left)

    def variance(self, first: Array, second: Array) -> Array:
        """Variance of the distance from those of the marks; first, second: (n, 3) of var x, var y and covariance."""
        x, y = self.along.T
        total = first + second
        return np.asarray(x * x * total[:, 0] + y * y * total[:, 1] + 2 * x * y * total[:, 2])

    def ratio(self, variance: Array) -> float:
        """Squared scatter of the distance over the expected variance; NaN for too few frames."""
        normal = self.error / np.sqrt(variance)
        normal = normal[np.isfinite(normal)]
        # Distances far beyond the tails are due to a wrong end (`wrong_ends`), not to the marks' usual errors.
        if not len(normal):
            return float("nan")
        normal = normal[np.abs(normal) <= 2 * CLIPPED * PER_MEDIAN * np.median(np.abs(normal))]
        return robust_square(normal[:, None]) / self.freedom


def wrong_ends(
    time_s: Array, numbers: tuple[Array, Array], distance: Distance | None = None
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Frames in which the first and in which the second mark is wrong, because their distance is.

    numbers: of both marks (n, 5) x, y, their variances and covariance, px and px². distance: theirs, if already known.
    The mark that deviates clearly more from its course is wrong; both, if the courses do not decide.
    """
    one, other = numbers
    distance = distance or Distance(one[:, :2], other[:, :2])
    variance = distance.variance(one[:, 2:], other[:, 2:])
    odd = np.abs(distance.error) > BEYOND * np.sqrt(variance)
    wrong = np.zeros(len(odd), bool), np.zeros(len(odd), bool)
    for row in np.flatnonzero(odd):
        off = [_off_course(time_s, mark, ~odd, int(row)) for mark in numbers]
        for k in range(2):
            wrong[k][row] = not off[1 - k] > CLEARLY * off[k]
    return wrong


def _off_course(time_s: Array, mark: Array, usable: NDArray[np.bool_], row: int) -> float:
    """Distance of a mark from the cubic through the frames around, in sigmas; NaN where there are too few."""
    rows = np.flatnonzero(usable & np.isfinite(mark[:, 0]))
    rows = np.sort(rows[np.argsort(np.abs(rows - row), kind="stable")[:NEAR]])
    if len(rows) < NEAR or abs(rows - row).max() > 2 * NEAR:
        return float("nan")
    span = float(np.ptp(time_s[rows]))
    powers = np.vander((time_s[rows] - time_s[row]) / span, 4, increasing=True)
    weights = np.linalg.pinv(powers)[0]  # the value at the frame itself
    off = mark[row, :2] - weights @ mark[rows, :2]
    variance = mark[row, 2:4] + weights**2 @ mark[rows, 2:4]
    return float(np.sqrt(np.sum(off**2 / variance)))


def _smooth(middle_px: Array, angle: Array) -> Array:
    x, y = ((middle_px - middle_px.mean(axis=0)) / (np.ptp(middle_px) + 1e-9)).T
    place = [np.ones_like(x), x, y, x * x, x * y, y * y]
    return np.column_stack([*place, np.cos(angle), np.sin(angle), np.cos(2 * angle), np.sin(2 * angle)])
