"""Systematic errors of poses that all frames share: of the camera, and of the marks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from calibration.camera import Camera
from calibration.frames import plate_from_body
from evaluator.marks import columns_of

Array = NDArray[np.float64]

SUPPORTS = 120  # points at which the camera's sensitivity is computed; a cubic through them errs by 1e-3
# Part of a mark's centre error that is the same in all frames, fixed to the body, so that averaging does not reduce it:
# a share of the single-frame error (H.264 keeps its errors from frame to frame) and a floor in px. Measured over 100
# rendered rigs (tests/benchmarks/turning_video.py): with H.264 the mean error of a mark over 138 frames is 0.0075 px
# RMS at 0.042 px a frame. After subtraction of the noise in such a mean (white: 0.0040 px, correlated by 0.4: 0.0061
# px) it is 0.10 to 0.15 of the single-frame error; it is 0.0016 px without compression.
COMMON_SHARE = 0.12
COMMON_PX = 0.0015
# The same part fixed to the image, measured over 29 rendered H.264 clips of robots that turn at 1 to 3 mm/s for 3 to 9
# s: after subtraction of the noise, the mean error of a mark is 0.20 of the single-frame error. In clips with more than
# 0.6 turns, which separate the two parts, it is 0.18 in the image and 0.14 on the body, each with some of the other.
IMAGE_SHARE = 0.17


def systematic_shifts(
    marks: pd.DataFrame,
    points_mm: dict[str, Array],
    jacobian: Array,
    heading_rad: Array,
    covariances: Array,
    height_mm: float,
    camera: Camera,
    height_sigma_mm: float = 0.0,
) -> Array:
    """Shifts (n, 3, k) of the poses by one standard deviation of each of k independent errors common to all frames.

    points_mm: of every mark, (n, 2) each. jacobian: (n, m, 3, 2), derivative of the pose by each mark, 0 for marks that
    are not visible. covariances: (n, m, 2, 2) of the marks, mm². Marks without image columns have errors of the camera
    and of the height only.
    """
    count, by_plane = len(points_mm), [camera_shifts(marks, points_mm, height_mm, camera)]
    if height_sigma_mm:
        by_plane.append(_height_shifts(marks, points_mm, height_mm, height_sigma_mm, camera))
    of_marks = np.nan_to_num(np.concatenate(by_plane, axis=3))
    result = sum((jacobian[:, k] @ of_marks[:, k] for k in range(1, count)), jacobian[:, 0] @ of_marks[:, 0])
    if not all(f"{name}_x_px" in marks for name in points_mm):
        return np.asarray(result)
    common = common_error_mm(marks, points_mm, covariances)
    seen = sum(np.isfinite(place).all(axis=1).astype(int) for place in points_mm.values())
    single = _single_error_mm(covariances[np.asarray(seen) >= 2])
    in_image = IMAGE_SHARE * single * np.concatenate([jacobian[:, k] for k in range(count)], axis=2)
    return np.concatenate([result, _fixed_to_body(jacobian, heading_rad, common), in_image], axis=2)


def camera_shifts(marks: pd.DataFrame, points_mm: dict[str, Array], height_mm: float, camera: Camera) -> Array:
    """Shifts (n, m, 2, k) of the marks by one standard deviation of each independent error of the camera, mm.

    points_mm: of every mark, (n, 2) each; NaN where it is missing.
    """
    errors = _independent_errors(camera)
    return np.stack(
        [
            _smoothly(
                lambda at: camera.plate_sensitivity(at, height_mm) @ errors,
                _image_points(marks, name, points_mm[name], height_mm, camera),
            )
            for name in points_mm
        ],
        axis=1,
    )


def _height_shifts(
    marks: pd.DataFrame, points_mm: dict[str, Array], height_mm: float, sigma_mm: float, camera: Camera
) -> Array:
    """Shifts (n, m, 2, 1) of the marks by one standard deviation of their height above the plate, mm."""
    moved = []
    for name, points in points_mm.items():
        image = _image_points(marks, name, points, height_mm, camera)
        moved.append(camera.plate_from_image(image, height_mm + sigma_mm) - camera.plate_from_image(image, height_mm))
    return np.stack(moved, axis=1)[..., None]


def common_error_mm(marks: pd.DataFrame, points_mm: dict[str, Array], covariances: Array) -> float:
    """Standard uncertainty of a mark's centre that is common to all frames of a tracked recording, per axis.

    covariances: (n, m, 2, 2) of the marks, mm². The scale comes from the first two marks.
    """
    first, second = list(points_mm)[:2]
    image = marks[[*columns_of([first], "px"), *columns_of([second], "px")]].to_numpy(float)
    apart_px = np.hypot(*(image[:, :2] - image[:, 2:]).T)
    apart_mm = np.hypot(*(points_mm[first] - points_mm[second]).T)
    there = np.isfinite(apart_mm) & np.isfinite(apart_px)
    if not there.any():
        return 0.0
    mm_per_px = float(np.median(apart_mm[there] / apart_px[there]))
    return float(np.hypot(COMMON_SHARE * _single_error_mm(covariances[there]), COMMON_PX * mm_per_px))


def _single_error_mm(covariances: Array) -> float:
    """Standard uncertainty of a mark's centre in one frame, per axis; NaN without frames."""
    return float(np.sqrt(np.median(np.trace(covariances, axis1=2, axis2=3)) / 2)) if len(covariances) else float("nan")


def _fixed_to_body(jacobian: Array, heading: Array, error_mm: float) -> Array:
    """Pose shifts (n, 3, 2m) by an error of each mark along either axis of the body."""
    axes = plate_from_body(np.eye(2)[None], 0.0, 0.0, np.asarray(heading)[:, None])  # (n, axis, plate)
    return error_mm * np.concatenate(
        [jacobian[:, mark] @ np.swapaxes(axes, 1, 2) for mark in range(jacobian.shape[1])], axis=2
    )


def _independent_errors(camera: Camera) -> Array:
    """Parameter changes (p, k), one standard deviation each, whose outer products add up to the covariance."""
    sigma = np.sqrt(np.diag(camera.covariance))
    unit = np.where(sigma > 0, sigma, 1.0)
    values, vectors = np.linalg.eigh(camera.covariance / np.outer(unit, unit))
    kept = values > 1e-12  # of correlations: the largest is at least 1
    return np.asarray(unit[:, None] * vectors[:, kept] * np.sqrt(values[kept]))


def _image_points(marks: pd.DataFrame, name: str, points: Array, height: float, camera: Camera) -> Array:
    columns = [f"{name}_x_px", f"{name}_y_px"]
    if all(column in marks for column in columns):
        return np.where(np.isfinite(points), marks[columns].to_numpy(float), np.nan)
    return camera.image_from_plate(np.column_stack([points, np.full(len(points), height)]))


def _smoothly(function: Callable[[Array], Array], places: Array) -> Array:
    """Values (n, …) of a costly smooth function of image points (n, 2): a cubic through SUPPORTS of them.

    NaN for missing points.
    """
    there = np.flatnonzero(np.isfinite(places).all(axis=1))
    chosen = there[np.unique(np.linspace(0, len(there) - 1, min(len(there), SUPPORTS)).astype(int))]
    values = function(places[chosen])
    result = np.full((len(places), *values.shape[1:]), np.nan)
    if len(there) <= SUPPORTS:
        result[chosen] = values
        return result
    center, reach = places[there].mean(axis=0), np.ptp(places[there], axis=0).max() / 2 + 1e-9
    powers = [(i, j) for i in range(4) for j in range(4 - i)]

    def terms(at: Array) -> Array:
        x, y = ((at - center) / reach).T
        return np.stack([x**i * y**j for i, j in powers], axis=1)

    coefficients = np.linalg.lstsq(terms(places[chosen]), values.reshape(len(chosen), -1), rcond=1e-10)[0]
    result[there] = (terms(places[there]) @ coefficients).reshape(len(there), *values.shape[1:])
    return result
