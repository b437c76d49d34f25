"""Marks of a robot on a known path, with known noise: the oracle of these tests."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from calibration.frames import plate_from_body
from evaluator.pose import MarkGeometry, poses_from_marks
from evaluator.turning import Turning, measure_turning

GEOMETRY = MarkGeometry(green_mm=(-1.55, 1.83), yellow_mm=(-1.55, -1.83), height_mm=6.5)
FRAME_S = 1 / 60
Array = NDArray[np.float64]


def arc_poses(radius_mm: float, turned_deg: float, frames: int, slip_rad: float = 0.1) -> Array:
    """Poses (n, 3) along a circle at constant speed, counter-clockwise for a positive radius; a body that slips."""
    turned = np.radians(np.linspace(0, turned_deg, frames)) * np.sign(radius_mm)
    return np.column_stack([radius_mm * np.sin(turned), radius_mm * (1 - np.cos(turned)), turned - slip_rad])


def straight_poses(length_mm: float, frames: int) -> Array:
    """Poses (n, 3) along +x at constant speed."""
    return np.column_stack([np.linspace(0, length_mm, frames), np.zeros(frames), np.zeros(frames)])


def resting(poses: Array, before: int = 0, after: int = 0) -> Array:
    """Poses with frames of rest before and after."""
    return np.concatenate([np.repeat(poses[:1], before, axis=0), poses, np.repeat(poses[-1:], after, axis=0)])


def marks_of(poses: Array, sigma_mm: float, rng: np.random.Generator, correlation: float = 0.0) -> pd.DataFrame:
    """Marks table of poses with Gaussian noise that falls off by `correlation` per frame."""
    table = {"time_s": np.arange(len(poses)) * FRAME_S}
    for name, place in (("green", GEOMETRY.green_mm), ("yellow", GEOMETRY.yellow_mm)):
        noise = rng.normal(size=(len(poses), 2))
        for row in range(1, len(noise) if correlation else 0):
            noise[row] = correlation * noise[row - 1] + np.sqrt(1 - correlation**2) * noise[row]
        points = plate_from_body(np.broadcast_to(place, (len(poses), 2)), *poses.T) + sigma_mm * noise
        table[f"{name}_x_mm"], table[f"{name}_y_mm"] = points.T
    return pd.DataFrame(table)


def winding_poses(curvature_per_mm: Array, step_mm: float, slip_rad: float = 0.1) -> Array:
    """Poses (n, 3) along a path of given curvature, (n,), at constant speed: exact for piecewise constant curvature."""
    turned = np.concatenate([[0.0], np.cumsum(curvature_per_mm[:-1] * step_mm)])
    middle = turned + np.asarray(curvature_per_mm) * step_mm / 2
    chord = step_mm * np.sinc(np.asarray(curvature_per_mm) * step_mm / 2 / np.pi)
    x = np.concatenate([[0.0], np.cumsum(chord * np.cos(middle))[:-1]])
    y = np.concatenate([[0.0], np.cumsum(chord * np.sin(middle))[:-1]])
    return np.column_stack([x, y, turned - slip_rad])


def measured(
    poses: Array, sigma_mm: float = 0.01, seed: int = 0, correlation: float = 0.0, **options: object
) -> Turning:
    """The turn of marks at these poses with this noise; options: of measure_turning."""
    marks = marks_of(poses, sigma_mm, np.random.default_rng(seed), correlation)
    return measure_turning(poses_from_marks(marks, GEOMETRY), **options)  # type: ignore[arg-type]


def matrix(x: float, y: float, angle: float) -> Array:
    """Rigid motion as a matrix, (3, 3)."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[cos, -sin, x], [sin, cos, y], [0, 0, 1.0]])
