"""A calibration holds until camera or lens change."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from calibration.assessment.camera_check import check_camera
from calibration.camera import PARAMETERS, Camera, camera_above
from calibration.estimation.calibrate import Calibration, calibrate
from calibration.gauge.geometry import Gauge
from tests.calibration.drawing import draw_gauge, posed, random_poses

GAUGE = Gauge.model_validate(
    {"format": 1, "name": "test", "dots": {"columns": 13, "rows": 9, "pitch_mm": 3.0, "diameter_mm": 1.2}}
)
CAMERA = camera_above(size_px=(400, 300), focal_px=1200, distance_mm=120, tilt_deg=3, k1=-0.3)


@pytest.fixture(scope="module")
def calibrated() -> Calibration:
    rng = np.random.default_rng(4)
    views = random_poses(CAMERA, 5, rng, tilt_deg=25, shift_mm=3)
    return calibrate([draw_gauge(view, GAUGE, rng=rng, snr=50) for view in views], GAUGE)


def test_check_says_how_much_a_lens_refocused_at_another_distance_could_hide(calibrated: Calibration) -> None:
    straight = camera_above(size_px=(400, 300), focal_px=1200, distance_mm=120)
    unbent = replace(straight, covariance=calibrated.camera.covariance)
    farther = camera_above(size_px=(400, 300), focal_px=1260, distance_mm=126)
    image = draw_gauge(farther, GAUGE, rng=np.random.default_rng(3), snr=50)
    found = check_camera(unbent, GAUGE, image)
    hidden = (1 - 6.5 / 120) / (1 - 6.5 / 126) - 1
    assert abs(hidden) < found.unseen < 0.01
    assert found.outcome == "holds"
    assert "refocusing and another distance together" in found.summary


def _with(**values: float) -> Camera:
    parameters = CAMERA.parameters.copy()
    for name, value in values.items():
        parameters[PARAMETERS.index(name)] = value
    return replace(CAMERA, parameters=parameters)


def _outcome(calibrated: Calibration, camera: Camera, seed: int) -> str:
    image = draw_gauge(camera, GAUGE, rng=np.random.default_rng(seed), snr=50)
    return check_camera(calibrated.camera, GAUGE, image, variance=calibrated.fit.variance).outcome


@pytest.mark.parametrize("seed", range(3))
def test_unchanged_camera_holds_wherever_the_gauge_lies(calibrated: Calibration, seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn = cv2.Rodrigues(np.array([0.0, 0.0, rng.uniform(-0.3, 0.3)]))[0]
    assert _outcome(calibrated, posed(CAMERA, turn, np.array([*rng.uniform(-2, 2, 2), 0.0])), seed) == "holds"


def test_camera_pushed_nearer_no_longer_holds(calibrated: Calibration) -> None:
    assert _outcome(calibrated, posed(CAMERA, np.eye(3), np.array([0.0, 0.0, 0.5])), 5) == "no longer holds"


def test_change_beyond_what_can_be_counted_is_said_as_more_than_that(calibrated: Calibration) -> None:
    image = draw_gauge(posed(CAMERA, np.eye(3), np.array([0.0, 0.0, 5.0])), GAUGE, rng=np.random.default_rng(5))
    summary = check_camera(calibrated.camera, GAUGE, image, variance=calibrated.fit.variance).summary
    assert "pose more than 37 sigma" in summary
    assert "37.0" not in summary


def test_change_that_rounds_to_nothing_has_no_sign(calibrated: Calibration) -> None:
    image = draw_gauge(CAMERA, GAUGE, rng=np.random.default_rng(5), snr=50)
    found = check_camera(calibrated.camera, GAUGE, image, variance=calibrated.fit.variance)
    summary = replace(found, length_change=-4e-7, distance_mm=-2e-4).summary
    assert "lengths by up to 0.000 %" in summary
    assert "degrees, 0.000 mm" in summary


def test_camera_tilted_by_a_degree_no_longer_holds_for_what_it_does_to_the_rim(calibrated: Calibration) -> None:
    turn = cv2.Rodrigues(np.array([np.radians(1.0), 0.0, 0.0]))[0]
    assert _outcome(calibrated, posed(CAMERA, turn, np.zeros(3)), 7) == "no longer holds"


def test_refocused_lens_no_longer_holds_at_equal_scale(calibrated: Calibration) -> None:
    changed = _with(focal_px=1200 * 1.03, translation_z_mm=CAMERA.value("translation_z_mm") * 1.03, k1=-0.33)
    assert _outcome(calibrated, changed, 6) == "no longer holds"
