"""Uneven light, which shifts the fitted centre of a mark toward its brighter side: measured inside the mark, corrected.

A disc whose luma is (base + amplitude·P)·(1 + β·d), d from its centre, is fitted by the even model with its centre
shifted by β·(½∫P² + (base/amplitude)∫P) / (π∫P'²r dr), about √π·s·R·β: 0.01 px at R = 20, s = 0.8 where the light falls
by 0.04 % a pixel, as it does by vignetting of a quarter toward the corners. β of one frame is noisier than the
centre, but it changes smoothly with place: a plane β(x, y) is fitted over the whole recording.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluator.recording import Frame
from evaluator.robust import PER_MEDIAN
from evaluator.tracking.refinement import kernels
from evaluator.tracking.refinement.disc import PER_PX, Disc

Array = NDArray[np.float64]

# Prior (1 sigma) from lenses and lamps: light changes by 0.1 % per pixel, and this slope by 1e-3 over 200 px. Without
# enough frames the prior dominates, and nothing is corrected.
PRIOR = np.diag([1e-3, 5e-6, 5e-6]) ** 2
LEAST = 8
# Share of the shift by a mark's own shade that remains: balls and domes have a terminator, and a camera's gamma bends
# light.
BENT = 0.1
FAR, ROUNDS = 4.0, 3  # sigmas beyond which a slope is not the light's; fits, each without the last one's outliers


@dataclass(frozen=True)
class Shading:
    """Plane of relative slopes β over the frame: β = (1, x - x0, y - y0) · coefficients. gain: shift over β, px²."""

    origin_px: Array
    coefficients: Array
    covariance: Array
    gain: float

    def shift(self, centers_px: Array) -> tuple[Array, Array]:
        """Shift of fitted centres (n, 2), px, and its variance per axis (n,)."""
        basis = _basis(centers_px, self.origin_px)
        variance = np.einsum("ni,ij,nj->n", basis, self.covariance, basis) * self.gain**2
        return self.gain * basis @ self.coefficients, variance


def interior_px(disc: Disc) -> float:
    """Radius within which the blurred edge changes the luma by less than 1 %; 0 if that is too small to measure.

    Below 4 px, codec blocks and blur look like slopes, and the corresponding shift is below 0.005 px.
    """
    inner = disc.radius_px - 2.5 * disc.blur_px
    return inner if inner > 4.0 else 0.0


def bent_shade(disc: Disc) -> Array:
    """Variances along x and y and covariance, px², of the centre of a shaded disc: its shade is only about linear."""
    x, y = BENT * np.sqrt(np.pi) * disc.blur_px * disc.radius_px * np.array(disc.shade)
    return np.array([x * x, y * y, x * y])


class LightNotes:
    """Slopes of the luma inside a mark, collected during tracking."""

    def __init__(self) -> None:
        """Start with none."""
        self.interior_px = 0.0  # of `interior_px`; 0: nothing is noted
        self._black, self._slope = 0.0, np.zeros(2)
        self._places: list[tuple[float, float]] = []
        self._slopes: list[tuple[float, float]] = []
        self._sloped: set[float] = set()

    def note_fit(self, time_s: float, *, sloped: bool) -> None:
        """Record whether the fit at a time included a slope, so that its centre is not shifted."""
        (self._sloped.add if sloped else self._sloped.discard)(time_s)

    def shifted(self, time_s: Array) -> NDArray[np.bool_]:
        """Whether the centres fitted at times (n,) are shifted by uneven light."""
        return ~np.isin(time_s, list(self._sloped))

    def note(self, frame: Frame, place: tuple[float, float], known: tuple[float, float] = (0.0, 0.0)) -> None:
        """Measure how unevenly a mark is lit at its centre, px; known: slopes that its own shade has, levels a px."""
        if self.interior_px == 0.0:
            return
        kernels.interior_slope(frame.luma, frame.row_origin, frame.row_step, *place, self.interior_px, self._slope)
        self._black = frame.black
        self._places.append(place)
        self._slopes.append((float(self._slope[0]) - known[0], float(self._slope[1]) - known[1]))

    def learnt(self, disc: Disc) -> Shading | None:
        """Uneven light from all records; disc: of the mark."""
        if not self._places:
            return None
        return learn_shading(disc, self._black, np.array(self._places), np.array(self._slopes))


def learn_shading(disc: Disc, black: float, centers_px: Array, slopes: Array) -> Shading | None:
    """Fit the plane; None where too few frames show it.

    black: luma of no light. centers_px, slopes (levels a px): (m, 2), of many frames.
    """
    light = disc.amplitude + disc.base - black
    seen = np.isfinite(slopes).all(axis=1)
    if seen.sum() < LEAST or disc.amplitude <= 0 or light <= 0:
        return None
    origin = centers_px[seen].mean(axis=0)
    basis, beta = _basis(centers_px[seen], origin), slopes[seen] / light
    usual = np.median(beta, axis=0)
    for _ in range(ROUNDS):
        # A passing wire or glare causes slopes thirty times those of the light: outliers.
        off = beta - usual
        spread = PER_MEDIAN * np.median(np.abs(off), axis=0) + 1e-9
        kept = (np.abs(off) < FAR * spread).all(axis=1)
        variance = float(np.mean(spread**2))
        covariance = np.linalg.inv(basis[kept].T @ basis[kept] / variance + np.linalg.inv(PRIOR))
        coefficients = np.asarray(covariance @ basis[kept].T @ beta[kept] / variance)
        usual = basis @ coefficients
    return Shading(origin, coefficients, np.asarray(covariance), _gain(disc, black))


def _gain(disc: Disc, black: float) -> float:
    r = np.arange(len(disc.profile)) / PER_PX
    p, g = disc.profile, disc.slope
    numerator = np.sum(p * p * r) / 2 + (disc.base - black) / disc.amplitude * np.sum(p * r)
    return float(2 * numerator / np.sum(g * g * r))


def _basis(centers_px: Array, origin_px: Array) -> Array:
    return np.column_stack([np.ones(len(centers_px)), centers_px - origin_px])
