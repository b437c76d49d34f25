"""Friction that varies along the path of a run, as on an unevenly clean plate.

Each run has its own friction; on a polished, greasy or dusty plate, friction also varies along the path, by a per cent
or two over a centimetre, and no model predicts where. A diagnosis that assumed constant friction within a run would
explain this variation by effects that depend on position (a gradient, a stray magnet) or on direction (a grain), and
would reject long runs as outlying.

The friction of the plate is modelled as a random surface, whose values differ by a variance proportional to their
distance (Lévy's Brownian surface): along a straight path, a random walk. Under the wheels of a run it is a sum of
independent modes (Karhunen-Loève), about its mean, because each run has its own friction. The response of the path to a
mode follows from the response to constant friction under each wheel without another simulation: velocities balance the
wheels' forces at every instant (the slow manifold), so that a change of friction changes the velocity in the body frame
in proportion, and only at that instant.

Friction also differs from wheel to wheel. If slip is far from its limit, this has more influence: in twelve turns of
one robot, opposite changes under the left and right wheels moved the path 2 to 23 times as far as an equal change under
all wheels. Differences between front and rear wheels matter as well: in a field of 50 × 38 mm, whose uneven places 17
runs crossed again and again, log evidence grew by 142 with them, and a stray magnet that does not exist, with a gain of
60 before, gained nothing.
The rate of the walk is estimated from all runs together: see common_drift.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

Floats = NDArray[np.float64]

MODES = 26  # of all wheels; with 40 or 64 the evidence of a session with wavelengths of 15 to 60 mm did not grow
SAMPLES = 60  # of the path of each wheel; with four wheels the modes of a run take 4 ms
# Relative change of friction after 1 mm of path; it grows with the root of the distance. The effect of the least rate
# is below the precision of a model; above 3 %, 10 % after a centimetre, a laboratory cleans its plate.
RATES = (0.0, *np.geomspace(3e-4, 3e-2, 9).tolist())
BEGIN = 4  # in the middle of them
USUAL_WANDER = RATES[BEGIN]  # assumed before the rate is estimated: see common_drift.usual_drift


def wander_shifts(
    channels: Floats, per_friction: Sequence[Floats], wheels_mm: NDArray[np.complex128], half_distance_mm: float
) -> Floats:
    """Response (MODES, n, 4) in mm to one standard deviation of each mode of friction with a rate of 1 after 1 mm.

    channels: (n, 4), predicted, see features.channels_of. per_friction: response (n, 4) mm of each wheel to a constant
    relative change of 1 of the friction under it. wheels_mm: wheels on the plate, x + iy, (wheels, n).
    """
    steps = len(channels) - 1
    chosen = np.unique(np.linspace(0, steps, min(steps + 1, SAMPLES)).astype(int))
    places = wheels_mm[:, chosen]
    apart = np.abs(places.reshape(-1, 1) - places.reshape(1, -1))
    about_mean = apart - apart.mean(axis=0)
    # the variogram of the surface is the distance
    covariance = -(about_mean - about_mean.mean(axis=1, keepdims=True)) / 2
    variances, vectors = eigh(covariance, subset_by_index=[max(len(covariance) - MODES, 0), len(covariance) - 1])
    largest = np.sqrt(np.maximum(variances, 0.0)) * vectors
    middle = np.arange(steps) + 0.5
    shifts = np.zeros((MODES, *channels.shape))
    for modes, response in zip(largest.T.reshape(-1, *places.shape).swapaxes(0, 1), per_friction, strict=True):
        friction = np.array([np.interp(middle, chosen, mode) for mode in modes])
        shifts[: len(modes)] += shift_by(friction, channels, response, half_distance_mm)
    return shifts


def shift_by(friction: Floats, channels: Floats, per_friction: Floats, half_distance_mm: float) -> Floats:
    """Response (..., n, 4) in mm of the channels of a run to small changes of friction (..., n - 1) between its frames.

    channels: (n, 4), predicted, of which only the midpoint is used, see features.channels_of. per_friction: (n, 4) mm,
    response to a constant relative change of 1. The response is zero in the first frame, because the start pose is
    free.
    """
    path = np.diff(channels[:, 0] + 1j * channels[:, 1])
    turned = per_friction[:, 2] / half_distance_mm
    moved = np.diff(per_friction[:, 0] + 1j * per_friction[:, 1])
    # without the contribution of the accumulated error of heading: the change of the velocity in the body frame
    pushed = moved - 1j * (turned[1:] + turned[:-1]) / 2 * path
    heading = _summed(friction * np.diff(turned))
    shift = _summed(friction * pushed + 1j * (heading[..., 1:] + heading[..., :-1]) / 2 * path)
    return np.stack([shift.real, shift.imag, heading * half_distance_mm, np.zeros(heading.shape)], axis=-1)


def _summed(steps: NDArray[Any]) -> NDArray[Any]:
    """Sums of the steps (..., n - 1) up to every frame, from 0, (..., n)."""
    return np.concatenate([np.zeros_like(steps[..., :1]), np.cumsum(steps, axis=-1)], axis=-1)


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
