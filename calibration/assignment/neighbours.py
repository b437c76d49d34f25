"""Nearest neighbours of scattered points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree


def nearest(points: NDArray[np.float64], count: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Distances and indices (n, k) of the nearest other points, nearest first; k is at most n - 1."""
    count = min(count, len(points) - 1)
    # of a few thousand dots a plain tree is built faster than a balanced one is searched
    distance, index = cKDTree(points, balanced_tree=False, compact_nodes=False).query(points, count + 1)
    return np.asarray(distance)[:, 1:], np.ascontiguousarray(np.asarray(index)[:, 1:], dtype=np.int64)
