"""Observation of the marks: their positions on the robot, and errors of the camera's lengths and times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simulator.dynamics.terms import CAMERA_X, TIME, X_CUBED, Y_CUBED, Term, X, Y

Array = NDArray[np.float64]
Place = tuple[float, float]

NEAREST_HORIZON = 0.05  # a scale twenty times that of the middle, which no measuring camera has
SLOWEST_ROWS = 0.05  # of the rows' speed that a mark leaves; a mark nearly as fast as the rows is in none or in many


@dataclass
class View:
    """Positions of marks in the body frame, mm, and errors of the observation; effects of kind "observation" change it.

    A measured coordinate is the true one times scale times 1 + t + perspective · t²/(1 − t), where t = keystone · true
    position: a linear change of scale for perspective 0, a homography, 1/(1 − t), for 1. A measured time is the true
    one times time_factor. errors: further errors of the measured position, terms of the camera channels.
    """

    places_mm: tuple[Place, ...]
    scale: float = 1.0
    keystone_per_mm: tuple[float, float] = (0.0, 0.0)
    perspective: float = 0.0
    time_factor: float = 1.0
    delay_s_per_mm: tuple[float, float] = (0.0, 0.0)
    errors: tuple[Term, ...] = ()

    @property
    def is_plain(self) -> bool:
        """Whether the observation has no error but the scale."""
        return self.keystone_per_mm == (0.0, 0.0) and not self.rolls and not self.errors

    @property
    def rolls(self) -> bool:
        """Whether the marks of a frame are seen at times that depend on their positions."""
        return self.delay_s_per_mm != (0.0, 0.0)

    @property
    def bends_with_place(self) -> bool:
        """Whether the shape of an observed path depends on its position; an error linear in position only shifts it."""
        bent = self.keystone_per_mm != (0.0, 0.0) or any(term.basis in (X_CUBED, Y_CUBED) for term in self.errors)
        return bent or self.rolls

    def marks(
        self, x_mm: ArrayLike, y_mm: ArrayLike, heading_rad: ArrayLike, time_s: ArrayLike = 0.0
    ) -> tuple[Array, ...]:
        """Measured marks (..., 2) of poses at rest in the plate frame at their times, mm, in the order of places_mm."""
        x, y, heading = (np.asarray(value, dtype=float) for value in (x_mm, y_mm, heading_rad))
        return tuple(self.place(_on_plate(place, x, y, heading), time_s) for place in self.places_mm)

    def marks_of_path(self, states: Array, time_s: Array) -> tuple[Array, ...]:
        """Measured marks (n, 2) of a path, mm, in the order of places_mm.

        states: (n, 6), pose in the plate frame and velocity in the body frame (mm/s, mm/s, rad/s) at ascending times.
        """
        x, y, heading = states[:, :3].T
        seen = self.marks(x, y, heading, time_s)
        if not self.rolls:
            return seen
        delay, late = np.asarray(self.delay_s_per_mm), []
        for place, marks in zip(self.places_mm, seen, strict=True):
            speed = self.scale * _velocity(place, states)
            guess = marks @ delay / np.maximum(1 - speed @ delay, SLOWEST_ROWS)  # of a mark with constant velocity
            there = self.place(_at(place, states, time_s, time_s + guess), time_s)
            late.append(self.place(_at(place, states, time_s, time_s + there @ delay), time_s))
        return tuple(late)

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


def _on_plate(offset_mm: Place, x: Array, y: Array, heading_rad: Array) -> Array:
    """True positions (..., 2) of a point of the body, mm."""
    (ahead, left), cos, sin = offset_mm, np.cos(heading_rad), np.sin(heading_rad)
    true = np.empty((*x.shape, 2))
    true[..., 0] = x + ahead * cos - left * sin
    true[..., 1] = y + ahead * sin + left * cos
    return true


def _velocity(offset_mm: Place, states: Array) -> Array:
    """True velocities (n, 2) of a point of the body in the plate frame, mm/s, in states (n, 6)."""
    (ahead, left), (heading, u, v, turning) = offset_mm, states[:, 2:].T
    cos, sin, forward, sideways = np.cos(heading), np.sin(heading), u - turning * left, v + turning * ahead
    return np.column_stack([cos * forward - sin * sideways, sin * forward + cos * sideways])


def _at(offset_mm: Place, states: Array, time_s: Array, wanted_s: Array) -> Array:
    """True positions (m, 2) of a point of the body at wanted times (m,) of a path (n, 6), mm.

    From the nearer state before or after, with its constant twist. If the speed jumps between two states, as where
    motors start, the two arcs meet at the jump, and each is right on its own side of it.
    """
    if len(time_s) < 2:
        return _moved(offset_mm, states, wanted_s - time_s)
    before = np.clip(np.searchsorted(time_s, wanted_s, side="right") - 1, 0, len(time_s) - 2)
    places, speeds = _on_plate(offset_mm, states[:, 0], states[:, 1], states[:, 2]), _velocity(offset_mm, states)
    step, change = np.diff(time_s)[before], np.diff(speeds, axis=0)[before]
    apart = places[before] - places[before + 1] + speeds[before + 1] * step[:, None]
    size = np.sum(change**2, axis=1)
    share = np.divide(np.sum(apart * change, axis=1), size * step, out=np.full(len(size), 0.5), where=size > 0)
    meeting_s = time_s[before] + np.clip(share, 0.0, 1.0) * step
    nearest = np.where(wanted_s < meeting_s, before, before + 1)
    return _moved(offset_mm, states[nearest], wanted_s - time_s[nearest])


def _moved(offset_mm: Place, states: Array, duration_s: Array) -> Array:
    """True positions (m, 2) of a point of the body, mm, after durations (m,) of constant twist from states (m, 6)."""
    x, y, heading, u, v, turning = states.T
    half = turning * duration_s / 2  # the chord of the arc points half the turn further
    way = duration_s * np.sinc(half / np.pi)
    cos, sin = np.cos(heading + half) * way, np.sin(heading + half) * way
    return _on_plate(offset_mm, x + cos * u - sin * v, y + sin * u + cos * v, heading + 2 * half)
