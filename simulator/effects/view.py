"""How the marks of a robot are seen: where they sit on it, and how true the camera's millimetres and seconds are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass
class View:
    """Marks in the body frame, mm, and the errors of the observation; effects of kind "observation" change it.

    A measured coordinate is the true one times scale times (1 + keystone · true position); a measured time is the true
    one times time_factor.
    """

    green_mm: tuple[float, float]
    yellow_mm: tuple[float, float]
    scale: float = 1.0
    keystone_per_mm: tuple[float, float] = (0.0, 0.0)
    time_factor: float = 1.0

    def marks(self, x_mm: ArrayLike, y_mm: ArrayLike, heading_rad: ArrayLike) -> tuple[Array, Array]:
        """Measured green and yellow marks (..., 2) of poses in the plate frame, mm."""
        x, y = np.asarray(x_mm, dtype=float), np.asarray(y_mm, dtype=float)
        cos, sin = np.cos(heading_rad), np.sin(heading_rad)
        green, yellow = (self._mark(offset, x, y, cos, sin) for offset in (self.green_mm, self.yellow_mm))
        return green, yellow

    def _mark(self, offset_mm: tuple[float, float], x: Array, y: Array, cos: Array, sin: Array) -> Array:
        ahead, left = offset_mm
        true = np.empty((*x.shape, 2))
        true[..., 0] = x + ahead * cos - left * sin
        true[..., 1] = y + ahead * sin + left * cos
        return self.place(true)

    def place(self, points_mm: Array) -> Array:
        """Where points (..., 2) on the plane of the marks are measured to be, mm."""
        if self.keystone_per_mm == (0.0, 0.0):
            return self.scale * points_mm
        tilt = points_mm[..., 0] * self.keystone_per_mm[0] + points_mm[..., 1] * self.keystone_per_mm[1]
        return np.asarray(self.scale * (1 + tilt)[..., None] * points_mm)
