"""Plane maps agree with the camera, and know where the plane ends."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.camera import Camera, camera_above
from simulator.rendering.plane import NOWHERE_MM, camera_from, plane_map


@pytest.mark.parametrize(
    "camera",
    [
        camera_above(size_px=(641, 479), focal_px=1600, distance_mm=150, tilt_deg=35, k1=-0.3, k2=0.05),
        camera_above(size_px=(640, 480), focal_px=300, distance_mm=30, tilt_deg=5, lens="fisheye", k1=-0.03),
    ],
    ids=["brown", "fisheye"],
)
def test_map_lies_within_a_millionth_of_a_pixel_of_the_camera(camera: Camera) -> None:
    plane = plane_map(camera, 6.5, 5)
    rows, columns = np.random.default_rng(1).integers(0, 480, (2, 500))
    points = np.stack([plane.x_mm[rows, columns], plane.y_mm[rows, columns]], axis=-1)
    back = plane.image_from_plane(points)
    assert np.abs(back - np.stack([columns - 5, rows - 5], axis=-1)).max() < 1e-6


def test_rays_above_the_horizon_meet_the_plane_nowhere() -> None:
    camera = camera_above(size_px=(320, 240), focal_px=200, distance_mm=150, tilt_deg=75, tilt_azimuth_deg=0)
    plane = plane_map(camera, 0.0, 3)
    nowhere = plane.x_mm == NOWHERE_MM
    assert nowhere.any()
    assert not nowhere.all()


def test_camera_seen_from_a_tilted_gauge_gives_the_same_pixels() -> None:
    camera = camera_above(size_px=(320, 240), focal_px=900, distance_mm=150, tilt_deg=5, k1=-0.2)
    rotation, translation = np.array([0.2, -0.1, 0.4]), np.array([3.0, -2.0, 8.0])
    import cv2

    points = np.random.default_rng(2).uniform(-8, 8, (20, 3))
    on_plate = points @ cv2.Rodrigues(rotation)[0].T + translation
    seen = camera_from(camera, rotation, translation).image_from_plate(points)
    assert seen == pytest.approx(camera.image_from_plate(on_plate), abs=1e-9)
