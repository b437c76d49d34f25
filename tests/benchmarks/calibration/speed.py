"""Time of detection and assignment."""

from __future__ import annotations

import time

import click
import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.assignment.lattice import assign_grid
from calibration.assignment.neighbours import nearest
from calibration.camera import camera_above
from calibration.detection.dots import detect_dots
from tests.benchmarks.calibration.rig import SIZE_PX, gauge_of
from tests.calibration.drawing import draw_gauge


@click.command()
def speed() -> None:
    """Best of several runs, first call (compilation) left out."""
    for size, columns, rows, limit in (((640, 480), 30, 20, 0.030), ((2560, 2160), 90, 70, 1.0)):
        field = 60.0
        gauge = gauge_of(field / (columns + 1), 0.45 * field / (columns + 1), columns, rows)
        camera = camera_above(size_px=size, focal_px=2.5 * size[0], distance_mm=2.5 * field, k1=-0.2)
        image = draw_gauge(camera, gauge, rng=np.random.default_rng(0), snr=30)
        times, work = [], []
        for _ in range(8):
            start, busy = time.perf_counter(), time.process_time()
            dots = detect_dots(image, "black", "white")
            lattice = assign_grid(dots)
            times.append(time.perf_counter() - start)
            work.append(time.process_time() - busy)
        spacing = float(np.median(nearest(dots.centers_px, 1)[0]))
        peer = _findcircles_time(image, columns, rows) if size == SIZE_PX else "minutes, not run"
        print(
            f"{size[0]}×{size[1]}, {len(lattice)} of {columns * rows} dots {spacing:.0f} px apart: "
            f"{1e3 * min(times):.0f} ms, {1e3 * min(work):.0f} ms of processor time "
            f"(asked {1e3 * limit:.0f} ms); OpenCV findCirclesGrid: {peer}"
        )


def _findcircles_time(image: NDArray[np.generic], columns: int, rows: int) -> str:
    start = time.perf_counter()
    good, _ = cv2.findCirclesGrid(image, (columns, rows), flags=cv2.CALIB_CB_SYMMETRIC_GRID)
    return f"{1e3 * (time.perf_counter() - start):.0f} ms, {'found' if good else 'not found'}"
