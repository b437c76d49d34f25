"""The shape of a mark, learnt from several frames: one disc for all, with centre, levels and slopes free in each."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from evaluator.robust import PER_MEDIAN
from evaluator.tracking.refinement.disc import NO_SHADE, PER_PX, Disc, make_disc, outer_px, tabulate
from evaluator.tracking.refinement.shape_kernel import OWN, PRODUCTS, SHAPE, add_products

Array = NDArray[np.float64]
Learnt = TypeVar("Learnt")
Steps = Generator[None, None, Learnt]  # a long computation in steps, so that frames can be measured in between
# Standard deviation of the shade that uneven light causes on a flat mark, 1/px, as `shading` expects it; sigmas beyond
# which a mark is shaded because it is not flat.
UNEVEN_LIGHT, CERTAIN = 1e-3, 4.0
HALF, NEVER = 0.5, 1e-9  # of the luma: shade at the rim of a ball that is lit from one side; of a mark without one
BEYOND, FEW = 5.0, 0.005  # spreads from which a residual does not belong to the disc; harmless share of such residuals


@dataclass(frozen=True)
class Patch:
    """Luma around a mark: x, y of its samples in the frame, and the values (all (n,)); the mark is near center_px."""

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
    across, down = np.tile(i.astype(float), len(j)), np.repeat(origin + step * j.astype(float), len(i))
    return Patch(across, down, value.ravel(), center_px)


@dataclass(frozen=True)
class _Samples:
    """Samples of all patches, concatenated. x, y, value, weight: (n,). first: (m + 1,), first sample of each patch."""

    x: Array
    y: Array
    value: Array
    weight: Array
    first: NDArray[np.intp]


def learn_disc(patches: Sequence[Patch], radius_px: float, blur_px: float = 1.0, *, shaded: bool = True) -> Steps[Disc]:
    """Learn radius, blur and slant common to all patches, with centre, amplitude and background free in each.

    A generator that yields after every step of the fit and returns the disc: run it by `finished`, or one step per
    frame. The background may slope in each patch, so that constant glare does not change the shape. radius_px,
    blur_px: initial values. Pixels that do not belong to the disc (a wire, a glint) lose their weight in a second and
    third round. Raises LinAlgError if the patches do not determine a disc.
    """
    x, y, value = (np.concatenate([getattr(patch, name) for patch in patches]) for name in ("x", "y", "value"))
    first = np.cumsum([0, *(len(patch.value) for patch in patches)])
    samples = _Samples(x, y, value, np.ones_like(value), first)
    shared = np.array([np.log(radius_px), np.log(blur_px), 0.0, 0.0, 0.0, 0.0])
    own = np.array([[*patch.center_px, *_levels(patch, radius_px), 0.0, 0.0] for patch in patches])
    for _ in range(3):
        shared, own, residual, information = yield from _solve(samples, shared, own, shaded=shaded)
        left = residual[np.isfinite(residual)]
        if not len(left):
            raise np.linalg.LinAlgError("no sample is left")
        spread = max(PER_MEDIAN * float(np.median(np.abs(left))), 0.3)  # rounding to whole levels leaves 0.29
        if np.mean(np.abs(left) > BEYOND * spread) < FEW:
            break
        square = np.square(np.nan_to_num(residual) / (3 * spread))
        samples = replace(samples, weight=1.0 / (1.0 + square * square))
    # A codec leaves a flat mark without noise and its edge with much noise: the median reflects only the flat part.
    spread = max(float(np.sqrt(np.mean(np.minimum(left**2, (BEYOND * spread) ** 2)))), 0.3)
    amplitude, base = np.median(own[:, 2:4], axis=0)
    radius, blur = float(np.exp(shared[0])), float(np.exp(shared[1]))
    slant, level = (float(shared[2]), float(shared[3])), (float(amplitude), float(base))
    disc = make_disc(radius, blur, slant, level, spread**2)
    covariance = np.asarray(np.linalg.inv(information)[4:, 4:] * disc.noise)
    return replace(disc, shade=_certain_shade(shared[4:], covariance))


def _certain_shade(shade: Array, covariance: Array) -> tuple[float, float]:
    """The shade of a mark if neither noise nor light that falls on a flat mark explains it, else none."""
    square = float(shade @ np.linalg.solve(covariance + UNEVEN_LIGHT**2 * np.eye(2), shade))
    return (float(shade[0]), float(shade[1])) if square > CERTAIN**2 else NO_SHADE


def finished(steps: Steps[Learnt]) -> Learnt:
    """Run all steps of a generator; returns its result."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value  # type: ignore[no-any-return]


def _solve(samples: _Samples, shared: Array, own: Array, *, shaded: bool) -> Steps[tuple[Array, Array, Array, Array]]:
    """Variable projection by Levenberg-Marquardt: the unknowns of each patch are eliminated (Schur complement).

    Returns the shared unknowns, those of each patch (m, OWN), the residuals, NaN beyond the pixels used, and the
    normal equations of the shared unknowns.
    """
    damping, cost = 1e-3, np.inf
    best, pixels, keep = (shared, own, samples.value), 1, None
    prior = np.zeros((SHAPE, SHAPE))
    for _ in range(40):
        equations, total, residual, count = _pooled(samples, shared, own)
        yield
        if total < cost:
            done = cost - total < 1e-3 * total  # the shape is then off by a thirtieth of its uncertainty
            best, cost, damping, pixels = (shared, own, residual), total, max(damping / 5, 1e-6), count
            keep = equations
            if done:
                break
        else:
            damping *= 8
            if damping > 1e6:
                break
            if keep is None:
                raise np.linalg.LinAlgError("the patches hold no disc")
        matrix, right, first, cross = keep
        # Weak priors on slant and shade, which small blurred marks do not determine: 0.2 includes tilts up to 35
        # degrees, and half of its luma at the rim a ball that is lit from one side.
        radius = float(np.exp(best[0][0]))
        shade = HALF / radius if shaded else NEVER
        widths = np.array([np.inf, np.inf, 0.2, 0.2, shade, shade])
        prior = np.diag(widths**-2.0) * (cost / max(pixels, 1))
        scaled = matrix + prior + damping * np.diag(np.diag(matrix) + 1e-9)
        move = np.clip(np.linalg.solve(scaled, right - prior @ best[0]), -0.3, 0.3)
        shared = best[0] + move
        shared[1] = np.clip(shared[1], np.log(0.3), shared[0])
        shared[2:4] = np.clip(shared[2:4], -0.5, 0.5)
        shared[4:] = np.clip(shared[4:], -1.0 / radius, 1.0 / radius)
        own = best[1] + np.clip(first - cross @ move, -1e3, 1e3)
    if keep is None:
        raise np.linalg.LinAlgError("the patches hold no disc")
    return *best, keep[0] + prior


def _levels(patch: Patch, radius_px: float) -> tuple[float, float]:
    r = np.hypot(patch.x - patch.center_px[0], patch.y - patch.center_px[1])
    inner, rim = patch.value[r < 0.6 * radius_px], patch.value[(r > 1.2 * radius_px)]
    base = float(np.median(rim)) if len(rim) else float(np.median(patch.value))
    return (float(np.median(inner)) if len(inner) else float(patch.value.max())) - base, base


def _pooled(
    samples: _Samples, shared: Array, own: Array
) -> tuple[tuple[Array, Array, Array, Array], float, Array, int]:
    """Normal equations of the shared unknowns, and each patch's step at fixed shared unknowns with its derivative.

    Returns these four, the sum of the weighted squares, the residuals, NaN beyond the pixels used, and their number.
    """
    radius, blur = np.exp(shared[:2])
    shape, tables = np.array([radius, blur, *shared[2:]]), tabulate(radius, blur)
    full, residual = np.empty((len(own), PRODUCTS, PRODUCTS)), np.empty_like(samples.value)
    count = add_products(
        samples.x, samples.y, samples.value, samples.weight, samples.first,
        shape, outer_px(radius, blur), own, tables, PER_PX, full, residual,
    )  # fmt: skip
    own_part, shape_part = slice(0, OWN), slice(OWN, OWN + SHAPE)
    both = full[:, own_part, shape_part]
    solved = np.linalg.solve(full[:, own_part, own_part] + 1e-9 * np.eye(OWN), full[:, own_part, OWN:])
    cross, first = np.asarray(solved[..., :SHAPE]), np.asarray(solved[..., SHAPE])
    matrix = full[:, shape_part, shape_part].sum(axis=0) - np.einsum("mis,mit->st", both, cross)
    right = full[:, shape_part, -1].sum(axis=0) - np.einsum("mis,mi->s", both, first)
    return (matrix, right, first, cross), float(full[:, -1, -1].sum()), residual, count
