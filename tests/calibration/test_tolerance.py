"""Errors of the gauge widen the intervals as much as they must."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibration.assessment.quality import assess
from calibration.camera import camera_above, project
from calibration.estimation.bundle_adjustment import LENS_PARAMETERS, Prior, State, View, solve, whitening
from calibration.estimation.calibrate import calibrate
from calibration.estimation.gauge_tolerance import covariance_with_tolerance, with_tolerance
from calibration.gauge.geometry import Gauge, Tolerance
from calibration.store import camera_to_json, load_camera
from tests.calibration.drawing import draw_gauge, gauge_of, random_poses

CAMERA = camera_above(size_px=(400, 300), focal_px=1200, distance_mm=120, tilt_deg=3, k1=-0.2)


SIZE = {"columns": 11, "rows": 8}


def test_pitch_tolerance_enters_the_camera_its_file_and_the_sentence(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    views = random_poses(CAMERA, 4, rng, tilt_deg=25, shift_mm=2)
    images = [draw_gauge(view, gauge_of(**SIZE), rng=rng, snr=50) for view in views]
    for percent in (None, 0.5, 0.0):
        dots = {"columns": 11, "rows": 8, "pitch_mm": 3.0, "diameter_mm": 1.2}
        dots |= {} if percent is None else {"pitch_tolerance_percent": percent}
        found = calibrate(images, Gauge.model_validate({"format": 1, "name": "plate", "dots": dots}))
        stated = 0.001 if percent is None else percent / 100
        (tmp_path / "camera.json").write_text(camera_to_json(found), encoding="utf-8")
        camera = load_camera(tmp_path / "camera.json")
        at_marks = stated * 120 / (120 - 6.5)  # the lens is as far as the gauge says, the marks are as high as they are
        assert camera.scale_sigma(0.0) == pytest.approx(stated, abs=1e-4)
        assert camera.scale_sigma(6.5) == pytest.approx(at_marks, abs=1.5e-4)
        assert camera.with_exact_pitch().scale_sigma(6.5) < 2e-4
        said = f"{100 * stated:.2g} % from the pitch of the gauge" if stated else "if the pitch of the gauge is exact"
        assert said in assess(found).summary


def test_scale_tolerance_of_the_gauge_is_the_least_doubt_of_every_length() -> None:
    rng = np.random.default_rng(1)
    images = [
        draw_gauge(view, gauge_of(pitch_mm=3.003, **SIZE), rng=rng, snr=50)
        for view in random_poses(CAMERA, 4, rng, tilt_deg=25, shift_mm=2)
    ]
    verdict = assess(calibrate(images, gauge_of(tolerance={"scale": 0.001}, **SIZE)))
    assert 0.00099 < verdict.plate_scale_sigma < 0.00102
    # the distance of the lens is measured with the same gauge, the height of the marks is not
    assert abs(verdict.scale_sigma - 0.001 * 120 / (120 - 6.5)) < 2e-5
    assert assess(calibrate(images, gauge_of(tolerance={"scale": 0.0}, **SIZE))).scale_sigma < 1e-4


def test_displaced_dots_scatter_the_camera_as_the_covariance_says() -> None:
    rng = np.random.default_rng(3)
    tolerance, noise_px = Tolerance(dot_mm=0.01), 0.02
    poses = random_poses(CAMERA, 4, rng, tilt_deg=25, shift_mm=2)
    places = gauge_of(**SIZE).positions_mm().reshape(-1, 2)
    state = State(
        np.stack([p.parameters[:6] for p in poses]),
        CAMERA.parameters[6:],
        "brown",
        ("focal_px", "principal_x_px", "principal_y_px", "k1"),
    )
    prior = Prior(CAMERA.parameters[6:], np.full(len(LENS_PARAMETERS), 1e6))
    deviations, covariance = [], None
    for _ in range(150):
        true = places + rng.normal(0, tolerance.dot_mm, places.shape)
        views = [_seen(pose.parameters, true, places, noise_px, rng) for pose in poses]
        views = with_tolerance(views, state, tolerance)
        fit = solve(views, state, prior)
        covariance = covariance_with_tolerance(views, replace(fit, variance=1.0), tolerance)
        deviations.append(fit.state.lens[[0, 2, 3, 4]] - CAMERA.parameters[[6, 8, 9, 10]])
    assert covariance is not None
    ratio = np.std(deviations, axis=0) / np.sqrt(np.diag(covariance)[:4])
    assert np.all((ratio > 0.85) & (ratio < 1.15))  # of 150 draws the spread is known to 6 %


def _seen(parameters: np.ndarray, true: np.ndarray, places: np.ndarray, noise: float, rng: np.random.Generator) -> View:
    def lifted(plane: np.ndarray) -> np.ndarray:
        return np.column_stack([plane, np.zeros(len(plane))])

    centers = project(lifted(true), parameters, "brown")[0] + rng.normal(0, noise, true.shape)
    count = len(true)
    return View(
        centers, whitening(np.tile(noise**2 * np.eye(2), (count, 1, 1))), lifted(places), np.full(count, 0.6),
        np.arange(count), np.zeros((count, 2)), np.zeros((count, 0)),
    )  # fmt: skip
