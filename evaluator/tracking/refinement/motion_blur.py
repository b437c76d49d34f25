"""Compiled: what a disc looks like that moves while the shutter is open: the mean of it over its path.

Close to a straight edge that mean is an edge with more blur; beyond some blurs' length it is not, and with a path of a
radius or more a mark has neither edge nor flat inside any more. So it is summed, at the two points of Gauss in each of
equal parts of the path: of parts no longer than two blurs the sum is exact to 0.14 % of the amplitude, whatever the
length (0.7 % with three, 0.04 % with one).
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
# Square of a path over that of the blur up to which it is no smear: what it adds to the variance of the edge, 1/24 of
# that of the blur, shifts nothing.
SHORT = 0.5


def path_of(disc: NDArray[np.float64]) -> NDArray[np.float32] | None:
    """Points of a disc's path: displacement from its middle along x and y, px, and what a slant makes of it; (n, 4).

    disc: as `kernels.fit_disc` takes it. None where it moves so little that it is not smeared: kernels are compiled for
    smeared discs only where there is one.
    """
    _, blur, _, _, _, along_x, along_y, _ = disc.tolist()
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
