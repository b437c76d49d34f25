"""Planes in the camera's view: the plane coordinates of every pixel, computed once."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import RectBivariateSpline

from calibration.camera import Camera

Array = NDArray[np.float64]
NOWHERE_MM = 1e9  # coordinate of pixels whose ray misses the plane, or where the lens model folds over


@dataclass(frozen=True)
class PlaneMap:
    """Plane coordinates at pixel centres, mm, with pad more pixels on each side than the image; both read-only."""

    camera: Camera
    height_mm: float
    pad: int
    x_mm: Array
    y_mm: Array

    def image_from_plane(self, points_mm: ArrayLike) -> Array:
        """Project points (..., 2) of the plane; returns (..., 2) px, NaN behind the camera."""
        points = np.asarray(points_mm, dtype=float)
        return self.camera.image_from_plate(
            np.concatenate([points, np.full((*points.shape[:-1], 1), self.height_mm)], axis=-1)
        )


def plane_map(camera: Camera, height_mm: float, pad: int) -> PlaneMap:
    """Map the plane height_mm above the camera's plate (or gauge) frame.

    The camera model is evaluated at every eighth pixel and interpolated by a quintic spline (to 1e-6 px, see the
    tests); if the plane ends within the image, it is evaluated at every pixel.
    """
    width, height = camera.size_px
    columns, rows = np.arange(-pad, width + pad, dtype=float), np.arange(-pad, height + pad, dtype=float)
    knots = [np.arange(-pad - 8, end + pad + 16, 8, dtype=float) for end in (width, height)]
    points, seen = _points_seen(camera, height_mm, *knots)
    if seen.all():
        splines = (RectBivariateSpline(knots[1], knots[0], points[..., k], kx=5, ky=5) for k in range(2))
        x_mm, y_mm = (spline(rows, columns) for spline in splines)
    else:
        points, seen = _points_seen(camera, height_mm, columns, rows)
        points[~seen] = NOWHERE_MM
        x_mm, y_mm = np.ascontiguousarray(points[..., 0]), np.ascontiguousarray(points[..., 1])
    x_mm.setflags(write=False)
    y_mm.setflags(write=False)
    return PlaneMap(camera, height_mm, pad, x_mm, y_mm)


def _points_seen(camera: Camera, height_mm: float, columns: Array, rows: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Plane points of a grid of image points, and whether they project back to these image points."""
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1)
    with np.errstate(all="ignore"):
        points = camera.plate_from_image(pixels, height_mm)
        back = camera.image_from_plate(np.concatenate([points, np.full((*points.shape[:-1], 1), height_mm)], axis=-1))
        return points, np.abs(back - pixels).max(axis=-1) < 1e-3


def camera_from(camera: Camera, rotation_rad: ArrayLike, translation_mm: ArrayLike) -> Camera:
    """A camera described in another frame, whose pose on the plate is given.

    rotation_rad: (3,) rotation vector and translation_mm: (3,) that take points of that frame to the plate frame.
    """
    to_plate = cv2.Rodrigues(np.asarray(rotation_rad, dtype=float))[0]
    to_camera = cv2.Rodrigues(camera.parameters[:3])[0]
    parameters = camera.parameters.copy()
    parameters[:3] = cv2.Rodrigues(to_camera @ to_plate)[0][:, 0]
    parameters[3:6] = to_camera @ np.asarray(translation_mm, dtype=float) + camera.parameters[3:6]
    return replace(camera, parameters=parameters)
