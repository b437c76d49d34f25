"""Compiled: motion blur of a disc, the mean of its image over its path during the exposure.

For a short path the mean of an edge is an edge with more blur; for longer ones it is not, and with a path of a radius
or more a mark has neither an edge nor a flat interior. The mean is therefore computed at the two Gauss points in each
of equal parts of the path: for parts no longer than two blurs it is exact to 0.14 % of the amplitude at any length
(0.7 % with three, 0.04 % with one).
"""
# mypy: disallow-untyped-defs=false, disallow-untyped-calls=false
# ruff: noqa: ANN001, ANN201, ANN202 - numba infers the types

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from calibration.compilation import compiled

PART = 2.0  # blurs
GAUSS = 0.5 / math.sqrt(3.0)  # of a part: from its middle to its two points
# Squared path over squared blur up to which motion blur is neglected: it adds 1/24 to the variance of the edge.
SHORT = 0.5


def path_of(disc: NDArray[np.float64]) -> NDArray[np.float32] | None:
    """Points of a disc's path: displacement from its middle along x and y, px, without and with the slant; (n, 4).

    disc: see `kernels.fit_disc`. None if motion blur is negligible, so that kernels for motion blur are compiled only
    when needed.
    """
    blur, along_x, along_y = disc.item(1), disc.item(5), disc.item(6)
    length2 = along_x * along_x + along_y * along_y
    if not length2 > SHORT * blur * blur:
        return None
    path = np.empty((2 * math.ceil(math.sqrt(length2) / (PART * blur)), 4), np.float32)
    _fill_path(disc, path)
    return path


@compiled(nogil=True)
def _fill_path(disc, path):
    e1, e2, along_x, along_y = disc[2], disc[3], disc[5], disc[6]
    parts = len(path) // 2
    for n in range(2 * parts):
        t = ((n // 2) + 0.5 + (GAUSS if n & 1 else -GAUSS)) / parts - 0.5
        x, y = t * along_x, t * along_y
        path[n, 0], path[n, 1], path[n, 2], path[n, 3] = x, y, (1.0 + e1) * x + e2 * y, e2 * x + (1.0 - e1) * y


@compiled(nogil=True, forceinline=True)
def mean_over(path, table, per_px2, dx, dy, outward_x, outward_y):
    """Profile of a smeared disc at (dx, dy) px from its middle, and its slopes along x and y over minus one.

    table, per_px2: of `disc.by_square`. outward_x, outward_y: what a slant makes of (dx, dy).
    """
    last, half = np.float32(len(table) - 1), np.float32(0.5)
    p = pull_x = pull_y = np.float32(0.0)
    for n in range(len(path)):
        out_x, out_y = np.float32(outward_x - path[n, 2]), np.float32(outward_y - path[n, 3])
        square = np.float32(dx - path[n, 0]) * out_x + np.float32(dy - path[n, 1]) * out_y
        k = np.int32(min(square * np.float32(per_px2) + half, last))
        p += table[k, 0]
        pull_x += table[k, 1] * out_x
        pull_y += table[k, 1] * out_y
    share = np.float32(1.0) / np.float32(len(path))
    return p * share, pull_x * share, pull_y * share
