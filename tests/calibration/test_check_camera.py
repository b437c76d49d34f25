"""A calibration that is exact holds until camera or lens change, as images of the gauge show."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from calibration.assessment.camera_check import check_camera
from calibration.camera import PARAMETERS, Camera, camera_above
from tests.calibration.drawing import draw_gauge, gauge_of, posed

GAUGE = gauge_of()
CAMERA = camera_above(size_px=(400, 300), focal_px=1200, distance_mm=120, tilt_deg=3, k1=-0.3)


def test_check_says_how_much_a_lens_refocused_at_another_distance_could_hide() -> None:
    straight = camera_above(size_px=(400, 300), focal_px=1200, distance_mm=120)
    farther = camera_above(size_px=(400, 300), focal_px=1260, distance_mm=126)
    image = draw_gauge(farther, GAUGE, rng=np.random.default_rng(3), snr=50)
    found = check_camera(straight, GAUGE, image)
    hidden = (1 - 6.5 / 120) / (1 - 6.5 / 126) - 1
    assert abs(hidden) < found.unseen < 0.01
    assert found.outcome == "holds"
    assert "refocusing combined with a change of distance" in found.summary


def _with(**values: float) -> Camera:
    parameters = CAMERA.parameters.copy()
    for name, value in values.items():
        parameters[PARAMETERS.index(name)] = value
    return replace(CAMERA, parameters=parameters)


def _outcome(camera: Camera, seed: int) -> str:
    image = draw_gauge(camera, GAUGE, rng=np.random.default_rng(seed), snr=50)
    return check_camera(CAMERA, GAUGE, image).outcome


@pytest.mark.parametrize("seed", range(2))
def test_unchanged_camera_holds_wherever_the_gauge_lies(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn = cv2.Rodrigues(np.array([0.0, 0.0, rng.uniform(-0.3, 0.3)]))[0]
    assert _outcome(posed(CAMERA, turn, np.array([*rng.uniform(-2, 2, 2), 0.0])), seed) == "holds"


def test_camera_pushed_nearer_no_longer_holds() -> None:
    assert _outcome(posed(CAMERA, np.eye(3), np.array([0.0, 0.0, 0.5])), 5) == "no longer holds"


def test_camera_tilted_by_a_degree_no_longer_holds_for_what_it_does_to_the_rim() -> None:
    turn = cv2.Rodrigues(np.array([np.radians(1.0), 0.0, 0.0]))[0]
    assert _outcome(posed(CAMERA, turn, np.zeros(3)), 7) == "no longer holds"


def test_refocused_lens_no_longer_holds_at_equal_scale() -> None:
    changed = _with(focal_px=1200 * 1.03, translation_z_mm=CAMERA.value("translation_z_mm") * 1.03, k1=-0.33)
    assert _outcome(changed, 6) == "no longer holds"
