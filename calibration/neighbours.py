"""Nearest neighbours of scattered points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree


def nearest(points: NDArray[np.float64], count: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Distances and indices (n, k) of the nearest other points, nearest first; k is at most n - 1."""
    count = min(count, len(points) - 1)
    distance, index = cKDTree(points).query(points, count + 1)
    return np.asarray(distance)[:, 1:], np.ascontiguousarray(np.asarray(index)[:, 1:], dtype=np.int64)
