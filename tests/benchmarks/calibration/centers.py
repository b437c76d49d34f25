"""Dot centres against the Cramér-Rao bound, and their bias."""

from __future__ import annotations

import click
import numpy as np

from calibration.camera import camera_above
from calibration.detection.dots import detect_dots
from calibration.estimation.disc_projection import fitted_centers
from tests.benchmarks.calibration.rig import SIZE_PX, Array, gauge_of
from tests.calibration.drawing import draw_gauge


@click.command()
@click.option("--images", default=4)
def centers(images: int) -> None:
    """Dot centres: error at 20 px diameter, SNR 30, blur 0.8 px, against the Cramér-Rao bound; bias without noise."""
    print("    tilt     k1   RMS px   CRB px  ratio  stated/RMS | noise-free: bias px  uncorrected px")
    for tilt, k1 in ((0, 0.0), (20, 0.0), (40, 0.0), (0, -0.3), (20, -0.3), (40, -0.3)):
        noisy = [_center_errors(tilt, k1, seed, snr=30.0) for seed in range(images)]
        clean = [_center_errors(tilt, k1, seed, snr=np.inf) for seed in range(images)]
        error, bound, stated = (np.concatenate([row[k] for row in noisy]) for k in (0, 1, 2))
        bias, raw = (np.concatenate([row[k] for row in clean]) for k in (0, 3))
        rms, crb, said = (float(np.sqrt((x**2).mean())) for x in (error, bound, stated))
        print(
            f"{tilt:8d} {k1:6.1f} {rms:8.4f} {crb:8.4f} {rms / crb:6.2f} {said / rms:11.2f} |"
            f" {np.sqrt((bias**2).mean()):19.4f} {np.sqrt((raw**2).mean()):15.4f}"
        )


def _center_errors(tilt: float, k1: float, seed: int, snr: float) -> tuple[Array, Array, Array, Array]:
    """Errors (n, 2), their bound (n, 2), stated sigmas (n, 2), and errors with discs uncorrected."""
    rng = np.random.default_rng(seed)
    gauge = gauge_of(2.4, 1.0, 13, 9)
    camera = camera_above(
        size_px=SIZE_PX,
        focal_px=900,
        distance_mm=45,
        tilt_deg=tilt,
        tilt_azimuth_deg=rng.uniform(0, 360),
        turn_deg=rng.uniform(0, 30),
        center_mm=tuple(rng.uniform(-0.5, 0.5, 2)),
        k1=k1,
    )
    blur = 0.8
    image = draw_gauge(camera, gauge, rng=rng, snr=snr, blur_px=blur, quantise=False)
    dots = detect_dots(image, "black", "white")
    points = np.column_stack([gauge.positions_mm().reshape(-1, 2), np.zeros(13 * 9)])
    predicted = fitted_centers(points, np.full(len(points), 0.5), camera.parameters, camera.lens)
    distance = np.hypot(*(dots.centers_px[:, None] - predicted[None]).transpose(2, 0, 1))
    own = distance.argmin(axis=1)
    near = distance[np.arange(len(own)), own] < 3
    own, center = own[near], dots.centers_px[near]
    stated = np.sqrt(np.einsum("nii->ni", dots.covariance_px2[near]))
    bound = _bound(dots.shape[near], blur, 30.0)
    return center - predicted[own], bound, stated, center - camera.image_from_plate(points)[own]


def _bound(shape: Array, blur_px: float, snr: float) -> Array:
    """Cramér-Rao bound of both coordinates of a blurred ellipse whose other parameters are even and so do not matter.

    The Fisher information is snr² ∮ n nᵀ dl / (2 √π s), s² = blur² + 1/12 for the pixel.
    """
    angle = np.arange(64) * (2 * np.pi / 64)
    s = np.sqrt(blur_px**2 + 1 / 12)
    bounds = []
    for a11, a12, a22 in shape:
        half = np.linalg.inv(np.linalg.cholesky(np.array([[a11, a12], [a12, a22]]))).T
        rim = half @ np.stack([np.cos(angle), np.sin(angle)])
        step = np.roll(rim, -1, axis=1) - np.roll(rim, 1, axis=1)
        length = np.hypot(*step)
        normal = np.stack([step[1], -step[0]]) / length
        information = snr**2 * (normal * length / 2) @ normal.T / (2 * np.sqrt(np.pi) * s)
        bounds.append(np.sqrt(np.diag(np.linalg.inv(information))))
    return np.array(bounds)
