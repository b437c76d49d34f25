"""Compiled inner loop of learning a mark's shape: products of derivatives and residuals."""
# mypy: disallow-untyped-defs=false, disallow-untyped-calls=false
# ruff: noqa: ANN001, ANN201 - numba infers the types

from __future__ import annotations

import math

import numpy as np
from numba import njit

# Rows and columns of the products: centre, amplitude, base and two slopes of the patch (what is its own), log radius,
# log blur and slant of the shape, and the residual.
OWN, SHAPE = 6, 4
PRODUCTS = OWN + SHAPE + 1


@njit(cache=True, nogil=True, error_model="numpy")
def add_products(x, y, value, weight, first, shape, outer, own, tables, per_px, products, residual):
    """Fill products, the upper triangles, with those of each patch's derivatives and residual; returns the pixels used.

    x, y, value, weight: (n,), of all patches; first: where each patch's begin, (m + 1,). shape: radius, blur, e1, e2;
    outer: radius of the pixels used. own: (m, OWN), x, y, amplitude, base and slopes of the background. tables: of
    `disc.tabulate`, per_px entries a px. products: (m, PRODUCTS, PRODUCTS). residual: (n,), filled, NaN beyond outer.
    """
    radius, e1, e2 = shape[0], shape[2], shape[3]
    last, count = tables.shape[1] - 2, 0
    row = np.empty(PRODUCTS)
    products[:] = 0.0
    for m in range(len(own)):
        mine, sums = own[m], products[m]
        amplitude = mine[2]
        for n in range(first[m], first[m + 1]):
            dx, dy = x[n] - mine[0], y[n] - mine[1]
            square = (1.0 + e1) * dx * dx + 2.0 * e2 * dx * dy + (1.0 - e1) * dy * dy
            if square >= outer * outer:
                residual[n] = math.nan
                continue
            count += 1
            r = math.sqrt(max(square, 1e-12))
            place = r * per_px
            k = min(int(place), last)
            part = min(place - k, 1.0)
            p = tables[0, k] + part * (tables[0, k + 1] - tables[0, k])
            g = amplitude * (tables[1, k] + part * (tables[1, k + 1] - tables[1, k]))
            grown = amplitude * radius * (tables[2, k] + part * (tables[2, k + 1] - tables[2, k]))
            residual[n] = value[n] - mine[3] - amplitude * p - mine[4] * dx - mine[5] * dy
            row[0], row[1] = -g * ((1.0 + e1) * dx + e2 * dy) / r, -g * (e2 * dx + (1.0 - e1) * dy) / r
            row[2], row[3], row[4], row[5] = p, 1.0, dx, dy
            # A disc magnified as a whole, blur and all, has the same luma at the magnified distance: what a blur grown
            # by its own size changes is what the two others leave.
            row[6], row[7] = grown, -(r * g + grown)
            row[8], row[9] = g * (dx * dx - dy * dy) / (2.0 * r), g * dx * dy / r
            row[10] = residual[n]
            for i in range(PRODUCTS):
                scaled = weight[n] * row[i]
                for j in range(i, PRODUCTS):
                    sums[i, j] += scaled * row[j]
    return count
