"""Image, plate and body frames, and the planar motions between them.

Image frame: x right, y down, in px; the centre of the top left pixel is (0, 0).
Plate frame: x right, y up, z toward the camera, in mm; heading counter-clockwise from +x.
Body frame: x forward, y left, z up (ISO 8855), in mm, origin midway between the axles.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def plate_from_body(points_body_mm: ArrayLike, x_mm: ArrayLike, y_mm: ArrayLike, heading_rad: ArrayLike) -> Array:
    """Place body points on the plate, one pose or many.

    points_body_mm: (..., 2); x_mm, y_mm, heading_rad: scalars or arrays that broadcast against points_body_mm[..., 0].
    Returns (..., 2) in mm. NaN in, NaN out.
    """
    points = np.asarray(points_body_mm, dtype=float)
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    x, y = points[..., 0], points[..., 1]
    return np.stack([np.asarray(x_mm) + cos * x - sin * y, np.asarray(y_mm) + sin * x + cos * y], axis=-1)


def body_from_plate(points_plate_mm: ArrayLike, x_mm: ArrayLike, y_mm: ArrayLike, heading_rad: ArrayLike) -> Array:
    """Express plate points in the body frame; the inverse of `plate_from_body`: (..., 2) in mm."""
    points = np.asarray(points_plate_mm, dtype=float)
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    x, y = points[..., 0] - np.asarray(x_mm), points[..., 1] - np.asarray(y_mm)
    return np.stack([cos * x + sin * y, -sin * x + cos * y], axis=-1)
