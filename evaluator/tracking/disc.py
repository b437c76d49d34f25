"""What a mark looks like: a disc blurred by lens and pixels, seen at a slant; its profile and its shape from pictures.

Profile of a uniform disc of radius R blurred by a Gaussian of standard deviation s, on its radius r:
dP/dr = -(R/s²)·exp(-(r-R)²/2s²)·i1e(rR/s²), the integral of the Gaussian's gradient along the edge (divergence
theorem); P by integration from outside. A pixel adds a variance of 1/12 px² to s² (box of one pixel), which learning
finds itself.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import i0e, i1e

from evaluator.tracking import kernels
from evaluator.tracking.shape_kernel import OWN, PRODUCTS, SHAPE, add_products

Array = NDArray[np.float64]
Learnt = TypeVar("Learnt")
Steps = Generator[None, None, Learnt]  # of something that takes long, so that pictures can be looked at in between
PER_PX = 32  # entries of the profile a pixel: linear interpolation is then exact to 1e-4 of the amplitude
# Entries of the kernel's table for a step of the square radius that is one px at the edge: the nearest one is then off
# by 1/256 px at most, at the edge, and its pixels' errors (0.1 levels of a mark of 120) average out.
PER_EDGE_PX = 128
# Entries below this are zero: far from the edge their squares would be denormal numbers of single precision, with which
# processors take a hundred times as long (a mark of 20 px radius 2.6 times in all), and they tell nothing.
NOTHING = 1e-15


@dataclass(frozen=True)
class Disc:
    """Shape of a mark in the picture.

    radius_px, blur_px: of the disc and its edge; e1, e2: slant, r² = (1+e1) dx² + 2 e2 dx dy + (1-e1) dy². amplitude,
    base: luma of the mark above its surroundings, and of the surroundings. noise: luma variance. profile, slope: of
    `tabulate`. table: of `by_square`.
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
    covered: float = 0.0

    @property
    def outer_px(self) -> float:
        """Radius of the pixels used: the edge and its blur, and a rim to know the base from.

        Beyond 1.5 radii lies, on the paper's robot, the edge of its black top.
        """
        return _outer(self.radius_px, self.blur_px)

    def numbers(self, smear_px: tuple[float, float] = (0.0, 0.0)) -> Array:
        """The disc as `kernels.fit_disc` takes it."""
        shape = self.radius_px, self.blur_px, self.e1, self.e2
        return np.array([*shape, self.outer_px, *smear_px, _per_px2(self.radius_px)])

    @property
    def unclear(self) -> float:
        """Variance of the noise over the square of the contrast."""
        return self.noise / max(self.amplitude**2, 1e-9)

    def unlike(self, other: Disc) -> float:
        """How differently two discs are slanted, beyond three sigmas of what noise makes of that where it is learnt."""
        return float(np.hypot(self.e1 - other.e1, self.e2 - other.e2)) - 3.0 * (self._unsure() + other._unsure())

    def _unsure(self) -> float:
        """Standard uncertainty of a slant from six pictures: an edge off by c·cos 2φ is slanted by 2c/R."""
        return (
            2.0
            / self.radius_px
            * float(
                np.sqrt(2 * np.sqrt(np.pi) * self.blur_px / (np.pi * self.radius_px) * self.noise / 6.0)
                / abs(self.amplitude)
            )
        )


def tabulate(radius_px: float, blur_px: float) -> tuple[Array, Array]:
    """Profile and slope of a blurred disc against radius, PER_PX entries a pixel, to 6 blurs beyond the edge."""
    r = np.arange(0.0, radius_px + 6.0 * blur_px + 2.0, 1.0 / PER_PX)
    s2 = blur_px**2
    slope = -(radius_px / s2) * np.exp(-((r - radius_px) ** 2) / (2 * s2)) * i1e(r * radius_px / s2)
    middle = np.concatenate([[0.0], np.cumsum((slope[1:] + slope[:-1]) / 2)]) / PER_PX
    return np.ascontiguousarray(middle - middle[-1]), np.ascontiguousarray(slope)


def _by_radius(radius_px: float, blur_px: float) -> Array:
    """Derivative of the profile by the disc's radius: a ring blurred, at the radii of `tabulate`."""
    r = np.arange(0.0, radius_px + 6.0 * blur_px + 2.0, 1.0 / PER_PX)
    s2 = blur_px**2
    return np.asarray((radius_px / s2) * np.exp(-((r - radius_px) ** 2) / (2 * s2)) * i0e(r * radius_px / s2))


def make_disc(
    radius_px: float, blur_px: float, slant: tuple[float, float], level: tuple[float, float], noise: float
) -> Disc:
    """Build a disc with its tables. slant: e1, e2; level: amplitude, base; noise: variance."""
    profile, slope = tabulate(radius_px, blur_px)
    return Disc(radius_px, blur_px, *slant, *level, noise, profile, slope, by_square(radius_px, profile, slope))


def shaped_as(own: Disc, shape: Disc) -> Disc:
    """A disc of its own levels with the shape, and the noise, of another."""
    levels = own.amplitude, own.base
    return make_disc(shape.radius_px, shape.blur_px, (shape.e1, shape.e2), levels, shape.noise)


def by_square(radius_px: float, profile: Array, slope: Array) -> NDArray[np.float32]:
    """Profile, and slope over radius, against the square of the radius: neither root nor direction is then needed."""
    radii = np.arange(len(profile)) / PER_PX
    r = np.sqrt(np.arange(int(radii[-1] ** 2 * _per_px2(radius_px))) / _per_px2(radius_px))
    over_radius = slope / np.maximum(radii, 1e-9)
    over_radius[0] = over_radius[1]
    table = np.stack([np.interp(r, radii, profile), np.interp(r, radii, over_radius)], axis=1)
    table[np.abs(table) < NOTHING] = 0.0
    return table.astype(np.float32)


def _per_px2(radius_px: float) -> float:
    return PER_EDGE_PX / (2.0 * radius_px)


@dataclass(frozen=True)
class Patch:
    """Luma around a mark: x, y of its samples in the picture, and the values (all (n,)); the mark is near center_px."""

    x: Array
    y: Array
    value: Array
    center_px: tuple[float, float]


def cut_patch(
    luma: NDArray[np.unsignedinteger], rows: tuple[int, int], center_px: tuple[float, float], half: float
) -> Patch:
    """Copy the samples within half px of a point. rows: row origin and step of the luma."""
    origin, step = rows
    x, y = center_px
    i = np.arange(max(int(np.ceil(x - half)), 0), min(int(x + half), luma.shape[1] - 1) + 1)
    first, last = int(np.ceil((y - half - origin) / step)), int(np.floor((y + half - origin) / step))
    j = np.arange(max(first, 0), min(last, luma.shape[0] - 1) + 1)
    if len(i) == 0 or len(j) == 0:
        return Patch(np.empty(0), np.empty(0), np.empty(0), center_px)
    value = luma[j[0] : j[-1] + 1, i[0] : i[-1] + 1].astype(float)
    grid_y, grid_x = np.meshgrid(origin + step * j.astype(float), i.astype(float), indexing="ij")
    return Patch(grid_x.ravel(), grid_y.ravel(), value.ravel(), center_px)


def learn_disc(patches: list[Patch], radius_px: float, blur_px: float = 1.0) -> Steps[Disc]:
    """Learn radius, blur and slant common to all patches, with centre, amplitude and background free in each.

    Gives way after every step of the fit, and returns the disc: run it by `finished`, or a step a picture. The
    background may slope in each patch: glare that was there from the start is no part of the shape. radius_px, blur_px:
    about what they are. Where some pixels are not the disc's (a wire, a glint), they lose their weight in a second and
    third round. Raises LinAlgError where the patches do not determine a disc.
    """
    shared = np.array([np.log(radius_px), np.log(blur_px), 0.0, 0.0])
    own = [np.array([*patch.center_px, *_levels(patch, radius_px), 0.0, 0.0]) for patch in patches]
    weights = [np.ones_like(patch.value) for patch in patches]
    spread = 1.0
    for _ in range(3):
        shared, own = yield from _solve(patches, weights, shared, own)
        residuals = _residuals(patches, shared, own)
        left = np.concatenate([residual[np.isfinite(residual)] for residual in residuals])
        spread = max(1.4826 * float(np.median(np.abs(left))), 0.3)  # rounding to whole levels leaves 0.29
        if np.mean(np.abs(left) > 5 * spread) < 0.005:
            break
        beyond = [np.square(np.nan_to_num(residual) / (3 * spread)) for residual in residuals]
        weights = [1.0 / (1.0 + square * square) for square in beyond]
    # A codec leaves a flat mark without noise and its edge with much: the median sees the flat alone.
    spread = max(float(np.sqrt(np.mean(np.minimum(left**2, (5 * spread) ** 2)))), 0.3)
    amplitude, base = np.median([mine[2:4] for mine in own], axis=0)
    radius, blur = float(np.exp(shared[0])), float(np.exp(shared[1]))
    slant, level = (float(shared[2]), float(shared[3])), (float(amplitude), float(base))
    return make_disc(radius, blur, slant, level, spread**2)


def finished(steps: Steps[Learnt]) -> Learnt:
    """Take all steps of something at once; returns what it returns."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value  # type: ignore[no-any-return]


def _solve(
    patches: list[Patch], weights: list[Array], shared: Array, own: list[Array]
) -> Steps[tuple[Array, list[Array]]]:
    """Variable projection by Levenberg and Marquardt: each patch's own unknowns are eliminated (Schur complement)."""
    damping, cost = 1e-3, np.inf
    best, pixels, keep = (shared, own), 1, None
    for _ in range(40):
        matrix, right, steps, total, count = _pooled(patches, weights, shared, own)
        yield
        if total < cost:
            done = cost - total < 1e-3 * total  # a shape that is wrong by a thirtieth of its own uncertainty
            best, cost, damping, pixels = (shared, own), total, max(damping / 5, 1e-6), count
            if done:
                break
            keep = matrix, right, steps
        else:
            damping *= 8
            if damping > 1e6:
                break
            if keep is None:
                raise np.linalg.LinAlgError("the patches hold no disc")
            matrix, right, steps = keep
        # Weak prior on the slant: 0.2 covers tilts to 35 degrees; without it small blurred marks leave it free.
        prior = np.diag([0.0, 0.0, 1.0, 1.0]) * (cost / max(pixels, 1) / 0.2**2)
        scaled = matrix + prior + damping * np.diag(np.diag(matrix) + 1e-9)
        move = np.clip(np.linalg.solve(scaled, right - prior @ best[0]), -0.3, 0.3)
        shared = best[0] + move
        shared[1] = np.clip(shared[1], np.log(0.3), shared[0])
        shared[2:] = np.clip(shared[2:], -0.5, 0.5)
        own = [
            mine + np.clip(first - cross @ move, -1e3, 1e3) for mine, (first, cross) in zip(best[1], steps, strict=True)
        ]
    return best


def _residuals(patches: list[Patch], shared: Array, own: list[Array]) -> list[Array]:
    """Luma less model, NaN beyond the pixels that are used."""
    radius, blur = np.exp(shared[:2])
    profile, _ = tabulate(radius, blur)
    residuals = []
    for patch, mine in zip(patches, own, strict=True):
        dx, dy, r = _radii(patch, shared, mine)
        residual = patch.value - mine[3] - mine[2] * _look_up(profile, r) - mine[4] * dx - mine[5] * dy
        residuals.append(np.where(r < _outer(radius, blur), residual, np.nan))
    return residuals


def _radii(patch: Patch, shared: Array, mine: Array) -> tuple[Array, Array, Array]:
    dx, dy = patch.x - mine[0], patch.y - mine[1]
    square = (1 + shared[2]) * dx**2 + 2 * shared[3] * dx * dy + (1 - shared[2]) * dy**2
    return dx, dy, np.sqrt(np.maximum(square, 1e-12))


def _outer(radius_px: float, blur_px: float) -> float:
    return float(radius_px + max(2.5 * blur_px, min(0.5 * radius_px, 4.0)))


def _levels(patch: Patch, radius_px: float) -> tuple[float, float]:
    r = np.hypot(patch.x - patch.center_px[0], patch.y - patch.center_px[1])
    inner, rim = patch.value[r < 0.6 * radius_px], patch.value[(r > 1.2 * radius_px)]
    base = float(np.median(rim)) if len(rim) else float(np.median(patch.value))
    return (float(np.median(inner)) if len(inner) else float(patch.value.max())) - base, base


def _pooled(
    patches: list[Patch], weights: list[Array], shared: Array, own: list[Array]
) -> tuple[Array, Array, list[tuple[Array, Array]], float, int]:
    """Normal equations of the shared unknowns; per patch the own step at no move and its derivative by the move."""
    radius, blur = np.exp(shared[:2])
    shape, outer = np.array([radius, blur, *shared[2:]]), _outer(radius, blur)
    tables = np.stack([*tabulate(radius, blur), _by_radius(radius, blur)])
    products, count = np.zeros((len(patches), PRODUCTS, PRODUCTS)), 0
    for one, patch, weight, mine in zip(products, patches, weights, own, strict=True):
        count += add_products(patch.x, patch.y, patch.value, weight, shape, outer, mine, tables, PER_PX, one)
    full = products + np.triu(products, 1).transpose(0, 2, 1)
    own_part, shape_part = slice(0, OWN), slice(OWN, OWN + SHAPE)
    both, inverse = full[:, own_part, shape_part], np.linalg.inv(full[:, own_part, own_part] + 1e-9 * np.eye(OWN))
    first, cross = (inverse @ full[:, own_part, -1:])[..., 0], inverse @ both
    back = both.transpose(0, 2, 1)
    matrix = (full[:, shape_part, shape_part] - back @ cross).sum(axis=0)
    right = (full[:, shape_part, -1] - (back @ first[..., None])[..., 0]).sum(axis=0)
    return matrix, right, list(zip(first, cross, strict=True)), float(full[:, -1, -1].sum()), count


def _look_up(table: Array, r: Array) -> Array:
    place = np.minimum(r * PER_PX, len(table) - 1.001)
    k = place.astype(int)
    return np.asarray(table[k] + (place - k) * (table[k + 1] - table[k]))


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
    kernels.fit_disc(luma, *rows, start, None, disc.numbers(smear_px), disc.table, noise, result)
    return result
