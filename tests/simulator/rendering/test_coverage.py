"""Discs: blurred coverage against brute force, under perspective and distortion."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import RectBivariateSpline
from scipy.special import erf

from calibration.camera import Camera, camera_above
from simulator.rendering.coverage import add_disc, blur_kernel, square_share
from simulator.rendering.plane import plane_map

Array = np.ndarray


def brute_force(camera: Camera, center_mm: tuple[float, float], radius_mm: float, blur_px: float, size: int) -> Array:
    """Coverage from 80 × 80 point samples a pixel, blurred at full resolution.

    The exact camera places every third of a pixel; a cubic spline, good to 1e-7 px here, the points between.
    """
    parts, margin = 80, int(np.ceil(5 * blur_px + 1))
    at = (np.arange((size + 2 * margin) * parts) + 0.5) / parts - margin - 0.5
    middle = camera.image_from_plate(np.array([*center_mm, 6.5]))
    offset = np.floor(middle - size / 2)
    coarse = np.arange(-margin - 1, size + margin + 1, 1 / 3)
    columns, rows = np.meshgrid(coarse + offset[0], coarse + offset[1])
    points = camera.plate_from_image(np.stack([columns, rows], axis=-1), 6.5)
    x, y = (RectBivariateSpline(coarse, coarse, points[..., k])(at, at) - center_mm[k] for k in range(2))
    inside = (x**2 + y**2 < radius_mm**2).astype(np.float32)
    reach = (np.arange((2 * margin + 1) * parts) + 0.5) / parts - margin - 0.5
    s = np.sqrt(2) * blur_px
    weights = erf((reach + 0.5) / s) - erf((reach - 0.5) / s)
    weights /= weights.sum()
    filtering = np.zeros((size, len(at)))
    for k in range(size):
        filtering[k, k * parts : k * parts + len(weights)] = weights
    return np.asarray(filtering @ inside @ filtering.T)


def analytic(camera: Camera, center_mm: tuple[float, float], radius_mm: float, blur_px: float, size: int) -> Array:
    kernel = blur_kernel(blur_px)
    plane = plane_map(camera, 6.5, kernel.margin + 2)
    left, top = np.floor(camera.image_from_plate(np.array([*center_mm, 6.5])) - size / 2).astype(int)
    out = np.zeros((size, size))
    box = (int(left), int(top), int(left) + size, int(top) + size)
    disc = (*center_mm, radius_mm, 0.0)
    add_disc(plane.x_mm, plane.y_mm, plane.pad, box, disc, kernel.parts, kernel.weights, 1.0, out)
    return out


def centroid(cover: Array) -> Array:
    rows, columns = np.indices(cover.shape)
    return np.array([(cover * columns).sum(), (cover * rows).sum()]) / cover.sum()


@pytest.mark.parametrize(
    ("tilt_deg", "k1", "radius_mm", "blur_px"),
    [
        (0.0, 0.0, 0.5, 0.8),
        (20.0, -0.3, 0.5, 0.8),
        (40.0, -0.3, 1.0, 0.5),
        (5.0, 0.1, 0.25, 1.5),
        (0.0, -0.2, 0.3, 0.3),
    ],
)
def test_disc_agrees_with_brute_force_to_a_thousandth(
    tilt_deg: float, k1: float, radius_mm: float, blur_px: float
) -> None:
    camera = camera_above(
        size_px=(320, 240), focal_px=1500, distance_mm=150, tilt_deg=tilt_deg, tilt_azimuth_deg=30, k1=k1
    )
    center, size = (5.1234, -3.217), 2 * int(np.ceil(radius_mm * 10.5 + 4.5 * blur_px + 2))
    ours, exact = (draw(camera, center, radius_mm, blur_px, size) for draw in (analytic, brute_force))
    assert np.abs(ours - exact).max() < 1e-3
    assert np.abs(centroid(ours) - centroid(exact)).max() < 1e-3


def test_share_of_a_square_is_its_area_on_one_side_of_a_line() -> None:
    rng = np.random.default_rng(1)
    at = (np.arange(400) + 0.5) / 400 - 0.5
    x, y = np.meshgrid(at, at)
    for _ in range(20):
        angle, distance = rng.uniform(0, 2 * np.pi), rng.uniform(-0.8, 0.8)
        normal = np.array([np.cos(angle), np.sin(angle)])
        area = float((normal[0] * x + normal[1] * y < distance).mean())
        assert square_share(distance, abs(normal[0]) / 2, abs(normal[1]) / 2) == pytest.approx(area, abs=2e-3)
    assert square_share(0.2, 0.5, 0.0) == pytest.approx(0.7)  # an edge along the square's own
    assert (square_share(0.5, 0.5, 0.0), square_share(-0.5, 0.0, 0.5)) == (1.0, 0.0)


def test_disc_that_loses_light_toward_its_rim_loses_half_of_that_on_the_whole() -> None:
    """Light 1 - s·(r/R)² over a disc: 1 - s/2 in the mean."""
    camera = camera_above(size_px=(64, 64), focal_px=1500, distance_mm=150)
    kernel = blur_kernel(0.8)
    plane, total = plane_map(camera, 0.0, kernel.margin + 2), []
    for shading in (0.0, 0.4):
        out = np.zeros((64, 64))
        disc = (0.03, -0.02, 1.5, shading)
        add_disc(plane.x_mm, plane.y_mm, plane.pad, (0, 0, 64, 64), disc, kernel.parts, kernel.weights, 0.5, out)
        total.append(out.sum())
    assert total[0] == pytest.approx(0.5 * np.pi * 15**2, rel=1e-3)  # 10 px a mm
    assert total[1] / total[0] == pytest.approx(0.8, rel=1e-3)
