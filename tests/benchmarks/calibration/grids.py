"""Grids of dots, many of few and large ones: found by OpenCV's findCirclesGrid and by ours, side by side."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import click
import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.assignment.array_in_image import find_array
from calibration.assignment.gauge_in_image import sight
from calibration.detection.image import read_image
from calibration.errors import CalibrationError
from calibration.gauge.geometry import Gauge
from tests.calibration.grid_images import KINDS, GridImage, Layout, grid_images, grid_places

Array = NDArray[np.float64]
REAL = Path(__file__).parents[4] / "shared" / "real"
REAL_SETS: tuple[tuple[Path, Layout, int, int, float, bool], ...] = (
    (Path("dot_grids/symmetric_grid"), "symmetric", 6, 5, 0.6, False),
    (Path("dot_grids/asymmetric_grid"), "asymmetric", 4, 11, 0.7, False),
)
WRONG_PX = 3.0  # farther from every true centre: something else was taken for a dot


@click.command()
@click.option("--count", default=20, help="Images of each kind.")
@click.option("--seed", default=0)
@click.option("--kind", multiple=True, help="Only these.")
@click.option("--each", is_flag=True, help="Also name the images that ours misses.")
@click.option(
    "--photographs",
    multiple=True,
    type=(click.Path(path_type=Path), click.Choice(("symmetric", "asymmetric", "hexagonal")), int, int, float, bool),
    help="A folder of photographs instead: layout, columns, rows, diameter over distance, whether dots are bright.",
)
def grids(
    count: int,
    seed: int,
    kind: tuple[str, ...],
    each: bool,
    photographs: tuple[tuple[Path, Layout, int, int, float, bool], ...],
) -> None:
    """Whole grids found, wrong ones, and errors of the centres: OpenCV (default, area tuned), `dots`, `calibrate`."""
    print("whole grids found, and others (dots missing or too many); median error of centres, px")
    print(f"{'':16s} {'images':>6s} | {'OpenCV':>9s} | {'OpenCV, area':>16s} | {'dots':>9s} | {'calibrate':>16s} | s")
    for name in () if photographs else kind or KINDS:
        _row(name, list(grid_images(name, count, seed)), each)
    for name, *told in photographs or (() if kind else REAL_SETS):
        images = photographs_of(REAL / name, *told)
        if images:
            _row(Path(name).name[-16:], images, each)


def _row(name: str, images: list[GridImage], each: bool) -> None:
    finders: tuple[Callable[[GridImage], Array | None], ...] = (opencv_grid, opencv_tuned, found_dots, calibrated_dots)
    cells, seconds = [], 0.0
    for finder in finders:
        found = wrong = 0
        errors = []
        start = time.perf_counter()
        for number, image in enumerate(images):
            centers = finder(image)
            good, error = _judged(centers, image)
            found += good
            wrong += centers is not None and not good
            if good:
                errors.append(error)
            elif each and finder in {found_dots, calibrated_dots}:
                print(
                    f"    {name} {number} {image.kind} {finder.__name__}: {'none' if centers is None else len(centers)}"
                )
        seconds = time.perf_counter() - start
        tail = f" {np.median(errors):6.3f}" if finder in {opencv_tuned, calibrated_dots} and errors else ""
        cells.append(f"{found:4d} {wrong:4d}{tail}".ljust(16 if finder in {opencv_tuned, calibrated_dots} else 9))
    print(f"{name:16s} {len(images):6d} | {' | '.join(cells)} | {seconds / len(images):.2f}", flush=True)


def _judged(centers: Array | None, image: GridImage) -> tuple[bool, float]:
    """Whether each dot clearly in view is found once and nothing else is, and the RMS distance to the truth."""
    if centers is None:
        return False, np.nan
    if not np.isfinite(image.centers_px).any():  # a photograph: only the count is known
        return len(centers) == len(image.places), np.nan
    distance = np.hypot(*np.moveaxis(centers[:, None] - image.centers_px, -1, 0))
    distance[~np.isfinite(distance)] = np.inf
    near = distance.argmin(axis=1)
    off = distance[np.arange(len(centers)), near]
    once = len(centers) == len(set(near.tolist())) and off.max(initial=0) < WRONG_PX
    whole = once and set(np.flatnonzero(image.clear)) <= set(near.tolist())
    return bool(whole), float(np.sqrt(np.mean(off**2)))


def opencv_grid(image: GridImage, parameters: cv2.SimpleBlobDetector_Params | None = None) -> Array | None:
    shown = image.image if image.image.ndim == 2 else cv2.cvtColor(image.image, cv2.COLOR_BGR2GRAY)
    shown = 255 - shown if image.bright else shown
    if image.layout == "hexagonal":
        return None  # OpenCV has no such grid
    flag = cv2.CALIB_CB_SYMMETRIC_GRID if image.layout == "symmetric" else cv2.CALIB_CB_ASYMMETRIC_GRID
    detector = cv2.SimpleBlobDetector_create(parameters or cv2.SimpleBlobDetector_Params())
    for flags in (flag, flag | cv2.CALIB_CB_CLUSTERING):
        good, centers = cv2.findCirclesGrid(shown, image.size, flags=flags, blobDetector=detector)
        if good:
            return np.asarray(centers.reshape(-1, 2), dtype=float)
    return None


def opencv_tuned(image: GridImage) -> Array | None:
    """With the range of areas that fits the image."""
    parameters = cv2.SimpleBlobDetector_Params()
    parameters.minArea, parameters.maxArea = 20.0, 0.2 * image.image.shape[0] * image.image.shape[1]
    return opencv_grid(image, parameters)


def found_dots(image: GridImage) -> Array | None:
    dots, lattice = find_array(image.image)
    return dots.centers_px[lattice.dot] if len(lattice) else None


def calibrated_dots(image: GridImage) -> Array | None:
    try:
        found = sight(image.image, gauge_of(image), "image")
    except CalibrationError:
        return None
    return found.dots.centers_px[found.match.dot]


def gauge_of(image: GridImage) -> Gauge:
    """The gauge of an image, by the names and counts of OpenCV and BoofCV."""
    columns, rows = image.size
    dots: dict[str, object] = {"columns": columns, "rows": rows, "pitch_mm": 1.0, "diameter_mm": image.diameter}
    layout = {"symmetric": "symmetric", "asymmetric": "asymmetric", "hexagonal": "circle_hexagonal"}[image.layout]
    dots |= {"layout": layout, "pitch_mm": 2**-0.5 if layout == "asymmetric" else 1.0}
    if image.bright:
        dots |= {"color": "white", "background": "black"}
    return Gauge.model_validate({"format": 1, "name": "grid", "dots": dots})


def photographs_of(
    folder: Path, layout: Layout, columns: int, rows: int, diameter: float, bright: bool
) -> list[GridImage]:
    """Photographs of others; where their dots lie is not known, how many there are is."""
    paths = sorted(path for path in folder.glob("*") if path.suffix in {".png", ".jpg"})
    places = grid_places(layout, (columns, rows))
    unknown = np.full(places.shape, np.nan)
    return [
        GridImage(
            path.name,
            read_image(path),
            places,
            unknown,
            ~np.isnan(unknown[:, 0]),
            layout,
            (columns, rows),
            bright,
            diameter,
        )  # type: ignore[arg-type]
        for path in paths
    ]
