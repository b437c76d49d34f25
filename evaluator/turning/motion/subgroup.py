"""Compiled algebra of one-parameter planar motions: prediction, closest point and derivatives, frame by frame.

Coordinates as in steady_motion.py: (x, y, length · heading) in mm. Algebra of SE(2): Murray, Li and Sastry, Robotic
Manipulation (1994), chapter 2.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibration.compilation import compiled

Array = NDArray[np.float64]


@compiled()
def _ratios(angle: float) -> tuple[float, float, float, float]:
    """(sin a)/a, (1 − cos a)/a, (1 − cos a)/a², (a − sin a)/a²; below 0.05 rad by series exact to 1e-13."""
    if abs(angle) < 0.05:
        square = angle * angle
        cosine = 0.5 - square / 24 + square * square / 720
        return (
            1 - square / 6 + square * square / 120 - square * square * square / 5040,
            angle * cosine,
            cosine,
            angle * (1 / 6 - square / 120 + square * square / 5040),
        )
    sinc, cosine = np.sin(angle) / angle, (1 - np.cos(angle)) / (angle * angle)
    return sinc, angle * cosine, cosine, (1 - sinc) / angle


@compiled()
def composed(start: Array, vx: float, vy: float, w: float, length: float) -> tuple[float, float, float]:
    """Pose start · exp(vx, vy, w), w being length times the angle."""
    sinc, cosc, _, _ = _ratios(w / length)
    x, y = sinc * vx - cosc * vy, cosc * vx + sinc * vy
    cos, sin = np.cos(start[2] / length), np.sin(start[2] / length)
    return start[0] + cos * x - sin * y, start[1] + sin * x + cos * y, start[2] + w


@compiled()
def _error(pose: Array, start: Array, twist: Array, along: float, length: float) -> tuple[float, float, float]:
    """Measured minus predicted pose in the predicted body frame."""
    x, y, h = composed(start, along * twist[0], along * twist[1], along * twist[2], length)
    dx, dy = pose[0] - x, pose[1] - y
    cos, sin = np.cos(h / length), np.sin(h / length)
    return cos * dx + sin * dy, -sin * dx + cos * dy, pose[2] - h


@compiled()
def linearise(
    scaled: Array, start: Array, twist: Array, along: Array, across: Array, length: float
) -> tuple[Array, Array, Array]:
    """Closest points on the motion, deviations across it and their derivatives.

    scaled: (n, 3) measured poses; start, twist: (3,); along: (n,) initial values of the closest points; across: (3, 2).
    Returns along (n,), deviation (n, 2), and the derivative of the prediction (n, 2, 4) by start and twist, both
    across. A change of the start shifts a later pose by Ad(exp(-along · twist)); a change of the twist by its integral.
    """
    n = len(scaled)
    found, residual, design = np.empty(n), np.empty((n, 2)), np.empty((n, 2, 4))
    vx, vy = twist[0], twist[1]
    adjoint, integral = np.zeros((3, 3)), np.zeros((3, 3))
    adjoint[2, 2] = 1.0
    for i in range(n):
        t = along[i]
        for _ in range(3):
            ex, ey, eh = _error(scaled[i], start, twist, t, length)
            t += ex * twist[0] + ey * twist[1] + eh * twist[2]
        ex, ey, eh = _error(scaled[i], start, twist, t, length)
        found[i] = t
        turn, lever = t * twist[2] / length, t / length
        cos, sin = np.cos(turn), np.sin(turn)
        sinc, cosc, cos2, sin2 = _ratios(turn)
        adjoint[0, 0], adjoint[0, 1], adjoint[0, 2] = cos, sin, lever * (cosc * vx - sinc * vy)
        adjoint[1, 0], adjoint[1, 1], adjoint[1, 2] = -sin, cos, lever * (sinc * vx + cosc * vy)
        integral[0, 0], integral[0, 1], integral[0, 2] = t * sinc, t * cosc, t * lever * (sin2 * vx - cos2 * vy)
        integral[1, 0], integral[1, 1], integral[1, 2] = -t * cosc, t * sinc, t * lever * (cos2 * vx + sin2 * vy)
        integral[2, 2] = t
        for c in range(2):
            residual[i, c] = across[0, c] * ex + across[1, c] * ey + across[2, c] * eh
            for p in range(2):
                by_start, by_twist = 0.0, 0.0
                for a in range(3):
                    for b in range(3):
                        share = across[a, c] * across[b, p]
                        by_start += share * adjoint[a, b]
                        by_twist += share * integral[a, b]
                design[i, c, p], design[i, c, 2 + p] = by_start, by_twist
    return found, residual, design
