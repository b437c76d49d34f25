"""Least-squares fit of a blurred elliptical disc to the pixels around each candidate dot.

Model of a pixel at x, with q² = (x-c)ᵀ A (x-c) and the distance to the edge taken to first order, d = (q-1)/|∇q| =
(q²-q)/|A(x-c)|:

    I(x) = (1 + g·(x-c)) · (b + a·Φ(-d/s))

b: background, a: dot minus background, g: relative slope of the light, s: edge blur (lens and pixel together), Φ:
normal distribution. The image of a disc under perspective is an ellipse; in a symmetric model, errors of the shape of
the blur do not affect the centre c. Gauss-Newton on ten parameters; for white noise it is the maximum-likelihood
estimate, and the inverse normal matrix times the residual variance is its covariance.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from math import pi, sqrt

import numpy as np
from numpy.typing import NDArray

from calibration.compilation import compiled

Array = NDArray[np.float64]
PARAMETERS = 10  # cx, cy, A11, A12, A22, s, b, a, gx, gy
ITERATIONS = 25  # most steps of a fit; three or four are usual, see below
ROOT_TWO_PI = 1 / sqrt(2 * pi)
SHARED = 1000  # dots from which on threads are faster
# Convergence: last step of the centre, px, and relative step of blur and contrast. Each step reduces the error at least
# 25 times (measured at SNR 30), because residuals are small compared with the contrast, so that 2e-4 px remain.
RESTS_PX, RESTS_SHARE = 5e-3, 0.03

MOST_PIXELS = 500  # along a side of the square around a dot: its derivatives take 28 MB


@compiled(fastmath=True)
def _density(t):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Normal density for 0 ≤ t ≤ 4 to 4e-7 of itself: exp(x) = exp(x/32)³², which runs on several pixels at once."""
    x = -0.5 / 32.0 * t * t
    e = 1.0 + x * (1.0 + x * (0.5 + x * (1 / 6 + x * (1 / 24 + x * (1 / 120 + x / 720)))))
    for _ in range(5):
        e *= e
    return e * ROOT_TWO_PI


@compiled(fastmath=True)
def _tail(t, density):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Φ(-t) for t ≥ 0 from the normal density at t to 8e-8 (Abramowitz and Stegun 26.2.17), with no second exp."""
    k = 1.0 / (1.0 + 0.2316419 * t)
    return density * k * (0.319381530 + k * (-0.356563782 + k * (1.781477937 + k * (-1.821255978 + k * 1.330274429))))


@compiled(fastmath=True)
def collect_pixels(plane, start, reach, longest, pixels):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Collect x, y and value of the pixels within reach of the start ellipse in (3, m) work space; returns their count.

    They are chosen once, so that every iteration uses the same pixels. For a very large dot only every k-th pixel in
    each row and column is used: MOST_PIXELS² pixels determine its centre well enough.
    """
    x0, y0, half = round(start[0]), round(start[1]), int(longest + reach + 2.5)
    stride = 1 + int((2 * half + 1) / MOST_PIXELS)
    count = 0
    for iy in range(max(0, y0 - half), min(plane.shape[0] - 1, y0 + half) + 1, stride):
        for ix in range(max(0, x0 - half), min(plane.shape[1] - 1, x0 + half) + 1, stride):
            dx, dy = ix - start[0], iy - start[1]
            ux, uy = start[2] * dx + start[3] * dy, start[3] * dx + start[4] * dy
            q2 = dx * ux + dy * uy
            if q2 > 1.0 and (q2 - sqrt(q2)) > reach * sqrt(ux * ux + uy * uy):
                continue
            pixels[0, count], pixels[1, count], pixels[2, count] = ix, iy, plane[iy, ix]
            count += 1
    return count


@compiled(fastmath=True)
def derivatives(pixels, count, p, rows):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Fill rows (11, pixels) with the ten derivatives of the model at the pixels, and the residual.

    Without branches, so that the compiler vectorises it. Four blurs from the edge the model is constant.
    """
    cx, cy, a11, a12, a22, s, b, a, gx, gy = p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8], p[9]
    for k in range(count):
        dx, dy = pixels[0, k] - cx, pixels[1, k] - cy
        ux, uy = a11 * dx + a12 * dy, a12 * dx + a22 * dy
        q2 = dx * ux + dy * uy
        q = sqrt(q2) + 1e-9
        w = 1.0 / (sqrt(ux * ux + uy * uy) + 1e-12)
        d = (q2 - q) * w
        t = d / s
        off = min(abs(t), 4.0)
        edge = _density(off) if off < 4.0 else 0.0
        tail = _tail(off, edge)
        cover = tail if t >= 0.0 else 1.0 - tail
        light = 1.0 + gx * dx + gy * dy
        level = b + a * cover
        down = -light * a * edge / s  # dI/dd
        along_q, along_w = down * (2.0 * q - 1.0) * w / q, -down * d * w * w
        rows[0, k] = -along_q * ux - along_w * (a11 * ux + a12 * uy) - gx * level
        rows[1, k] = -along_q * uy - along_w * (a12 * ux + a22 * uy) - gy * level
        rows[2, k] = 0.5 * along_q * dx * dx + along_w * ux * dx
        rows[3, k] = along_q * dx * dy + along_w * (ux * dy + uy * dx)
        rows[4, k] = 0.5 * along_q * dy * dy + along_w * uy * dy
        rows[5, k] = light * a * edge * t / s
        rows[6, k], rows[7, k], rows[8, k], rows[9, k] = light, light * cover, level * dx, level * dy
        rows[10, k] = pixels[2, k] - light * level


@compiled(fastmath=True)
def _accumulate(pixels, count, p, rows, N, rhs):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Normal equations over the pixels; returns the sum of squares. rows: (11, pixels) work space."""
    derivatives(pixels, count, p, rows)
    for i in range(N.shape[0]):  # not a constant: LLVM would write out each of the 65 sums, most of the kernel's code
        for j in range(i + 1):
            value = 0.0
            for k in range(count):
                value += rows[i, k] * rows[j, k]
            N[i, j] = value
        value = 0.0
        for k in range(count):
            value += rows[i, k] * rows[10, k]
        rhs[i] = value
    value = 0.0
    for k in range(count):
        value += rows[10, k] * rows[10, k]
    return value


@compiled(fastmath=True)
def _factor(N, damping, scale, L):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Cholesky factor of the scaled, damped normal matrix; False if it is not positive definite."""
    n = N.shape[0]
    for i in range(n):
        scale[i] = 1.0 / sqrt(N[i, i]) if N[i, i] > 0.0 else 0.0
    for i in range(n):
        for j in range(i + 1):
            value = N[i, j] * scale[i] * scale[j]
            if i == j:
                value = 1.0 + damping
            for k in range(j):
                value -= L[i, k] * L[j, k]
            if i == j:
                if value <= 1e-12:
                    return False
                L[i, i] = sqrt(value)
            else:
                L[i, j] = value / L[j, j]
    return True


@compiled(fastmath=True)
def _solve(L, scale, rhs, x):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    n = L.shape[0]
    for i in range(n):
        value = rhs[i] * scale[i]
        for k in range(i):
            value -= L[i, k] * x[k]
        x[i] = value / L[i, i]
    for i in range(n - 1, -1, -1):
        value = x[i]
        for k in range(i + 1, n):
            value -= L[k, i] * x[k]
        x[i] = value / L[i, i]
    for i in range(n):
        x[i] *= scale[i]


@compiled(fastmath=True)
def _center_covariance(L, scale, variance, rhs, step, cov):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Covariance (2, 2) of the first two parameters from the factor of the normal matrix; rhs, step: work space."""
    for k in range(2):
        for m in range(10):
            rhs[m] = 0.0
        rhs[k] = variance
        _solve(L, scale, rhs, step)
        cov[0, k] = step[0]
        cov[1, k] = step[1]


@compiled(fastmath=True)
def _moved(p, step, rhs, trial):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Set the trial parameters after a step; returns the predicted decrease of the sum of squares (linear model)."""
    gain = 0.0
    for k in range(10):
        trial[k] = p[k] + step[k]
        gain += rhs[k] * step[k]
    return gain


@compiled(fastmath=True)
def _is_disc(trial, start, longest):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Whether trial parameters still describe an ellipse with an edge near the start."""
    ellipse = trial[5] > 0.15 and trial[2] > 0 and trial[2] * trial[4] > trial[3] * trial[3]
    return ellipse and abs(trial[0] - start[0]) < longest and abs(trial[1] - start[1]) < longest


@compiled(fastmath=True)
def _rests(p, step):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Whether a step is short enough for convergence."""
    return (
        abs(step[0]) + abs(step[1]) < RESTS_PX
        and abs(step[5]) < RESTS_SHARE * p[5]
        and abs(step[7]) < RESTS_SHARE * abs(p[7])
    )


@compiled(fastmath=True)
def _fit_one(plane, start, reach, p, cov):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Fit one dot in place; returns the residual standard deviation, NaN if the fit failed."""
    N, L, work = np.empty((10, 10)), np.zeros((10, 10)), np.empty((4, 10))
    rhs, scale, step, trial = work[0], work[1], work[2], work[3]
    longest = sqrt(max(start[2], start[4]) / (start[2] * start[4] - start[3] * start[3]))
    box = min(2 * int(longest + reach + 2.5) + 1, MOST_PIXELS) ** 2
    pixels, rows = np.empty((3, box)), np.empty((11, box))
    count = collect_pixels(plane, start, reach, longest, pixels)
    for k in range(10):
        p[k] = start[k]
    total = _accumulate(pixels, count, p, rows, N, rhs)
    damping, done = 1e-3, False
    for _ in range(ITERATIONS):
        if count < 20 or not _factor(N, damping, scale, L):
            return np.nan
        _solve(L, scale, rhs, step)
        gain = _moved(p, step, rhs, trial)
        good = _is_disc(trial, start, longest)
        rests = good and _rests(p, step)  # converged: the normal matrix of this step is used for the covariance
        before = total
        if rests:
            total -= gain
        elif good:
            total = _accumulate(pixels, count, trial, rows, N, rhs)
            good = total <= before * (1.0 + 1e-9)
        if good:
            for k in range(10):
                p[k] = trial[k]
            damping *= 0.1
        else:
            damping = max(damping * 10.0, 1e-4)
            total = _accumulate(pixels, count, p, rows, N, rhs)
            rests = abs(step[0]) + abs(step[1]) < 2e-3  # no improvement at the resolution of the pixels
        if rests:
            done = True
            break
    if not done or count <= 12 or not _factor(N, 0.0, scale, L):
        return np.nan
    variance = total / (count - 10)
    _center_covariance(L, scale, variance, rhs, step, cov)
    return sqrt(variance)


@compiled()  # not with fastmath, which assumes that there is no NaN
def _fits_in(shape, start, reach):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Whether a start is an ellipse no larger than the image; a degenerate one would need unlimited memory."""
    determinant = start[2] * start[4] - start[3] * start[3]
    if not (determinant > 0.0 and start[2] > 0.0):
        return False
    size = float(max(shape[0], shape[1]))
    inside = -size < start[0] < 2.0 * size and -size < start[1] < 2.0 * size
    return inside and sqrt(max(start[2], start[4]) / determinant) + reach < size


@compiled(nogil=True)
def _fit_some(plane, starts, reach, first, last, fitted, covariance, noise):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Fit dots first to last (excluded); results are written to fitted, covariance and noise."""
    for i in range(first, last):
        if _fits_in(plane.shape, starts[i], reach[i]):
            noise[i] = _fit_one(plane, starts[i], reach[i], fitted[i], covariance[i])


def fit_dots(plane: NDArray[np.float32], starts: Array, reach: Array) -> tuple[Array, Array, Array]:
    """Fit all dots. plane: (h, w); starts: (n, 10); reach: (n,) px beyond the edge to use.

    Returns parameters (n, 10), covariance of the centre (n, 2, 2) px², residual standard deviation (n,), NaN if a fit
    failed.
    """
    n = len(starts)
    found = np.full((n, PARAMETERS), np.nan), np.full((n, 2, 2), np.nan), np.full(n, np.nan)
    if n < SHARED:
        _fit_some(plane, starts, reach, 0, n, *found)
        return found
    ends = np.linspace(0, n, (os.cpu_count() or 1) + 1).astype(int).tolist()
    with ThreadPoolExecutor(len(ends) - 1) as pool:
        list(pool.map(lambda first, last: _fit_some(plane, starts, reach, first, last, *found), ends, ends[1:]))
    return found
