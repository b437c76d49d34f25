"""An oracle for the tests: gauge images whose pixels hold the exact area of each disc, from any camera model.

The rim of a disc is projected point by point and its polygon's area within every pixel summed exactly, so nothing in
the image depends on how the detector or the solver describe a dot.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import ceil, floor

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.camera import Camera
from calibration.compilation import compiled
from calibration.gauge.geometry import Gauge

Array = NDArray[np.float64]


def gauge_of(
    *, fiducial: Sequence[Mapping[str, object]] = (), tolerance: Mapping[str, float] | None = None, **dots: object
) -> Gauge:
    """The plate of the tests, 13 by 9 dots of 1.2 mm every 3 mm, with the keys of [dots] that are given instead."""
    table = {"columns": 13, "rows": 9, "pitch_mm": 3.0, "diameter_mm": 1.2} | dots
    return Gauge.model_validate(
        {"format": 1, "name": "plate", "dots": table, "fiducial": fiducial, "tolerance": tolerance or {}}
    )


def draw_gauge(
    camera: Camera,
    gauge: Gauge,
    *,
    rng: np.random.Generator | None = None,
    height_mm: float | None = None,
    blur_px: float = 0.8,
    snr: float = np.inf,
    black: float = 40.0,
    white: float = 200.0,
    light: tuple[float, float] = (0.0, 0.0),
    missing: tuple[int, ...] = (),
    face_mm: Array | float = 0.0,
    quantise: bool = True,
) -> NDArray[np.generic]:
    """Draw the gauge lying in the plane z = height (default: its own) of the camera's plate frame.

    snr: contrast over noise. light: relative change of illumination across the image's width and height. missing:
    flat indices of dots left out. face_mm: height of each dot (rows, columns) above the plane, of a bent gauge.
    """
    height = gauge.dots.height_mm if height_mm is None else height_mm
    centers = gauge.positions_mm().reshape(-1, 2)
    radii = gauge.diameters_mm().ravel() / 2
    keep = np.setdiff1d(np.arange(len(centers)), missing)
    heights = height + np.broadcast_to(face_mm, gauge.diameters_mm().shape).ravel()
    coverage = disc_coverage(camera, np.column_stack([centers, heights])[keep], radii[keep])
    if blur_px > 0:
        coverage = cv2.GaussianBlur(coverage, (0, 0), blur_px, borderType=cv2.BORDER_REPLICATE)
    low, high = (white, black) if gauge.dots.color == "white" else (black, white)
    image = high + (low - high) * coverage
    y, x = np.mgrid[: image.shape[0], : image.shape[1]]
    slope_x, slope_y = light[0] / image.shape[1], light[1] / image.shape[0]
    image *= 1 + slope_x * (x - image.shape[1] / 2) + slope_y * (y - image.shape[0] / 2)
    if rng is not None and np.isfinite(snr):
        image += rng.normal(0, abs(high - low) / snr, image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8) if quantise else image


def posed(camera: Camera, rotation: Array, translation_mm: Array) -> Camera:
    """A camera with the plate frame carried by a motion: points p of the new frame lie at R p + t of the old."""
    old = cv2.Rodrigues(camera.parameters[:3])[0]
    parameters = camera.parameters.copy()
    parameters[:3] = cv2.Rodrigues(old @ rotation)[0][:, 0]
    parameters[3:6] = old @ np.asarray(translation_mm, dtype=float) + camera.parameters[3:6]
    return replace(camera, parameters=parameters)


def random_poses(
    camera: Camera, count: int, rng: np.random.Generator, *, tilt_deg: float, shift_mm: float
) -> list[Camera]:
    """The camera before the plate, then as seen from a gauge held in count - 1 tilted poses."""
    views = [camera]
    for _ in range(count - 1):
        tilt, azimuth, turn = np.radians([rng.uniform(0.3, 1) * tilt_deg, rng.uniform(0, 360), rng.uniform(-15, 15)])
        tilting = cv2.Rodrigues(tilt * np.array([np.cos(azimuth), np.sin(azimuth), 0]))[0]
        turning = cv2.Rodrigues(np.array([0, 0, turn]))[0]
        views.append(posed(camera, tilting @ turning, np.array([*rng.uniform(-shift_mm, shift_mm, 2), 0.0])))
    return views


def disc_coverage(camera: Camera, centers_mm: Array, radii_mm: Array, vertices: int = 128) -> Array:
    """Share of every pixel that discs parallel to the plate cover, (h, w)."""
    width, height = camera.size_px
    angle = np.arange(vertices) * (2 * np.pi / vertices)
    # a polygon of the disc's own area
    grow = np.sqrt(2 * np.pi / (vertices * np.sin(2 * np.pi / vertices)))
    circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    rims = camera.image_from_plate(centers_mm[:, None, :] + grow * radii_mm[:, None, None] * circle)
    rims = rims[np.isfinite(rims).all(axis=(1, 2))] + 0.5
    margin = 2
    sum_ = np.zeros((height + 2 * margin, width + 2 * margin))
    reach = np.array([width, height])
    near = (rims.min(axis=1) < reach).all(axis=1) & (rims.max(axis=1) > 0).all(axis=1)
    for rim in rims[near]:
        _add_polygon(sum_, np.clip(rim + margin, 0.01, np.array(sum_.shape[::-1]) - 1.01))
    covered = np.abs(np.cumsum(sum_, axis=1))
    return np.ascontiguousarray(np.clip(covered, 0, 1)[margin:-margin, margin:-margin])


@compiled()
def _add_polygon(sums, polygon):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Add the signed-area differences of a polygon; their running sum along rows is the covered share of each pixel."""
    for k in range(len(polygon)):
        x_a, y_a = polygon[k]
        x_b, y_b = polygon[(k + 1) % len(polygon)]
        if y_a == y_b:
            continue
        sign = 1.0
        if y_a > y_b:
            x_a, y_a, x_b, y_b, sign = x_b, y_b, x_a, y_a, -1.0
        slope = (x_b - x_a) / (y_b - y_a)
        for row in range(floor(y_a), ceil(y_b)):
            top, bottom = max(float(row), y_a), min(row + 1.0, y_b)
            left, right = x_a + slope * (top - y_a), x_a + slope * (bottom - y_a)
            if left > right:
                left, right = right, left
            share = sign * (bottom - top)
            # the strip between the edge and the right end of each pixel it crosses
            before = 0.0
            for column in range(floor(left), ceil(right) + 1):
                here = share * _area_right_of(left, right, column)
                sums[row, column] += here - before
                before = here


@compiled()
def _area_right_of(left, right, column):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Mean over an edge running from left to right of the part of pixel `column` that lies to its right."""
    if right - left < 1e-12:
        return min(max(column + 1.0 - left, 0.0), 1.0)
    # integral of clip(column + 1 - x, 0, 1) dx
    def_low, def_high = min(max(left, column), column + 1.0), min(max(right, column), column + 1.0)
    whole = max(min(right, column) - left, 0.0)
    part = (column + 1.0 - def_low) ** 2 / 2 - (column + 1.0 - def_high) ** 2 / 2
    return (whole + part) / (right - left)
