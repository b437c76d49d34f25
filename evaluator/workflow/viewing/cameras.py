"""Gauge images and cameras for a front end: dots found, map of the uncertainty, printable sheet."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluator.files import read_with

MOST_PX = 1600  # of a shown image
# Share of the pixels: the paper between the dots is at least a tenth of the image, and a tenth of it may have reflexes.
CLIPPED = 0.01
# Share of the range: the noise of a sensor is nearly constant below, so that centres are four times less certain.
DARK = 0.25


def image_jpeg(path: Path, most_px: int = MOST_PX) -> bytes:
    """An image file as JPEG, no wider than most_px. Raises CalibrationError for a file that is no image."""
    import cv2

    from calibration.detection.image import read_image

    image = np.asarray(read_image(path))
    if image.dtype != np.uint8:
        image = (image.astype(np.float64) * (255.0 / np.iinfo(image.dtype).max)).astype(np.uint8)
    height, width = image.shape[:2]
    if width > most_px:
        image = np.asarray(cv2.resize(image, (most_px, round(height * most_px / width)), interpolation=cv2.INTER_AREA))
    return bytes(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 88])[1])


def dots_of_image(path: Path) -> dict[str, Any]:
    """Dots and exposure of an image file; see `gauge_in`. Raises CalibrationError for a file that is no image."""
    from calibration.detection.image import read_image

    return gauge_in(read_image(path))


def gauge_in(image: NDArray[np.generic]) -> dict[str, Any]:
    """Gauge found in an image: size_px, centres (n, 2), which of them form the array, their sigma, focus, exposure.

    image: (h, w) or (h, w, 3). blur_px: median width of the edges, None without an array. light: a sentence if the
    exposure is wrong, else "".
    """
    from calibration.assignment.array_in_image import find_array

    dots, lattice = find_array(image)
    of_array = np.zeros(len(dots), bool)
    of_array[lattice.dot] = True
    sigma = np.sqrt(np.trace(dots.covariance_px2, axis1=1, axis2=2) / 2)
    return {
        "size_px": [image.shape[1], image.shape[0]],
        "centers_px": np.round(dots.centers_px, 2).tolist(),
        "of_array": of_array.tolist(),
        "sigma_px": float(np.median(sigma[of_array])) if of_array.any() else None,
        "blur_px": float(np.median(dots.blur_px[of_array])) if of_array.any() else None,
        "diameter_px": float(np.median(dots.diameter_px[of_array])) if of_array.any() else None,
        "light": light_of(image),
    }


def light_of(image: NDArray[np.generic]) -> str:
    """Fault of the exposure of an 8 or 16 bit image in a sentence; "" without one."""
    if image.dtype not in (np.uint8, np.uint16):
        return ""
    top = int(np.iinfo(np.uint16 if image.dtype == np.uint16 else np.uint8).max)
    brightest = np.asarray(image, np.uint16)
    brightest = brightest.max(axis=2) if image.ndim == 3 else brightest
    clipped = float(np.mean(brightest == top))
    level = float(np.percentile(brightest, 95)) / top
    if clipped > CLIPPED:
        return f"{100 * clipped:.0f} % of the pixels are saturated: reduce the exposure time"
    if level < DARK:
        return f"the brightest pixels reach {100 * level:.0f} % of the range: increase the exposure time or the light"
    return ""


def camera_view(path: Path) -> dict[str, Any]:
    """The verdict of a camera.json, its images, and a map of uncertainty in µm at the height of the marks.

    map: columns, rows, sigma_um of a position there (1 sigma), row by row from the top left.
    Raises InputError, CalibrationError.
    """
    from calibration.assessment.next_image import MAP as GRID
    from calibration.assessment.next_image import place_sigmas_mm
    from calibration.store import load_camera_file

    found = read_with(load_camera_file, path)
    camera, stored = found.camera(), found.model_dump(mode="json")
    height = found.verdict.mark_height_mm
    sigma = place_sigmas_mm(camera, height, GRID) * 1000
    return {
        "size_px": list(camera.size_px),
        "verdict": stored["verdict"],
        "images": [
            {key: one[key] for key in ("name", "dots", "left_out", "rms_px", "gain", "adds_nothing")}
            for one in stored["images"]
        ],
        "left_out": stored["left_out"],
        "rms_px": stored["rms_px"],
        "lens": stored["lens"],
        "next_image": stored["next_image"],
        "map": {
            "columns": GRID[0],
            "rows": GRID[1],
            "sigma_um": np.round(sigma.ravel(), 3).tolist(),
            "height_mm": height,
        },
    }


def gauge_pdf(path: Path) -> bytes:
    """The sheet of a gauge.toml in true scale, as PDF. Raises InputError."""
    from calibration.gauge.geometry import load_gauge
    from calibration.gauge.printing import gauge_sheet, pdf

    return bytes(pdf(gauge_sheet(read_with(load_gauge, path))))
