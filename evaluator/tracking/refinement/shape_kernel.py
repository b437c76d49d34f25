"""Inner loop of learning a mark's shape: products of derivatives and residuals."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Rows and columns of the products: centre, amplitude, base and two slopes of a patch (its own unknowns), then log
# radius, log blur, slant and shade of the shape (common to all patches), then the residual.
OWN, SHAPE = 6, 6
PRODUCTS = OWN + SHAPE + 1


def add_products(
    x: Array, y: Array, value: Array, weight: Array, first: NDArray[np.intp], shape: Array, outer: float, own: Array,
    tables: Array, per_px: float, products: Array, residual: Array,
) -> int:  # fmt: skip
    """Fill products with those of each patch's derivatives and residual; returns the pixels used.

    x, y, value, weight: (n,), of all patches; first: (m + 1,), first sample of each patch. shape: radius, blur, e1, e2,
    shade along x and y; outer: radius of the pixels used. own: (m, OWN), x, y, amplitude, base and slopes of the
    background. tables: of `disc.tabulate`, per_px entries a px. products: (m, PRODUCTS, PRODUCTS). residual: (n,),
    filled, NaN beyond outer.
    """
    radius, _, e1, e2, shade_x, shade_y = shape.tolist()
    center_x, center_y, amplitude, base, tilt_x, tilt_y = np.repeat(own, np.diff(first), axis=0).T
    dx, dy = x - center_x, y - center_y
    square = (1.0 + e1) * dx * dx + 2.0 * e2 * dx * dy + (1.0 - e1) * dy * dy
    used = np.flatnonzero(square < outer * outer)
    dx, dy, amplitude = dx[used], dy[used], amplitude[used]
    r = np.sqrt(np.maximum(square[used], 1e-12))
    place = r * per_px
    k = np.minimum(place.astype(np.intp), tables.shape[1] - 2)
    here, part = tables[:, k], np.minimum(place - k, 1.0)
    p, slope, ring = here + part * (tables[:, k + 1] - here)
    light = 1.0 + shade_x * dx + shade_y * dy
    amplitude_p, g, grown = amplitude * p, amplitude * light * slope, amplitude * light * radius * ring
    residual[:] = np.nan
    residual[used] = value[used] - base[used] - light * amplitude_p - tilt_x[used] * dx - tilt_y[used] * dy
    # If a disc is magnified together with its blur, the luma at the magnified distance is the same. The derivative by
    # log blur therefore follows from those by radius and by distance.
    rows = np.stack([
        -g * ((1.0 + e1) * dx + e2 * dy) / r - shade_x * amplitude_p,
        -g * (e2 * dx + (1.0 - e1) * dy) / r - shade_y * amplitude_p,
        light * p, np.ones_like(p), dx, dy, grown, -(r * g + grown),
        g * (dx * dx - dy * dy) / (2.0 * r), g * dx * dy / r, amplitude_p * dx, amplitude_p * dy, residual[used],
    ])  # fmt: skip
    weighted, ends = weight[used] * rows, np.searchsorted(used, first)
    for m, (begin, end) in enumerate(pairwise(ends.tolist())):
        np.einsum("in,jn->ij", weighted[:, begin:end], rows[:, begin:end], out=products[m])
    return len(used)
