"""The camera model against its numerical derivatives, its inverse, and geometry worked out on paper."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from calibration.camera import PARAMETERS, Camera, camera_above, camera_height, image_points, project
from calibration.lens import LensModel, distort, undistort

BENT = {"brown": [-0.12, 0.05, 0.003, -0.002, 0.01, 0.0], "fisheye": [0.06, -0.02, 0.0, 0.0, 0.01, -0.004]}
POINTS_MM = np.array([[0.0, 0.0, 0.0], [21.0, -13.0, 6.5], [-30.0, 24.0, 2.0], [8.0, 19.0, -1.0]])
LENSES: Any = pytest.mark.parametrize("lens", ["brown", "fisheye"])


def crooked(lens: LensModel) -> Camera:
    """A camera with all its parameters, pixels that are not square, and a strong lens."""
    camera = camera_above(
        size_px=(640, 480), focal_px=600.0, distance_mm=90.0, tilt_deg=20.0, tilt_azimuth_deg=50.0, turn_deg=30.0
    )
    parameters = camera.parameters.copy()
    parameters[7], parameters[8:10], parameters[10:] = 1.2, (300.0, 250.0), BENT[lens]
    return replace(camera, parameters=parameters, lens=lens)


@LENSES
def test_derivatives_of_the_projection_are_those_of_differences(lens: LensModel) -> None:
    camera = crooked(lens)
    _, by_point, by_parameter = project(POINTS_MM, camera.parameters, lens)
    for k in range(3):
        step = 1e-4 * np.eye(3)[k]
        ends = [project(POINTS_MM + side * step, camera.parameters, lens)[0] for side in (1, -1)]
        np.testing.assert_allclose(by_point[:, :, k], (ends[0] - ends[1]) / 2e-4, rtol=1e-6, atol=1e-6)
    for k in range(len(PARAMETERS)):
        step = 1e-6 * np.eye(len(PARAMETERS))[k]
        ends = [project(POINTS_MM, camera.parameters + side * step, lens)[0] for side in (1, -1)]
        np.testing.assert_allclose(by_parameter[:, :, k], (ends[0] - ends[1]) / 2e-6, rtol=1e-5, atol=1e-4)


@LENSES
def test_image_points_alone_are_those_that_come_with_derivatives_to_the_last_bit(lens: LensModel) -> None:
    camera = crooked(lens)
    behind = np.array([[0.0, 0.0, 500.0]])
    points = np.concatenate([POINTS_MM, behind])
    alone, together = (of(points, camera.parameters, lens) for of in (image_points, lambda *at: project(*at)[0]))
    np.testing.assert_array_equal(alone, together)
    assert np.isnan(alone).all(axis=1).tolist() == [False] * 4 + [True]


@LENSES
def test_points_of_an_image_are_laid_on_a_plane_with_the_derivatives_of_differences(lens: LensModel) -> None:
    camera, height = crooked(lens), 6.5
    wanted = POINTS_MM[:, :2]
    seen = camera.image_from_plate(np.column_stack([wanted, np.full(4, height)]))
    np.testing.assert_allclose(camera.plate_from_image(seen, height), wanted, atol=1e-9)
    jacobian, sensitivity = camera.plate_jacobian(seen, height), camera.plate_sensitivity(seen, height)
    for k in range(2):
        ends = [camera.plate_from_image(seen + side * 1e-3 * np.eye(2)[k], height) for side in (1, -1)]
        np.testing.assert_allclose(jacobian[:, :, k], (ends[0] - ends[1]) / 2e-3, rtol=1e-5, atol=1e-8)
    for k in range(len(PARAMETERS)):
        step = 1e-6 * np.eye(len(PARAMETERS))[k]
        moved = [replace(camera, parameters=camera.parameters + side * step) for side in (1, -1)]
        ends = [each.plate_from_image(seen, height) for each in moved]
        np.testing.assert_allclose(sensitivity[:, :, k], (ends[0] - ends[1]) / 2e-6, rtol=1e-4, atol=1e-6)
    covariance = np.diag(np.arange(1.0, 17.0)) * 1e-6
    found = replace(camera, covariance=covariance).plate_covariance(seen, height)
    np.testing.assert_allclose(found, np.einsum("nip,pq,njq->nij", sensitivity, covariance, sensitivity))


@LENSES
def test_undistorting_undoes_distorting_and_ends_where_the_lens_turns_back(lens: LensModel) -> None:
    points = np.random.default_rng(1).uniform(-0.6, 0.6, (50, 2))
    coefficients = np.array(BENT[lens])
    np.testing.assert_allclose(undistort(distort(points, coefficients, lens)[0], coefficients, lens), points, atol=1e-9)
    turning = np.array([-0.5, 0.0, 0.0, 0.0, 0.0, 0.0])  # r·(1 − r²/2) rises to r = √(2/3), and θ·(1 − θ²/2) as far
    highest = np.sqrt(2 / 3) * 2 / 3
    found = undistort(np.array([[0.999 * highest, 0.0], [1.001 * highest, 0.0]]), turning, lens)
    assert found[0, 0] == pytest.approx(np.sqrt(2 / 3) if lens == "brown" else np.tan(np.sqrt(2 / 3)), rel=0.06)
    assert np.isnan(found[1]).all()
    late, angle = np.array([0.0, 0.0, 0.0, 0.0, 0.0, -0.5]), (1 / 4.5) ** (1 / 8)  # θ·(1 − θ⁸/2) rises to θ⁸ = 2/9
    ends = np.array([[0.0, 0.9998], [0.0, 1.0002]]) * angle * (1 - 1 / 9)
    assert np.isnan(undistort(ends, late, "fisheye")).tolist() == [[False, False], [True, True]]
    straight = undistort(np.array([[0.3, 0.4]]), np.zeros(6), "fisheye")  # an angle of half a radian
    np.testing.assert_allclose(straight, np.tan(0.5) * np.array([[0.6, 0.8]]))


def test_what_is_behind_the_camera_is_not_seen_and_no_line_of_sight_goes_there() -> None:
    camera = camera_above(size_px=(640, 480), focal_px=600.0, distance_mm=90.0)
    assert np.isnan(camera.image_from_plate([0.0, 0.0, 91.0])).all()
    assert np.isfinite(camera.image_from_plate([0.0, 0.0, 89.0])).all()
    assert np.isnan(camera.plate_from_image([319.5, 239.5], 91.0)).all()
    assert camera.plate_from_image([319.5, 239.5], 89.0) == pytest.approx((0.0, 0.0), abs=1e-9)


def test_a_camera_looks_from_where_it_is_said_to_stand() -> None:
    """Image right is plate +x, turned about the axis; the axis leans toward the azimuth."""
    turned = camera_above(size_px=(641, 481), focal_px=600.0, distance_mm=100.0, turn_deg=30.0, center_mm=(4.0, 5.0))
    offset = turned.image_from_plate([[14.0, 5.0, 0.0], [4.0, 15.0, 0.0]]) - (320.0, 240.0)
    np.testing.assert_allclose(offset, 60.0 * np.array([[np.sqrt(0.75), 0.5], [0.5, -np.sqrt(0.75)]]))
    tilted = camera_above(size_px=(641, 481), focal_px=600.0, distance_mm=100.0, tilt_deg=30.0, tilt_azimuth_deg=90.0)
    assert camera_height(tilted.pose)[0] == pytest.approx(100.0 * np.sqrt(0.75))
    np.testing.assert_allclose(tilted.image_from_plate([0.0, 0.0, 0.0]), (320.0, 240.0), atol=1e-9)
    near, far = tilted.image_from_plate([[0.0, -10.0, 0.0], [0.0, 10.0, 0.0]])[:, 1] - 240.0
    # 10 mm along the azimuth are 10·cos 30° across the line of sight and 10·sin 30° farther along it.
    assert (near, far) == pytest.approx((600 * 8.660254 / 95.0, -600 * 8.660254 / 105.0))
    assert crooked("brown").focal_xy_px.tolist() == pytest.approx([600.0, 720.0])


def test_uncertainty_of_lengths_is_that_of_focal_length_and_height_without_the_pitch_where_it_cancels() -> None:
    camera = camera_above(size_px=(640, 480), focal_px=600.0, distance_mm=90.0)
    index = {name: PARAMETERS.index(name) for name in ("focal_px", "translation_z_mm")}
    focal = np.zeros((16, 16))
    focal[index["focal_px"], index["focal_px"]] = 6.0**2
    assert replace(camera, covariance=focal).scale_sigma(6.5) == pytest.approx(0.01)
    assert replace(camera, covariance=focal).scale_sigma(6.5, (100.0, 400.0)) == pytest.approx(0.01)
    aspect = np.zeros((16, 16))
    aspect[PARAMETERS.index("aspect"), PARAMETERS.index("aspect")] = 0.01**2  # of lengths along y alone
    assert replace(camera, covariance=aspect).scale_sigma(6.5) == pytest.approx(0.005)
    pitch = np.zeros(16)
    pitch[index["translation_z_mm"]] = 0.18  # of 90 mm, and of 83.5 mm at 6.5 mm above the plate
    both = replace(camera, covariance=focal + np.outer(pitch, pitch), pitch_error=pitch)
    assert both.scale_sigma(6.5) == pytest.approx(np.hypot(0.01, 0.18 / 83.5))
    assert both.with_exact_pitch().scale_sigma(6.5) == pytest.approx(0.01)
