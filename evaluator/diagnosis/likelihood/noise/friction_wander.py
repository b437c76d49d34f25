"""Friction that varies along the path of a run, as on an unevenly clean plate.

Each run has a friction of its own; where the plate is polished, greasy or dusty, friction also changes while the robot
drives, by a per cent or two over a centimetre. No model predicts where. A diagnosis that took friction for constant
within a run would explain what such places do by effects that act somewhere on the plate (a gradient, a stray magnet)
or in some directions (a grain), and would call a run that drove far an outlying one.

Friction is taken for a random walk along the way, about its mean over the run. Its cosine modes are independent
(Karhunen-Loève). What one of them does to the path follows from what a friction that is changed throughout does,
without another simulation: velocities balance the wheels' forces at every instant (the slow manifold), so a change of
friction changes the velocity in the body frame at that instant alone, in proportion.

Such a plate is not alike under both sides of a robot either. Where slip is far from its limit, that matters more: in
twelve turns of one robot, friction that is changed under the left wheels against the right moved the path 2 to 23 times
as far as the same change under all wheels. It follows from the same walk, as friction over the plate is one surface
(Lévy's Brownian surface), and asks for no further number.
How large the walk is, is asked of all runs together: see common_drift.py.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MODES = 10  # hold 94 % of the variance of a walk about its mean: 1 - (6/π²)·Σ 1/k² beyond
# Of the difference between the sides, which changes over the width of a robot, and frames between which it is even.
UNEVEN_MODES, SAMPLES = 16, 80
# Relative change of friction after 1 mm of way; it grows with the root of the way. The least does less to any path than
# a model's precision; of more than 3 %, 10 % after a centimetre, a laboratory wipes its plate.
RATES = (0.0, *np.geomspace(3e-4, 3e-2, 9).tolist())
BEGIN = 4  # in the middle of them
USUAL_WANDER = RATES[BEGIN]  # what a model is fitted with before it is known: see common_drift.USUAL_DRIFT


def wander_shifts(channels: Floats, per_friction: Floats, half_distance_mm: float) -> Floats:
    """What friction that walks by 1 after 1 mm does, one standard deviation of each of its modes: (MODES, n, 4) mm.

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
    """What a plate whose friction walks by 1 in 1 mm does by being uneven: (UNEVEN_MODES, n, 4) mm.

    One standard deviation of each mode of the friction under the left side over that under the right, half of their
    difference. per_difference: (n, 4) mm, what 1 of that throughout does to the channels. sides_mm: the middles of the
    left and of the right wheels on the plate, (n,) each, x + iy.
    """
    steps = len(channels) - 1
    chosen = np.unique(np.linspace(0, steps, min(steps + 1, SAMPLES)).astype(int))
    left, right = (side[chosen] for side in sides_mm)
    apart, alike = np.abs(left[:, None] - right), sum(np.abs(side[:, None] - side) for side in (left, right))
    # of a surface with a variogram as long as the distance: half of the differences of the distances, for half of it
    covariance = (apart + apart.T - alike) / 8
    variances, vectors = np.linalg.eigh(covariance)
    largest = np.sqrt(np.maximum(variances[-UNEVEN_MODES:], 0.0)) * vectors[:, -UNEVEN_MODES:]
    middle = np.arange(steps) + 0.5
    modes = [np.interp(middle, chosen, mode) for mode in largest.T]
    return np.array([shift_by(mode, channels, per_difference, half_distance_mm) for mode in modes])


def shift_by(friction: Floats, channels: Floats, per_friction: Floats, half_distance_mm: float) -> Floats:
    """What small relative changes of friction (n - 1,) between the frames of a run do to its channels, (n, 4) mm.

    channels: (n, 4) of the run as predicted, of which the midpoint counts, see features.channels_of. per_friction:
    (n, 4) mm, what a relative change of 1 throughout does to them. The shift is zero at the first frame: the start pose
    is free.
    """
    path = np.diff(channels[:, 0] + 1j * channels[:, 1])
    turned = per_friction[:, 2] / half_distance_mm
    moved = np.diff(per_friction[:, 0] + 1j * per_friction[:, 1])
    # without what the heading does that is off by then: the change of the velocity in the body frame
    pushed = moved - 1j * (turned[1:] + turned[:-1]) / 2 * path
    heading = np.concatenate([[0.0], np.cumsum(friction * np.diff(turned))])
    steps = friction * pushed + 1j * (heading[1:] + heading[:-1]) / 2 * path
    shift = np.concatenate([[0.0], np.cumsum(steps)])
    return np.column_stack([shift.real, shift.imag, heading * half_distance_mm, np.zeros(len(shift))])


@dataclass(frozen=True)
class Whitening:
    """(1 + U·Uᵀ)^(-1/2), which makes noise of variance 1 with random parts U (d, k) white: U turned, and by how much.

    turned: U·V (d, k) with the eigenvectors V of Uᵀ·U. squares: its eigenvalues (k,).
    """

    turned: Floats
    squares: Floats

    def of(self, features: Floats) -> Floats:
        """Features (d,) or (m, d), white."""
        return np.asarray(features + ((features @ self.turned) * self.shares) @ self.turned.T)

    @property
    def shares(self) -> Floats:
        """By how much of itself each of the turned parts moves what lies along it, (k,)."""
        return self._shares(1 / np.sqrt(1 + self.squares))

    def undone(self, features: Floats) -> Floats:
        """Features (d,) or (m, d) as they were before."""
        shares = self._shares(np.sqrt(1 + self.squares))
        return np.asarray(features + ((features @ self.turned) * shares) @ self.turned.T)

    @property
    def log_det(self) -> float:
        """Of the covariance."""
        return float(np.sum(np.log1p(self.squares)))

    def _shares(self, scaled: Floats) -> Floats:
        return np.asarray((scaled - 1) / np.maximum(self.squares, 1e-300))


def whitening(columns: Floats) -> Whitening:
    """Of random parts (d, k), each of variance 1."""
    squares, vectors = np.linalg.eigh(columns.T @ columns)
    return Whitening(columns @ vectors, np.maximum(squares, 0.0))
