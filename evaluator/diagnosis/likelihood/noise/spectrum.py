"""Spectrum of a residual: powers of cosine modes, for irregular and missing frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from scipy.fft import dct

Floats = NDArray[np.float64]

SLOWEST_HZ = 0.6  # the misfit of a model lives below: a robot needs seconds to cross the plate or to turn
MEDIAN_OF_POWER = 0.4549  # of its mean: a squared normal number, chi-square with one degree of freedom
TAPERED = 0.514  # share of the modes of a tapered series that are independent: mean(taper²)² / mean(taper⁴)


@dataclass(frozen=True)
class Spectrum:
    """Cosine-mode powers of one channel of one run: frequencies, Hz, and squared orthonormal coefficients, mm²."""

    frequency_hz: Floats
    power_mm2: Floats
    step_s: float


def spectrum(time_s: Floats, residual_mm: Floats) -> Spectrum:
    """Cosine modes of a residual after subtraction of its smooth part, a polynomial in time.

    Without the polynomial the ends of a drifting residual would leak into the fast modes. Missing samples (NaN, dropped
    frames) are filled with the modes below SLOWEST_HZ, fitted to the others: this adds no fast power, and reduces the
    power of white noise equally at all frequencies above, in proportion to the samples present. A vibration with gaps
    is partly white, here as in the slow modes of the fit. Tapering confines a vibration of some micrometres to a few
    modes; otherwise its side lobes would raise all of them.
    Source: von Hann's window in Harris (1978), Proc. IEEE 66, 51.
    """
    good = np.isfinite(residual_mm)
    slots, step_s = _frame_slots(time_s)
    grid, seen = step_s * np.arange(slots[-1] + 1), slots[good]
    degree = int(np.clip(SLOWEST_HZ * grid[-1], 1, 12))  # less than half a wave per SLOWEST_HZ: noise stays
    smooth = Polynomial.fit(grid[seen], residual_mm[good], degree)
    filled = np.zeros(len(grid))
    filled[seen] = residual_mm[good] - smooth(grid[seen])
    if len(seen) < len(grid):
        missing = np.setdiff1d(np.arange(len(grid)), seen)
        filled[missing] = _slow_part(filled[seen], seen, missing, int(2 * SLOWEST_HZ * grid[-1]) + 1)
    taper = np.sin(np.pi * (np.arange(len(grid)) + 0.5) / len(grid)) ** 2
    coefficients = np.asarray(dct(filled * taper / np.sqrt(np.mean(taper**2)), type=2, norm="ortho"))
    frequency = np.arange(len(grid)) / (2 * len(grid) * step_s)
    present = float(np.sum(taper[seen] ** 2) / np.sum(taper**2))
    return Spectrum(frequency[1:], coefficients[1:] ** 2 / present, step_s)


def _slow_part(values: Floats, seen: NDArray[np.int64], missing: NDArray[np.int64], modes: int) -> Floats:
    """Values of missing slots from the slowest modes, fitted to the values in the other slots."""
    count = max(int(seen[-1]), int(missing[-1])) + 1

    def waves(slots: NDArray[np.int64]) -> Floats:
        return np.asarray(np.cos(np.pi * np.arange(modes) * ((slots[:, None] + 0.5) / count)))

    known = waves(seen)
    normal = known.T @ known  # regularized below, because the samples do not determine the modes within a long gap
    fitted = np.linalg.solve(normal + 1e-2 * np.trace(normal) / modes * np.eye(modes), known.T @ values)
    return np.asarray(waves(missing) @ fitted)


def _frame_slots(time_s: Floats) -> tuple[NDArray[np.int64], float]:
    """Index of every frame (n,), including dropped frames before it, and the frame interval, s.

    Each sample keeps its value in its slot. Resampling on a grid of the median interval, which is 2 % wrong for times
    rounded to a millisecond, would average neighbouring samples: this reduces the fast power of white noise and makes
    it appear correlated, so that the power of slow modes was overestimated by up to half.
    """
    steps = np.diff(time_s)
    slots = np.concatenate([[0], np.cumsum(np.maximum(np.rint(steps / np.median(steps)), 1).astype(np.int64))])
    return slots, float((time_s[-1] - time_s[0]) / slots[-1])
