"""Friction that varies along the path of a run, as on an unevenly clean plate.

Each run has its own friction; on a polished, greasy or dusty plate, friction also varies along the path, by a per cent
or two over a centimetre, and no model predicts where. A diagnosis that assumed constant friction within a run would
explain this variation by effects that depend on position (a gradient, a stray magnet) or on direction (a grain), and
would reject long runs as outlying.

Friction is modelled as a random walk along the path, about its mean over the run. Its cosine modes are independent
(Karhunen-Loève). The response of the path to a mode follows from the response to constant friction without another
simulation: velocities balance the wheels' forces at every instant (the slow manifold), so that a change of friction
changes the velocity in the body frame in proportion, and only at that instant.

Friction also differs between both sides of a robot. If slip is far from its limit, the difference has more influence:
in twelve turns of one robot, opposite changes of friction under the left and right wheels moved the path 2 to 23 times
as far as an equal change under all wheels. This follows from the same walk, because friction over the plate is one
random surface (Lévy's Brownian surface), without a further parameter.
The rate of the walk is estimated from all runs together: see common_drift.py.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MODES = 10  # contain 94 % of the variance of a walk about its mean: 1 - (6/π²)·Σ 1/k² beyond
# Modes of the difference between the sides, which varies over the width of a robot, and samples of it in time.
UNEVEN_MODES, SAMPLES = 16, 80
# Relative change of friction after 1 mm of path; it grows with the root of the distance. The effect of the least rate
# is below the precision of a model; above 3 %, 10 % after a centimetre, a laboratory cleans its plate.
RATES = (0.0, *np.geomspace(3e-4, 3e-2, 9).tolist())
BEGIN = 4  # in the middle of them
USUAL_WANDER = RATES[BEGIN]  # assumed before the rate is estimated: see common_drift.USUAL_DRIFT


def wander_shifts(channels: Floats, per_friction: Floats, half_distance_mm: float) -> Floats:
    """Response (MODES, n, 4) in mm to one standard deviation of each mode of friction with a rate of 1 after 1 mm.

    Arguments as in shift_by.
    """
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(channels[:, :2], axis=0).T))])
    length = max(float(way[-1]), 1e-9)
    waves = np.pi * np.arange(1, MODES + 1)[:, None]
    friction = np.sqrt(2 * length) / waves * np.cos(waves * (way[1:] + way[:-1]) / 2 / length)
    return np.array([shift_by(mode, channels, per_friction, half_distance_mm) for mode in friction])


def uneven_shifts(
    channels: Floats, per_difference: Floats, sides_mm: tuple[Floats, Floats], half_distance_mm: float
) -> Floats:
    """Response (UNEVEN_MODES, n, 4) in mm to different friction of both sides, with a rate of 1 after 1 mm.

    Of one standard deviation of each mode of half the difference of friction, left minus right. per_difference: (n, 4)
    mm, response of the channels to a constant half difference of 1. sides_mm: centres of the left and of the right
    wheels on the plate, (n,) each, x + iy.
    """
    steps = len(channels) - 1
    chosen = np.unique(np.linspace(0, steps, min(steps + 1, SAMPLES)).astype(int))
    left, right = (side[chosen] for side in sides_mm)
    apart, alike = np.abs(left[:, None] - right), sum(np.abs(side[:, None] - side) for side in (left, right))
    # the variogram of the surface is the distance: 1/2 for its covariance, 1/4 for half differences
    covariance = (apart + apart.T - alike) / 8
    variances, vectors = np.linalg.eigh(covariance)
    largest = np.sqrt(np.maximum(variances[-UNEVEN_MODES:], 0.0)) * vectors[:, -UNEVEN_MODES:]
    middle = np.arange(steps) + 0.5
    modes = [np.interp(middle, chosen, mode) for mode in largest.T]
    return np.array([shift_by(mode, channels, per_difference, half_distance_mm) for mode in modes])


def shift_by(friction: Floats, channels: Floats, per_friction: Floats, half_distance_mm: float) -> Floats:
    """Response (n, 4) in mm of the channels of a run to small relative changes of friction (n - 1,) between its frames.

    channels: (n, 4), predicted, of which only the midpoint is used, see features.channels_of. per_friction: (n, 4) mm,
    response to a constant relative change of 1. The response is zero in the first frame, because the start pose is
    free.
    """
    path = np.diff(channels[:, 0] + 1j * channels[:, 1])
    turned = per_friction[:, 2] / half_distance_mm
    moved = np.diff(per_friction[:, 0] + 1j * per_friction[:, 1])
    # without the contribution of the accumulated error of heading: the change of the velocity in the body frame
    pushed = moved - 1j * (turned[1:] + turned[:-1]) / 2 * path
    heading = np.concatenate([[0.0], np.cumsum(friction * np.diff(turned))])
    steps = friction * pushed + 1j * (heading[1:] + heading[:-1]) / 2 * path
    shift = np.concatenate([[0.0], np.cumsum(steps)])
    return np.column_stack([shift.real, shift.imag, heading * half_distance_mm, np.zeros(len(shift))])


@dataclass(frozen=True)
class Whitening:
    """(1 + U·Uᵀ)^(-1/2), which whitens noise with the covariance 1 + U·Uᵀ, U (d, k).

    turned: U·V (d, k) with the eigenvectors V of Uᵀ·U. squares: its eigenvalues (k,).
    """

    turned: Floats
    squares: Floats

    def of(self, features: Floats) -> Floats:
        """Whitened features, (d,) or (m, d)."""
        return np.asarray(features + ((features @ self.turned) * self.shares) @ self.turned.T)

    @property
    def shares(self) -> Floats:
        """Factors (k,) of the update of features along each column of turned."""
        return self._shares(1 / np.sqrt(1 + self.squares))

    def undone(self, features: Floats) -> Floats:
        """Features (d,) or (m, d) before whitening."""
        shares = self._shares(np.sqrt(1 + self.squares))
        return np.asarray(features + ((features @ self.turned) * shares) @ self.turned.T)

    @property
    def log_det(self) -> float:
        """Log determinant of the covariance."""
        return float(np.sum(np.log1p(self.squares)))

    def _shares(self, scaled: Floats) -> Floats:
        return np.asarray((scaled - 1) / np.maximum(self.squares, 1e-300))


def whitening(columns: Floats) -> Whitening:
    """Whitening of noise with random parts (d, k), each of variance 1."""
    squares, vectors = np.linalg.eigh(columns.T @ columns)
    return Whitening(columns @ vectors, np.maximum(squares, 0.0))
