"""Calibration of one set of images by OpenCV and by turnscope."""

from __future__ import annotations

import time
from dataclasses import replace

import click
import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.camera import Camera, camera_above
from calibration.estimation.calibrate import calibrate
from calibration.gauge.geometry import Gauge
from tests.benchmarks.calibration.rig import SIZE_PX, errors, gauge_of
from tests.calibration.drawing import draw_gauge, random_poses


@click.command()
@click.option("--sets", default=4)
def opencv(sets: int) -> None:
    """One set of images through findCirclesGrid and calibrateCamera, and through turnscope."""
    print("  set                    |  OpenCV solved  plane um   time s |  ours solved  plane um   time s")
    for label, snr, shift in (
        ("clean, all in view", np.inf, 0.0),
        ("clean, partly out of view", np.inf, 8.0),
        ("SNR 30, partly out", 30.0, 8.0),
    ):
        totals: dict[str, list[float]] = {"cv": [], "ours": [], "cv_um": [], "um": [], "cv_s": [], "s": []}
        gauge = gauge_of(3.0 if shift == 0 else 3.5, 1.2)
        for seed in range(sets):
            rng = np.random.default_rng(seed)
            truth = camera_above(
                size_px=SIZE_PX, focal_px=1500, distance_mm=150, tilt_deg=3, tilt_azimuth_deg=40.0 * seed, k1=-0.2
            )
            views = random_poses(truth, 7, rng, tilt_deg=20, shift_mm=shift)
            images = [draw_gauge(view, gauge, rng=rng, snr=snr).astype(np.uint8) for view in views]
            start = time.perf_counter()
            share, found = _opencv(images, gauge)
            totals["cv_s"].append(time.perf_counter() - start)
            totals["cv"].append(share)
            totals["cv_um"].append(np.nan if found is None else errors(truth, found).rms_um)
            start = time.perf_counter()
            ours = calibrate(images, gauge)
            totals["s"].append(time.perf_counter() - start)
            totals["ours"].append(len(ours.views))
            totals["um"].append(errors(truth, ours.camera).rms_um)
        mean = {
            key: float(np.nanmedian(value)) if not np.all(np.isnan(value)) else np.nan for key, value in totals.items()
        }
        print(
            f"{label:24s} | {sum(totals['cv']):8.0f} of {7 * sets:2d} {mean['cv_um']:9.2f} {mean['cv_s']:8.2f} |"
            f" {sum(totals['ours']):5.0f} of {7 * sets:2d} {mean['um']:9.2f} {mean['s']:8.2f}"
        )


def _opencv(images: list[NDArray[np.uint8]], gauge: Gauge) -> tuple[int, Camera | None]:
    """Images solved, and the camera in the frame of the first image, None where that one is not solved."""
    places = gauge.positions_mm()
    shape = (gauge.dots.columns, gauge.dots.rows)
    plate = np.column_stack([places.reshape(-1, 2), np.zeros(places[..., 0].size)]).astype(np.float32)
    found = []
    for k, image in enumerate(images):
        good, centers = cv2.findCirclesGrid(image, shape, flags=cv2.CALIB_CB_SYMMETRIC_GRID)
        if good:
            # the grid may come back turned by half a turn; the plate's first dot is at the top left
            row_major = centers.reshape(-1, 2)
            ordered = row_major[::-1] if row_major[0].sum() > row_major[-1].sum() else row_major
            found.append((k, np.ascontiguousarray(ordered[:, None], dtype=np.float32)))
    if not found or found[0][0] != 0:
        return len(found), None
    _, matrix, bent, turns, shifts = cv2.calibrateCamera(
        [plate] * len(found), [c for _, c in found], SIZE_PX, None, None
    )
    parameters = np.zeros(16)
    parameters[:3], parameters[3:6] = turns[0][:, 0], shifts[0][:, 0]
    parameters[6:10] = matrix[0, 0], matrix[1, 1] / matrix[0, 0], matrix[0, 2], matrix[1, 2]
    parameters[10:15] = bent.ravel()[:5]
    return len(found), replace(
        camera_above(size_px=SIZE_PX, focal_px=1, distance_mm=1), parameters=parameters, covariance=np.eye(16)
    )
