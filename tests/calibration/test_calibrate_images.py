"""Gauge images drawn exactly → camera, against the camera that drew them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibration.assessment.quality import assess
from calibration.assignment.lattice import assign_grid
from calibration.camera import PARAMETERS, camera_above, project
from calibration.detection.dots import detect_dots
from calibration.errors import CalibrationError
from calibration.estimation.calibrate import Calibration, calibrate
from calibration.gauge.geometry import Gauge
from calibration.lens import LensModel
from calibration.store import camera_to_json, load_camera
from tests.calibration.drawing import draw_gauge, random_poses

GAUGE = Gauge.model_validate(
    {
        "format": 1,
        "name": "test",
        "dots": {"columns": 11, "rows": 8, "pitch_mm": 3.0, "diameter_mm": 1.2, "pitch_tolerance_percent": 0.0},
    }
)
CAMERA = camera_above(
    size_px=(400, 300), focal_px=1200, distance_mm=120, tilt_deg=4, tilt_azimuth_deg=30, turn_deg=5, k1=-0.3
)


@pytest.fixture(scope="module")
def calibrated() -> Calibration:
    rng = np.random.default_rng(4)
    views = random_poses(CAMERA, 5, rng, tilt_deg=25, shift_mm=3)
    return calibrate([draw_gauge(view, GAUGE, rng=rng, snr=50) for view in views], GAUGE)


def test_points_at_mark_height_are_placed_within_the_stated_uncertainty(calibrated: Calibration) -> None:
    points = np.stack(np.meshgrid(np.linspace(20, 380, 5), np.linspace(20, 280, 4)), axis=-1)
    error = calibrated.camera.plate_from_image(points, 6.5) - CAMERA.plate_from_image(points, 6.5)
    sigma = np.sqrt(np.einsum("...ii->...i", calibrated.camera.plate_covariance(points, 6.5)))
    assert np.abs(error).max() < 0.004
    assert np.sqrt(np.mean((error / sigma) ** 2)) < 2.5
    assert assess(calibrated).level == "sound"


def test_camera_file_gives_the_camera_back(calibrated: Calibration, tmp_path: Path) -> None:
    path = tmp_path / "camera.json"
    path.write_text(camera_to_json(calibrated), encoding="utf-8")
    camera = load_camera(path)
    assert np.array_equal(camera.parameters, calibrated.camera.parameters)
    assert np.array_equal(camera.covariance, calibrated.camera.covariance)
    assert camera.doubt == ""


def test_single_parallel_image_states_its_doubt_at_mark_height() -> None:
    camera = camera_above(size_px=(400, 300), focal_px=1200, distance_mm=120)
    found = calibrate([draw_gauge(camera, GAUGE, rng=np.random.default_rng(1), snr=50)], GAUGE)
    verdict = assess(found)
    assert verdict.level == "limited"
    assert verdict.plate_scale_sigma < 1e-4
    truth = 6.5 / 120
    assert 0.3 * truth < verdict.scale_sigma < 3 * truth


def test_blank_image_is_one_clear_sentence() -> None:
    with pytest.raises(CalibrationError, match="dots of color black found"):
        calibrate([np.full((300, 400), 128, np.uint8)], GAUGE)


def test_every_dot_in_view_is_found_and_assigned() -> None:
    dots = detect_dots(draw_gauge(CAMERA, GAUGE, rng=np.random.default_rng(0), snr=30))
    assert len(dots) == 88
    assert len(assign_grid(dots)) == 88


@pytest.mark.parametrize(
    ("lens", "bent"), [("brown", (-0.3, 0.1, 0.001, -0.002, 0.02, 0)), ("fisheye", (-0.05, 0.01, 0, 0, 0.003, -0.001))]
)
def test_derivatives_of_the_projection_agree_with_differences(lens: LensModel, bent: tuple[float, ...]) -> None:
    parameters = CAMERA.parameters.copy()
    parameters[10:] = bent
    camera = replace(CAMERA, parameters=parameters, lens=lens)
    points = np.column_stack([np.random.default_rng(2).uniform(-12, 12, (20, 2)), np.full(20, 6.5)])
    seen, _, by_parameter = project(points, parameters, lens)
    assert np.allclose(camera.plate_from_image(seen, 6.5), points[:, :2], atol=1e-10)
    for index in range(len(PARAMETERS)):
        step = np.zeros(len(PARAMETERS))
        step[index] = 1e-6
        difference = project(points, parameters + step, lens)[0] - project(points, parameters - step, lens)[0]
        assert np.allclose(by_parameter[:, :, index], difference / 2e-6, atol=1e-5, rtol=1e-5)
