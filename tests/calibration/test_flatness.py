"""A gauge that is not flat: solved for where several poses tell, counted as doubt where one image cannot."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.assessment.camera_check import check_camera
from calibration.assessment.quality import assess
from calibration.camera import camera_above
from calibration.estimation.calibrate import Calibration, calibrate
from calibration.estimation.flatness import face_terms
from calibration.store import camera_to_json
from tests.calibration.drawing import draw_gauge, gauge_of, random_poses

CAMERA = camera_above(size_px=(400, 300), focal_px=1200, distance_mm=120, tilt_deg=3, k1=-0.2)


PLATE = {"columns": 12, "pitch_tolerance_percent": 0.0}
FACE_MM = face_terms(gauge_of(**PLATE)) @ np.array([0.06, 0.04, -0.05, 0.01, 0.0, 0.01, 0.0])


def images(count: int, face_mm: np.ndarray | float) -> list[np.ndarray]:
    rng = np.random.default_rng(6)
    views = random_poses(CAMERA, count, rng, tilt_deg=25, shift_mm=2)
    return [draw_gauge(view, gauge_of(**PLATE), rng=rng, snr=50, face_mm=face_mm) for view in views]


@pytest.fixture(scope="module")
def bent() -> Calibration:
    return calibrate(images(6, FACE_MM), gauge_of(**PLATE))


def test_bend_is_measured_and_the_camera_freed_of_it(bent: Calibration) -> None:
    shape = bent.flatness
    assert shape is not None
    assert shape.used
    assert shape.low_mm < np.ptp(FACE_MM) < shape.high_mm
    assert shape.high_mm - shape.low_mm < 0.05 * np.ptp(FACE_MM)
    points = np.stack(np.meshgrid(np.linspace(20, 380, 5), np.linspace(20, 280, 4)), axis=-1)
    error = bent.camera.plate_from_image(points, 6.5) - CAMERA.plate_from_image(points, 6.5)
    assert np.sqrt(np.mean(error**2)) < 0.002  # 0.005 where the gauge is taken as flat


def test_height_at_which_a_bent_gauge_lies_is_counted_as_doubt(bent: Calibration) -> None:
    verdict = assess(bent)
    assert any("it rests are unknown" in note for note in verdict.notes)
    # a third of the peak to valley, 120 mm away
    assert 0.9 < verdict.scale_sigma / (np.ptp(FACE_MM) / 3 / 113.5) < 1.2


def test_bent_gauge_back_on_the_plate_finds_the_camera_as_it_was(bent: Calibration) -> None:
    image = draw_gauge(CAMERA, gauge_of(**PLATE), rng=np.random.default_rng(9), snr=50, face_mm=FACE_MM)
    shape = bent.flatness
    assert shape is not None
    face = tuple(shape.coefficients_mm.tolist())
    found = check_camera(bent.camera, bent.gauge, image, variance=bent.fit.variance, face_mm=face)
    assert found.outcome == "holds"
    assert '"peak_to_valley_mm"' in camera_to_json(bent)


def test_flat_gauge_is_taken_as_flat_and_bounded() -> None:
    found = calibrate(images(6, 0.0), gauge_of(**PLATE))
    assert found.flatness is not None
    assert not found.flatness.used
    assert found.flatness.high_mm < 0.02
    assert assess(found).scale_sigma < 2e-4


def test_single_image_says_that_it_cannot_tell_and_counts_a_stated_flatness() -> None:
    (image,) = images(1, 0.0)
    silent = calibrate([image], gauge_of(**PLATE), distance_mm=(120.0, 0.1))
    stated = calibrate([image], gauge_of(tolerance={"flatness_mm": 0.2}, **PLATE), distance_mm=(120.0, 0.1))
    assert silent.flatness is None
    assert any("cannot distinguish bending from lens distortion" in note for note in assess(silent).notes)
    corner = np.array([10.0, 10.0])
    sigma = [np.sqrt(np.trace(found.camera.plate_covariance(corner, 0.0))) for found in (silent, stated)]
    assert sigma[1] > 5 * sigma[0]
