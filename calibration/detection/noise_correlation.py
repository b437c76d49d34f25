"""Increase of the uncertainty of dot centres by noise that is correlated between pixels.

Single-chip colour cameras interpolate three quarters of their values, and codecs and resizing mix pixels, while the fit
assumes independent pixels. With S the influence of the pixels on a centre and ρ the autocorrelation of the noise, the
variance of the centre is larger by Σ ρ(lag) (S⋆S)(lag) / (S⋆S)(0). ρ is estimated from the residuals of some dots,
corrected for the part Jᵀ(J Jᵀ)⁻¹J that the fit removes from white residuals.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibration.compilation import compiled
from calibration.detection.ellipse_fit import MOST_PIXELS, collect_pixels, derivatives

Array = NDArray[np.float64]
REACH = 3  # px: interpolation of single-chip colour reaches two, codecs mix blocks of eight
SAMPLE = 24  # dots, whose 7000 pixels determine the factor on white noise to 4 %
SHAPES = 4  # of these dots for which the influence matrices are computed; they hardly differ from dot to dot
SOUND = 1.2  # of the median residual, for undisturbed dots


def correlation_factors(plane: NDArray[np.float32], fitted: Array, reach: Array, noise: Array) -> Array:
    """Factors (2,) on the standard deviations of x and y of all centres of an image, at least 1.

    plane, reach: as for `fit_dots`; fitted (n, 10), noise (n,): its results.
    """
    sound = np.flatnonzero(noise <= SOUND * np.median(noise)) if len(noise) else np.empty(0, dtype=np.int64)
    if len(sound) < SAMPLE // 3:
        return np.ones(2)
    chosen = sound[np.linspace(0, len(sound) - 1, min(len(sound), SAMPLE)).astype(np.int64)]
    try:
        residual, own, influence = _autocorrelations(plane, fitted[chosen], reach[chosen], noise[chosen])
    except np.linalg.LinAlgError:  # dots with too few pixels to determine ten parameters
        return np.ones(2)
    correlation = np.median(residual, axis=0) + own
    correlation[REACH, REACH] = 1.0
    return np.asarray(np.sqrt(np.maximum((correlation * influence).sum(axis=(1, 2)), 1.0)))


def _autocorrelations(
    plane: NDArray[np.float32], fitted: Array, reach: Array, noise: Array
) -> tuple[Array, Array, Array]:
    """Autocorrelations by lag: residuals (n, 7, 7), the part removed by the fit (7, 7), influence (2, 7, 7)."""
    n, size = len(fitted), 2 * REACH + 1
    residual, own, influence = np.zeros((n, size, size)), np.zeros((size, size)), np.zeros((2, size, size))
    every = max(1, n // SHAPES)
    for i, p in enumerate(fitted):
        longest = float(np.sqrt(max(p[2], p[4]) / (p[2] * p[4] - p[3] * p[3])))
        half = int(longest + reach[i] + 2.5)
        box, room = 2 * (half + REACH) + 1, min(2 * half + 1, MOST_PIXELS) ** 2
        pixels, rows = np.empty((3, room)), np.empty((11, room))
        count = _rows_of(plane, p, reach[i], longest, pixels, rows)
        places = pixels[:2, :count] + half + REACH - np.rint(p[:2])[:, None]
        lags = np.maximum(_lags(places, np.ones((1, count)), box)[0], 1.0)
        residual[i] = _lags(places, rows[10:, :count] / noise[i], box)[0] / lags
        if i % every == 0:
            by = rows[:10, :count]
            by /= np.sqrt((by**2).sum(axis=1))[:, None]  # equal scales for factorisation; no result depends on them
            normal = by @ by.T
            own += _lags(places, np.linalg.solve(np.linalg.cholesky(normal), by), box).sum(axis=0) / lags
            moved = _lags(places, np.ascontiguousarray(np.linalg.solve(normal, by)[:2]), box)
            influence += moved / moved[:, REACH, REACH, None, None]
    shapes = (n + every - 1) // every
    return residual, own / shapes, influence / shapes


@compiled(fastmath=True)
def _rows_of(plane, p, reach, longest, pixels, rows):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Fill pixels (3, m) and rows (11, m) for a fitted dot; returns the number of pixels."""
    count = collect_pixels(plane, p, reach, longest, pixels)
    derivatives(pixels, count, p, rows)
    return count


@compiled(fastmath=True)
def _lags(pixels, values, box):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Autocorrelation sums (m, 7, 7) by lag of each row of values (m, n) over the pixels; box: size of their grid."""
    found = np.zeros((len(values), 2 * REACH + 1, 2 * REACH + 1))
    image = np.zeros((box, box))
    for m in range(len(values)):
        for k in range(values.shape[1]):
            image[int(pixels[1, k]), int(pixels[0, k])] = values[m, k]
        for down in range(REACH + 1):
            for across in range(-REACH, REACH + 1):
                value = 0.0
                for y in range(REACH, box - REACH):
                    for x in range(REACH, box - REACH):
                        value += image[y, x] * image[y + down, x + across]
                found[m, REACH + down, REACH + across] = found[m, REACH - down, REACH - across] = value
    return found
