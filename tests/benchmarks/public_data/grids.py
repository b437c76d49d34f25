"""Photographs of dot grids: whole grids found, time, and what calibration makes of them."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.detection.image import read_image
from calibration.errors import CalibrationError
from calibration.estimation.calibrate import calibrate
from tests.benchmarks.calibration.grids import found_dots, gauge_of, opencv_grid, opencv_tuned
from tests.benchmarks.public_data.sets import GRIDS, GridSet
from tests.calibration.grid_images import GridImage, grid_places

Array = NDArray[np.float64]
# What anybody writes first: regions below Otsu's threshold of an area and a filling that a dot may have.
AREA_PX, FILLED = (20.0, 0.02), 0.6
PATIENCE_PX = 2_000_000  # larger images keep OpenCV's search busy for minutes


def grids(folder: Path) -> None:
    """A row for each set: images, dots due in each, and for each method whole grids found, dots found, s an image."""
    print("\nwhole grids found (dots found in the median image, processor seconds an image)")
    print(f"{'':26} {'images':>6} {'dots':>5} | {'turnscope':>19} | {'threshold, centroid':>19} | {'OpenCV':>19} |"
          f" {'OpenCV, area tuned':>19}")  # fmt: skip
    for one in GRIDS:
        place = one.published.find(folder)
        paths = [] if place is None else sorted(place.glob(one.pattern))
        if not paths:
            print(one.published.reason)
            continue
        images = [_photograph(path, one) for path in paths]
        due = one.dots or len(images[0].places)
        methods: tuple[Callable[[GridImage], Array | None], ...] = (found_dots, _threshold, opencv_grid, opencv_tuned)
        cells = [_cell(method, images, due, known=bool(one.columns)) for method in methods]
        print(f"{one.published.name:26} {len(images):6d} {due or '?':>5} | {' | '.join(cells)}", flush=True)


def cameras(folder: Path) -> None:
    """Two lines for each set of one camera: residual and focal length by OpenCV and by turnscope."""
    print("\ncameras solved from the photographs")
    for one in (each for each in GRIDS if each.calibrates):
        place = one.published.find(folder)
        if place is None:
            print(one.published.reason)
            continue
        print(one.published.name)
        _calibrations([_photograph(path, one) for path in sorted(place.glob(one.pattern))])


def _photograph(path: Path, one: GridSet) -> GridImage:
    places = grid_places(one.layout, (one.columns, one.rows)) if one.columns else np.empty((0, 2))
    unknown = np.full(places.shape, np.nan)
    image = np.asarray(read_image(path))
    if image.dtype != np.uint8:
        image = image / (np.iinfo(image.dtype).max / 255)
    shown = image.astype(np.uint8)
    none = np.isnan(unknown[:, 0])
    size = (one.columns, one.rows)
    return GridImage(path.name, shown, places, unknown, none, one.layout, size, bright=False, diameter=one.diameter)


def _cell(method: Callable[[GridImage], Array | None], images: list[GridImage], due: int, *, known: bool) -> str:
    searches = method in {opencv_grid, opencv_tuned}
    if searches and (not known or images[0].image.shape[0] * images[0].image.shape[1] > PATIENCE_PX):
        return f"{'needs a whole grid':>19}"
    start = time.process_time()
    found = [method(image) for image in images]
    each = (time.process_time() - start) / len(images)
    counts = [0 if centers is None else len(centers) for centers in found]
    whole = f"{sum(count == due for count in counts):3d}" if due and known else "  -"
    return f"{whole} {f'({np.median(counts):.0f}, {each:.2f})':>15}"


def _threshold(image: GridImage) -> Array | None:
    shown = image.image if image.image.ndim == 2 else cv2.cvtColor(image.image, cv2.COLOR_BGR2GRAY)
    _, mask = cv2.threshold(shown, 0, 255, cv2.THRESH_BINARY_INV | cv2.THRESH_OTSU)
    _, _, stats, centers = cv2.connectedComponentsWithStats(mask, connectivity=4)
    area, box = stats[:, cv2.CC_STAT_AREA], stats[:, cv2.CC_STAT_WIDTH] * stats[:, cv2.CC_STAT_HEIGHT]
    keep = (area > AREA_PX[0]) & (area < AREA_PX[1] * mask.size) & (area > FILLED * box)
    keep[0] = False
    return np.asarray(centers[keep])


def _calibrations(images: list[GridImage]) -> None:
    """The images through calibrateCamera, where OpenCV finds the grids, and through ours: residuals, focal length."""
    grey = images[0].image.shape[:2]
    seen = [centers for image in images if (centers := opencv_tuned(image)) is not None]
    if len(seen) > 2:
        plate = np.column_stack([images[0].places, np.zeros(len(images[0].places))]).astype(np.float32)
        points = [np.asarray(centers, np.float32) for centers in seen]
        rms, matrix, *_ = cv2.calibrateCamera([plate] * len(seen), points, grey[::-1], None, None)
        print(f"    OpenCV: {len(seen)} images, RMS {rms:.3f} px, focal length {matrix[0, 0]:.1f} px")
    try:
        ours = calibrate([image.image for image in images], gauge_of(images[0]), names=[one.kind for one in images])
    except CalibrationError as error:
        print(f"    turnscope: {error}")
        return
    focal = float(ours.camera.parameters[6])
    sigma = float(np.sqrt(ours.camera.covariance[6, 6]))
    print(
        f"    turnscope: {len(ours.views)} images, RMS {ours.rms_px:.3f} px, focal length {focal:.1f} ± {sigma:.1f} px"
    )
