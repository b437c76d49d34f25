"""Error of the plane at mark height, and whether the stated intervals cover it."""

from __future__ import annotations

import click
import numpy as np

from calibration.camera import camera_above
from calibration.errors import CalibrationError
from calibration.estimation.calibrate import calibrate
from tests.benchmarks.calibration.rig import SIZE_PX, errors, gauge_of, random_camera
from tests.calibration.drawing import draw_gauge, random_poses


@click.command()
@click.option("--sets", default=10)
@click.option("--snr", default=30.0)
def plane(sets: int, snr: float) -> None:
    """Plane at mark height: 10 px/mm, 7 images of a 17 × 13 gauge, tilt to 20 degrees, plate partly out of view."""
    gauge = gauge_of(3.5, 1.4)
    results = []
    for seed in range(sets):
        rng = np.random.default_rng(seed)
        truth = camera_above(
            size_px=SIZE_PX, focal_px=1500, distance_mm=150, tilt_deg=3, tilt_azimuth_deg=rng.uniform(0, 360), k1=-0.2
        )
        images = [
            draw_gauge(view, gauge, rng=rng, snr=snr) for view in random_poses(truth, 7, rng, tilt_deg=20, shift_mm=8)
        ]
        results.append(errors(truth, calibrate(images, gauge).camera))
    rms, scale = np.array([r.rms_um for r in results]), np.array([r.scale for r in results])
    print(
        f"{sets} sets, SNR {snr:g}: plane {np.sqrt((rms**2).mean()):.2f} µm RMS (worst set {rms.max():.2f}), "
        f"scale {100 * np.sqrt((scale**2).mean()):.4f} % RMS (worst {100 * np.abs(scale).max():.4f} %)"
    )


@click.command()
@click.option("--cameras", default=300)
@click.option("--first", default=0, help="First seed.")
@click.option("--images", default=7, help="Of each camera; the first shows the gauge on the plate.")
@click.option("--verbose", is_flag=True)
def coverage(cameras: int, first: int, images: int, verbose: bool) -> None:
    """Stated 95 % intervals at mark height against the truth of random cameras."""
    inside, scales, failed, spread = [], [], 0, []
    for seed in range(first, first + cameras):
        rng = np.random.default_rng(seed)
        truth, gauge, field = random_camera(rng)
        views = random_poses(truth, images, rng, tilt_deg=20, shift_mm=0.12 * field)
        drawn = [draw_gauge(view, gauge, rng=rng, snr=30) for view in views]
        height = 0.04 * truth.value("translation_z_mm")  # the share that marks have at 150 mm
        try:
            found = calibrate(drawn, gauge)
        except CalibrationError as error:
            failed += 1
            print(f"camera {seed}: {error}")
            continue
        result = errors(truth, found.camera, height)
        inside.append(float((np.abs(result.z) < 1.96).mean()))
        scales.append(abs(result.scale_z) < 1.96)
        spread.append(float(np.sqrt((result.z**2).mean())))
        if verbose:
            print(
                f"{seed:4d} {truth.lens:8s} f {truth.value('focal_px'):6.0f} k1 {truth.value('k1'):6.3f} "
                f"field {field:5.0f} -> {found.camera.lens:8s} {'+'.join(found.fit.state.free):60s} "
                f"z {spread[-1]:6.2f} scale {result.scale_z:6.2f} rms {result.rms_um:7.2f} um "
                f"var {found.fit.variance:.3f} out {sum(found.rejected)}"
            )
    print(
        f"{cameras} cameras, {failed} not solved: {100 * np.mean(inside):.1f} % of the coordinates and "
        f"{100 * np.mean(scales):.1f} % of the scales lie within their 95 % interval; "
        f"median RMS z {np.median(spread):.2f}"
    )
