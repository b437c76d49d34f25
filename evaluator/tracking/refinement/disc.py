"""Model of a mark: an oblique disc blurred by lens and pixels; its profile and fit.

Profile of a uniform disc of radius R blurred by a Gaussian of standard deviation s, against its radius r:
dP/dr = -(R/s²)·exp(-(r-R)²/2s²)·i1e(rR/s²), the integral of the Gaussian's gradient along the edge (divergence
theorem). P follows by integration from outside. A pixel adds a variance of 1/12 px² to s² (box of one pixel), which is
included in the learnt s.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import i0e, i1e

from evaluator.tracking.refinement import kernels

Array = NDArray[np.float64]
PER_PX = 32  # entries of the profile per pixel, so that linear interpolation errs by 1e-4 of the amplitude
# Entries of the kernel's table per step of the squared radius that is one px at the edge. The nearest entry is then at
# most 1/256 px away at the edge, and the errors of the pixels (0.1 levels for a mark of 120) average out.
PER_EDGE_PX = 128
# Entries below this are set to zero. Their squares would be denormal numbers of single precision, which processors
# handle a hundred times more slowly (a mark of 20 px radius took 2.6 times as long), and they carry no information.
NOTHING = 1e-15
NO_SHADE = 0.0, 0.0


class Edge(NamedTuple):
    """An edge, and a second edge at a right angle to it, counterclockwise as the image shows it.

    angle: of the normal, rad. distance_px, aside_px: of the two edges from the mark's centre. height: luma beyond the
    edge minus luma before it, levels.
    """

    angle: float
    distance_px: float
    aside_px: float
    height: float


@dataclass(frozen=True)
class Disc:
    """Shape of a mark in the frame.

    radius_px, blur_px: of the disc and its edge; e1, e2: slant, r² = (1+e1) dx² + 2 e2 dx dy + (1-e1) dy². amplitude,
    base: luma of the mark above its surroundings, and luma of the surroundings. noise: variance of the luma. profile,
    slope: see `tabulate`. table: see `by_square`. edge: last fitted edge of the body if it affects the mark's rim.
    shade: relative change of the mark's luma along x and y, 1/px, where a mark that is not flat is lit from one side.
    A lens blurs the shaded disc, (1 + shade·d) times a step, into (1 + shade·d) times an edge that lies blur²·shade
    nearer to the dark side: kernels shift it by that.
    """

    radius_px: float
    blur_px: float
    e1: float
    e2: float
    amplitude: float
    base: float
    noise: float
    profile: Array
    slope: Array
    table: NDArray[np.float32]
    occluded: float = 0.0
    edge: Edge | None = None
    shade: tuple[float, float] = NO_SHADE

    @property
    def outer_px(self) -> float:
        """Radius of the pixels used: the disc, its blurred edge, and a ring that determines the base.

        At most 1.5 radii: on the paper's robot, the edge of the black top lies beyond.
        """
        return outer_px(self.radius_px, self.blur_px)

    def numbers(self, smear_px: tuple[float, float] = (0.0, 0.0)) -> Array:
        """The numbers of the disc as `kernels.fit_disc` expects them."""
        shape = self.radius_px, self.blur_px, self.e1, self.e2
        return np.array([*shape, self.outer_px, *smear_px, _per_px2(self.radius_px), *self.shade])

    @property
    def unclear(self) -> float:
        """Variance of the noise over the squared contrast."""
        return self.noise / max(self.amplitude**2, 1e-9)

    def unlike(self, other: Disc) -> float:
        """The part of the slant difference of two discs that exceeds three sigmas of their noise."""
        return float(np.hypot(self.e1 - other.e1, self.e2 - other.e2)) - 3.0 * (self._unsure() + other._unsure())

    @property
    def brightest_px(self) -> tuple[float, float]:
        """Centre of the light of a shaded disc, and of its colour, from the disc's own centre."""
        x, y = self.shade
        return 0.25 * self.radius_px**2 * x, 0.25 * self.radius_px**2 * y

    def _unsure(self) -> float:
        """Standard uncertainty of a slant from six frames; an edge error of c·cos 2φ causes a slant of 2c/R."""
        return (
            2.0
            / self.radius_px
            * float(
                np.sqrt(2 * np.sqrt(np.pi) * self.blur_px / (np.pi * self.radius_px) * self.noise / 6.0)
                / abs(self.amplitude)
            )
        )


def tabulate(radius_px: float, blur_px: float) -> Array:
    """Profile of a blurred disc and its derivatives, against radius up to 6 blurs beyond the edge; (3, m).

    The derivatives are by the distance from the centre and by the disc's radius. PER_PX entries per pixel.
    """
    r, s2 = np.arange(0.0, radius_px + 6.0 * blur_px + 2.0, 1.0 / PER_PX), blur_px**2
    tables = np.zeros((3, len(r)))
    profile, slope, grown = tables
    first = int(max(radius_px - 6.0 * blur_px, 0.0) * PER_PX)  # the profile is constant within this radius
    edge = r[first:]
    ring = (radius_px / s2) * np.exp(-((edge - radius_px) ** 2) / (2 * s2))
    slope[first:], grown[first:] = -ring * i1e(edge * radius_px / s2), ring * i0e(edge * radius_px / s2)
    profile[:-1] = -np.cumsum((slope[1:] + slope[:-1])[::-1])[::-1] / (2 * PER_PX)
    return tables


def make_disc(
    radius_px: float, blur_px: float, slant: tuple[float, float], level: tuple[float, float], noise: float
) -> Disc:
    """A disc with its tables. slant: e1, e2; level: amplitude, base; noise: variance."""
    profile, slope, _ = tabulate(radius_px, blur_px)
    return Disc(radius_px, blur_px, *slant, *level, noise, profile, slope, by_square(radius_px, profile, slope))


def shaped_as(own: Disc, shape: Disc) -> Disc:
    """A disc with the levels and the shade of `own` and the shape and noise of `shape`."""
    levels = own.amplitude, own.base
    disc = make_disc(shape.radius_px, shape.blur_px, (shape.e1, shape.e2), levels, shape.noise)
    return replace(disc, edge=own.edge, shade=own.shade)


def by_square(radius_px: float, profile: Array, slope: Array) -> NDArray[np.float32]:
    """Profile, and slope over radius, against the squared radius, so that kernels need no square roots."""
    radii = np.arange(len(profile)) / PER_PX
    r = np.sqrt(np.arange(int(radii[-1] ** 2 * _per_px2(radius_px))) / _per_px2(radius_px))
    over_radius = slope / np.maximum(radii, 1e-9)
    over_radius[0] = over_radius[1]
    table = np.stack([np.interp(r, radii, profile), np.interp(r, radii, over_radius)], axis=1)
    table[np.abs(table) < NOTHING] = 0.0
    return table.astype(np.float32)


def _per_px2(radius_px: float) -> float:
    return PER_EDGE_PX / (2.0 * radius_px)


def outer_px(radius_px: float, blur_px: float) -> float:
    """Radius of the pixels that a disc is fitted to, as `Disc.outer_px`."""
    return float(radius_px + max(2.5 * blur_px, min(0.5 * radius_px, 4.0)))


def fit(
    luma: NDArray[np.unsignedinteger],
    rows: tuple[int, int],
    center_px: tuple[float, float],
    disc: Disc,
    smear_px: tuple[float, float] = (0.0, 0.0),
) -> Array:
    """Fit a disc once, from a start; returns the numbers of `kernels.fit_disc`."""
    result = np.full(kernels.RESULTS, np.nan)
    start = np.array([*center_px, disc.amplitude, disc.base])
    noise = np.array([disc.noise, 4.0])
    kernels.fit_disc(luma, *rows, start, False, disc.numbers(smear_px), disc.table, noise, result)
    return result
