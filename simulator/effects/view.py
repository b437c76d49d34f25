"""Observation of the marks: their positions on the robot, and errors of the camera's lengths and times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simulator.dynamics.terms import CAMERA_X, TIME, X_CUBED, Y_CUBED, Term, X, Y

Array = NDArray[np.float64]

NEAREST_HORIZON = 0.05  # a scale twenty times that of the middle, which no measuring camera has


@dataclass
class View:
    """Positions of marks in the body frame, mm, and errors of the observation; effects of kind "observation" change it.

    A measured coordinate is the true one times scale times 1 + t + perspective · t²/(1 − t), where t = keystone · true
    position: a linear change of scale for perspective 0, a homography, 1/(1 − t), for 1. A measured time is the true
    one times time_factor. errors: further errors of the measured position, terms of the camera channels.
    """

    places_mm: tuple[tuple[float, float], ...]
    scale: float = 1.0
    keystone_per_mm: tuple[float, float] = (0.0, 0.0)
    perspective: float = 0.0
    time_factor: float = 1.0
    errors: tuple[Term, ...] = ()

    @property
    def is_plain(self) -> bool:
        """Whether the observation has no error but the scale."""
        return self.keystone_per_mm == (0.0, 0.0) and not self.errors

    @property
    def bends_with_place(self) -> bool:
        """Whether the shape of an observed path depends on its position; an error linear in position only shifts it."""
        return self.keystone_per_mm != (0.0, 0.0) or any(term.basis in (X_CUBED, Y_CUBED) for term in self.errors)

    def marks(
        self, x_mm: ArrayLike, y_mm: ArrayLike, heading_rad: ArrayLike, time_s: ArrayLike = 0.0
    ) -> tuple[Array, ...]:
        """Measured marks (..., 2) of poses in the plate frame, mm, at their times, in the order of places_mm."""
        x, y = np.asarray(x_mm, dtype=float), np.asarray(y_mm, dtype=float)
        cos, sin = np.cos(heading_rad), np.sin(heading_rad)
        return tuple(self._mark(place, x, y, cos, sin, time_s) for place in self.places_mm)

    def _mark(
        self, offset_mm: tuple[float, float], x: Array, y: Array, cos: Array, sin: Array, time_s: ArrayLike
    ) -> Array:
        ahead, left = offset_mm
        true = np.empty((*x.shape, 2))
        true[..., 0] = x + ahead * cos - left * sin
        true[..., 1] = y + ahead * sin + left * cos
        return self.place(true, time_s)

    def place(self, points_mm: Array, time_s: ArrayLike = 0.0) -> Array:
        """Where points (..., 2) on the plane of the marks are measured to be at a time, mm."""
        if self.errors:
            return self._scaled(points_mm) + self._error(points_mm, time_s)
        return self._scaled(points_mm)

    def _scaled(self, points_mm: Array) -> Array:
        if self.keystone_per_mm == (0.0, 0.0):
            return self.scale * points_mm
        tilt = points_mm[..., 0] * self.keystone_per_mm[0] + points_mm[..., 1] * self.keystone_per_mm[1]
        stretch = 1 + tilt
        if self.perspective:
            # beyond the horizon (t = 1) nothing is visible; a fit that reaches it must not divide by 0
            stretch = stretch + self.perspective * tilt**2 / np.maximum(1 - tilt, NEAREST_HORIZON)
        return np.asarray(self.scale * stretch[..., None] * points_mm)

    def _error(self, points_mm: Array, time_s: ArrayLike) -> Array:
        x, y = points_mm[..., 0], points_mm[..., 1]
        square = x * x + y * y
        bases: dict[int, ArrayLike] = {X: x, Y: y, X_CUBED: x * square, Y_CUBED: y * square, TIME: time_s}
        error = np.zeros_like(points_mm)
        for term in self.errors:
            error[..., term.channel - CAMERA_X] += term.coefficient * np.asarray(bases[term.basis])
        return error
