"""Size of a dot relative to the dots around it, corrected for perspective."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

SURE = 0.1  # of ln(diameter): for dots closer to the median of those around, no plane is fitted
FEWEST = 5  # dots around: a plane through fewer would follow each of them
SOFTENING = 0.02  # of ln(diameter): scatter of equal dots, within which all dots have equal weight


def relative_size(points: Array, diameters: Array, neighbours: Integers) -> Array:
    """Logarithm of each diameter over that expected from the dots around, (n,).

    points: (n, 2). diameters: (n,). neighbours: (n, k). Two expectations are compared and the better one is used: the
    median of the neighbours, and, for perspective that changes diameters from row to row, a plane through their
    logarithms, fitted by least absolute deviations, which single dots do not affect.
    """
    size = np.log(diameters)
    around = size[neighbours]
    relative = size - np.median(around, axis=1)
    doubted = np.flatnonzero(np.abs(relative) > SURE)
    if neighbours.shape[1] < FEWEST or len(doubted) == 0:
        return np.asarray(relative)
    arm = points[neighbours[doubted]] - points[doubted, None]
    scale = np.median(np.hypot(arm[..., 0], arm[..., 1]), axis=1)
    rows = np.concatenate([np.ones((*arm.shape[:2], 1)), arm / scale[:, None, None]], axis=2)
    seen, weight = around[doubted], np.ones(arm.shape[:2])
    plane = np.zeros((len(doubted), 3, 1))
    for _ in range(8):  # iterative reweighting: each round halves the influence of misfits
        weighted = rows * weight[..., None]
        normal = np.swapaxes(weighted, 1, 2) @ rows + 1e-6 * np.eye(3)
        plane = np.linalg.solve(normal, (weighted * seen[..., None]).sum(axis=1)[..., None])
        weight = 1 / np.maximum(np.abs(seen - (rows @ plane)[..., 0]), SOFTENING)
    on_plane = size[doubted] - plane[:, 0, 0]
    relative[doubted] = np.where(np.abs(on_plane) < np.abs(relative[doubted]), on_plane, relative[doubted])
    return np.asarray(relative)
