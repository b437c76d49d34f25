"""Follow a balance through its folds as the ratio of the wheels changes: continuation by arc length.

A point is the ratio right/left and the velocity (u, v, r) in units of the left wheel's surface speed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.integrator.balance import differentiate, unbalance
from simulator.integrator.stability import is_stable

Array = NDArray[np.float64]
RATIO_STEP = 1e-7
MOST_POINTS = 5000
MOST_ITERATIONS = 12
SHORTEST = 1e-7  # arc length at which a branch that cannot be followed is given up


def follow(model: Any, left: float, ratio: float, to_ratio: float, velocity: Array, step: float) -> Array:
    """Points (n, 5) of the branch through a balance: ratio, velocity, and 1 where it is stable.

    velocity: a balance at ratio; step: arc length of the longest step. Ends where the ratio leaves the interval.
    """
    scale = float(model["speed"][0]) * abs(left)
    low, high = min(ratio, to_ratio), max(ratio, to_ratio)
    tangent = np.array([1.0 if to_ratio >= ratio else -1.0, 0.0, 0.0, 0.0])
    first = _corrected(model, left, scale, np.array([ratio, *velocity / scale]), tangent)
    if first is None:
        return np.empty((0, 5))
    (point, matrix, stable), length, found = first, step, []
    while True:
        found.append([point[0], *point[1:] * scale, stable])
        along = np.linalg.solve(matrix, [0.0, 0.0, 0.0, 1.0])
        tangent = along / np.linalg.norm(along)
        following = None
        while following is None and length > SHORTEST:
            following = _corrected(model, left, scale, point + length * tangent, tangent)
            if following is None or np.abs(following[0] - point).max() > 3 * length:
                following, length = None, length / 2
        if following is None or not low <= following[0][0] <= high or len(found) == MOST_POINTS:
            return np.array(found)
        point, matrix, stable = following
        length = min(1.5 * length, step)


def _corrected(model: Any, left: float, scale: float, guess: Array, tangent: Array) -> tuple[Array, Array, bool] | None:
    """The balance nearest to a guess across the tangent, its matrix and stability; None where Newton's method fails."""
    linear, residual, changed = np.zeros((4, 3)), np.empty(3), np.empty(3)
    point, matrix = guess.copy(), np.empty((4, 4))
    for _ in range(MOST_ITERATIONS):
        velocity = point[1:] * scale
        unbalance(model, left, point[0] * left, velocity, residual)
        differentiate(model, left, point[0] * left, velocity, residual, linear)
        unbalance(model, left, (point[0] + RATIO_STEP) * left, velocity, changed)
        matrix[:3, 0] = (changed - residual) / RATIO_STEP
        matrix[:3, 1:] = linear[1:4] * scale
        matrix[3] = tangent
        if not np.isfinite(matrix).all() or not np.isfinite(residual).all():
            return None
        try:
            change = np.linalg.solve(matrix, [*-residual, tangent @ (guess - point)])
        except np.linalg.LinAlgError:
            return None
        point = point + change
        if np.abs(change).max() < 1e-10:
            return point, matrix, bool(is_stable(linear))
    return None
