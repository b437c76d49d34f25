"""Whitening of noise that is correlated in time, in one pass: a Kalman filter as compiled kernel.

Noise model: a stationary process with exponential correlation (Ornstein and Uhlenbeck 1930), plus a white share.
Tracking errors are fixed to the image, which rotates relative to a turning body: the process may therefore rotate with
the heading, and each channel shows one component. Gaps need no filling. The cost is linear in frames and columns.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibration.compilation import compiled

Array = NDArray[np.float64]


@compiled()
def whitened_moments(
    steps: Array, turns: Array, data: Array, correlation: float, white_share: float
) -> tuple[Array, float]:
    """Second moments of whitened columns, and half the log determinant of the noise covariance.

    steps: (n - 1,) frame intervals between successive rows; turns: (n - 1,) rotation of the body between them, rad
    (zeros for noise fixed to the body). data: (n, c, q), c channels of unit variance that share the noise model.
    Returns (q, q), and the sum over rows and channels of the log standard deviations of the innovations.
    """
    n, channels, columns = data.shape
    moments = np.zeros((columns, columns))
    first = np.zeros((channels, columns))
    second = np.zeros((channels, columns))
    row = np.empty(columns)
    process = 1.0 - white_share
    p11, p12, p22 = process, 0.0, process
    log_spread = 0.0
    for i in range(n):
        if i > 0:
            # Most steps are of one interval, and half of the models do not rotate: a power or a cosine would take as
            # long as all the rest.
            fade = abs(correlation) if steps[i - 1] == 1.0 else abs(correlation) ** steps[i - 1]
            if correlation < 0 and round(steps[i - 1]) % 2 == 1:
                fade = -fade
            cos, sin = (np.cos(turns[i - 1]), np.sin(turns[i - 1])) if turns[i - 1] != 0.0 else (1.0, 0.0)
            a, b = fade * cos, fade * sin
            fresh = (1.0 - fade * fade) * process
            q11 = a * a * p11 + 2 * a * b * p12 + b * b * p22 + fresh
            q12 = -a * b * p11 + (a * a - b * b) * p12 + a * b * p22
            q22 = b * b * p11 - 2 * a * b * p12 + a * a * p22 + fresh
            p11, p12, p22 = q11, q12, q22
        else:
            a, b = 1.0, 0.0
        variance = p11 + white_share
        spread = np.sqrt(variance)
        gain1, gain2 = p11 / variance, p12 / variance
        for c in range(channels):
            for k in range(columns):
                m1 = a * first[c, k] + b * second[c, k]
                m2 = -b * first[c, k] + a * second[c, k]
                innovation = data[i, c, k] - m1
                first[c, k] = m1 + gain1 * innovation
                second[c, k] = m2 + gain2 * innovation
                row[k] = innovation / spread
            for k in range(columns):
                for j in range(k + 1):
                    moments[k, j] += row[k] * row[j]
        log_spread += channels * np.log(spread)
        p22 -= gain2 * p12
        p12 -= gain1 * p12
        p11 -= gain1 * p11
    for k in range(columns):
        for j in range(k):
            moments[j, k] = moments[k, j]
    return moments, log_spread
