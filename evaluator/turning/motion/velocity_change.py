"""Motion with one change of velocity, sudden or steady within a rise time, fitted to poses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEPS = 8  # integration steps per frame along a path with changing velocity


def left_over(since: Array, pose: Array, rise: float = 0.0) -> tuple[Array, Array]:
    """Residuals of headings (m,), rad, and positions (m, 2), mm, after a fit of a motion with one change of velocity.

    since: (m,) time since the beginning of the change, s. rise: duration of the change, s.
    """
    before, after = _ways(since, rise)
    design = np.column_stack([np.ones_like(since), before, after])
    heading, rates = _fitted(design, pose[:, 2])
    columns = _arcs(since, rates) if rise == 0 else _bent(since, rise, rates)
    moves = np.stack(columns, axis=1)
    still = np.ones((len(since), 1))
    nothing = np.zeros((len(since), 1))
    stacked = np.block([[still, nothing, moves.real], [nothing, still, moves.imag]])
    places = _fitted(stacked, np.concatenate([pose[:, 0], pose[:, 1]]))[0]
    return pose[:, 2] - heading, pose[:, :2] - places.reshape(2, -1).T


def _ways(since: Array, rise: float) -> tuple[Array, Array]:
    """Path lengths (m,) at unit velocity by the velocities before and after a change, measured from its beginning."""
    before, after = np.minimum(since, 0), np.maximum(since, 0)
    if rise == 0:
        return before, after
    rising = np.minimum(after, rise)
    still = rising - rising**2 / (2 * rise)  # share of the former velocity during the change, integrated
    return before + still, after - still


def _arcs(since: Array, rates: Array) -> list[NDArray[np.complex128]]:
    """Arcs driven at unit speed forward and to the left, before a sudden change and after it, x + iy.

    rates: (3,) heading at the change, yaw rates before and after it.
    """
    columns = []
    for part, rate in zip(_ways(since, 0.0), rates[1:], strict=True):
        half = rate * part / 2
        chord = part * np.sinc(half / np.pi)
        angle = rates[0] + half
        columns += [chord * np.exp(1j * angle), 1j * chord * np.exp(1j * angle)]
    return columns


def _bent(since: Array, rise: float, rates: Array) -> list[NDArray[np.complex128]]:
    """Paths as of `_arcs` if the velocity changes steadily within a rise time, by the trapezoidal rule."""
    frames = np.interp(np.arange(STEPS * (len(since) - 1) + 1) / STEPS, np.arange(len(since)), since)
    times = np.unique(np.r_[frames, 0.0])
    before, after = _ways(times, rise)
    way = np.exp(1j * (rates[0] + rates[1] * before + rates[2] * after))
    fading = 1 - np.clip(times / rise, 0, 1)
    columns = []
    for share in (fading, 1 - fading):
        speed = share * way
        path = np.r_[0.0, np.cumsum(np.diff(times) * (speed[1:] + speed[:-1]) / 2)]
        seen = path[np.searchsorted(times, since)]
        columns += [seen, 1j * seen]
    return columns


def _fitted(design: Array, values: Array) -> tuple[Array, Array]:
    """Fit and coefficients of a linear least-squares fit."""
    found: Array = np.linalg.lstsq(design, values, rcond=None)[0].astype(float)
    fit: Array = design @ found
    return fit, found
