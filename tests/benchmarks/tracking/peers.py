"""The tracker and what else people use, on the same file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from evaluator.recording import open_recording
from evaluator.tracking import track
from evaluator.tracking.refinement.disc import fit, make_disc

Array = np.ndarray
UNDOUBTED = 1e6  # variance of the noise that takes no pixel for an outlier
RANGES = {"green": ((45, 90, 80), (80, 255, 255)), "yellow": ((22, 90, 80), (38, 255, 255))}


def with_masks(path: Path, place: Callable[[Array], tuple[float, float]]) -> dict[str, Array]:
    """Read, HSV, inRange, full frame; place: from the mask of a colour to a centre."""
    places: dict[str, list[tuple[float, float]]] = {name: [] for name in RANGES}
    capture = cv2.VideoCapture(str(path))
    while True:
        good, image = capture.read()
        if not good:
            return {name: np.array(points) for name, points in places.items()}
        hsv = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
        for name, (low, high) in RANGES.items():
            places[name].append(place(cv2.inRange(hsv, low, high)))


def hsv_centroid(path: Path) -> dict[str, Array]:
    """The usual pipeline: moments of the mask."""

    def center(mask: Array) -> tuple[float, float]:
        moments = cv2.moments(mask, binaryImage=True)
        area = moments["m00"] or np.nan
        return moments["m10"] / area, moments["m01"] / area

    return with_masks(path, center)


def contours(path: Path) -> dict[str, Array]:
    """OpenCV contour tracker: the largest contour of each colour, centre of its smallest circle."""

    def center(mask: Array) -> tuple[float, float]:
        found, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        return cv2.minEnclosingCircle(max(found, key=cv2.contourArea))[0] if found else (np.nan, np.nan)

    return with_masks(path, center)


def luma_centroid(path: Path, truth: dict[str, Array], radius: float) -> dict[str, Array]:
    """Luma-weighted centroid in a window that is handed the truth: what a perfect finder would leave to it."""
    places: dict[str, list[tuple[float, float]]] = {name: [] for name in truth}
    half = int(1.4 * radius + 2)
    grid_y, grid_x = np.mgrid[-half : half + 1, -half : half + 1]
    for frame in open_recording(path):
        for name, points in truth.items():
            x, y = np.rint(points[frame.index]).astype(int)
            window = frame.luma[y - half : y + half + 1, x - half : x + half + 1].astype(float)
            weight = np.clip(window - np.percentile(window, 20), 0, None)
            weight /= weight.sum()
            places[name].append((x + (weight * grid_x).sum(), y + (weight * grid_y).sum()))
    return {name: np.array(points) for name, points in places.items()}


def true_shape(path: Path, truth: dict[str, Array], radius: float) -> dict[str, Array]:
    """Fit of the disc that was drawn, from its true place, every pixel by its own weight: what the codec left to find.

    No method knows as much; what it errs by, the codec has moved.
    """
    edge = float(np.hypot(0.8, 12**-0.5))  # of the drawing's blur, and of a pixel
    places: dict[str, list[Array]] = {name: [] for name in truth}
    for frame in open_recording(path):
        for name, points in truth.items():
            x, y = map(float, points[frame.index])
            level = float(frame.luma[round(y), round(x)]), 25.0
            disc = make_disc(radius, edge, (0.0, 0.0), (level[0] - level[1], level[1]), UNDOUBTED)
            places[name].append(fit(frame.luma, (0, 1), (x, y), disc)[:2])
    return {name: np.array(points) for name, points in places.items()}


def trackpy_places(path: Path, truth: dict[str, Array], radius: float) -> dict[str, Array]:
    """trackpy.locate on the luma; its features told apart by the truth."""
    import trackpy

    trackpy.quiet()
    places: dict[str, list[Array]] = {name: [] for name in truth}
    diameter = int(2 * radius) // 2 * 2 + 3
    for frame in open_recording(path):
        found = trackpy.locate(frame.luma, diameter, topn=12, engine="numba")[["x", "y"]].to_numpy()
        for name, points in truth.items():
            away = np.hypot(*(found - points[frame.index]).T)
            places[name].append(found[np.argmin(away)] if len(found) and away.min() < radius else np.full(2, np.nan))
    return {name: np.array(points) for name, points in places.items()}


def ours(path: Path) -> dict[str, Array]:
    """The whole tracker, file to table."""
    table = track(open_recording(path))
    return {name: table[[f"{name}_x_px", f"{name}_y_px"]].to_numpy() for name in ("green", "yellow")}
