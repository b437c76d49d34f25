"""A camera and its views of a gauge, drawn without images."""

from __future__ import annotations

import numpy as np

from calibration.camera import camera_above, project
from calibration.estimation.bundle_adjustment import (
    LENS_PARAMETERS,
    Prior,
    State,
    View,
    _moved,
    whitening,
)
from calibration.estimation.flatness import (
    face_terms,
)
from tests.calibration.drawing import gauge_of, random_poses

CAMERA = camera_above(size_px=(400, 300), focal_px=1200, distance_mm=120, tilt_deg=3, k1=-0.2)
GAUGE = gauge_of(columns=11, rows=8)
LOOSE = Prior(CAMERA.lens_parameters, np.full(len(LENS_PARAMETERS), 1e6))
FREE = ("focal_px", "principal_x_px", "principal_y_px", "k1")


def seen(parameters: np.ndarray, rng: np.random.Generator, noise_px: float = 0.02, face_terms_: int = 3) -> View:
    places = np.column_stack([GAUGE.positions_mm().reshape(-1, 2), np.zeros(88)])
    return View(
        project(places, parameters, "brown")[0] + noise_px * rng.normal(size=(88, 2)),
        whitening(np.tile(max(noise_px, 0.02) ** 2 * np.eye(2), (88, 1, 1))),
        places,
        np.full(88, 0.6),
        np.arange(88),
        np.zeros((88, 2)),
        face_terms(GAUGE).reshape(88, -1)[:, :face_terms_],
    )


def bundle(count: int = 3, noise_px: float = 0.02, seed: int = 1) -> tuple[list[View], State]:
    """Views of the gauge in some poses, and the true state."""
    rng = np.random.default_rng(seed)
    poses = random_poses(CAMERA, count, rng, tilt_deg=25, shift_mm=2)
    views = [seen(pose.parameters, rng, noise_px) for pose in poses]
    return views, State(np.stack([pose.pose for pose in poses]), CAMERA.lens_parameters, "brown", FREE)


def moved_by(state: State, place: int, step: float) -> State:
    change = np.zeros(state.shared + 6 * len(state.poses))
    change[place] = step
    return _moved(state, change)


STEPS = np.array([1e-2, 1e-2, 1e-2, 1e-4, *[1e-4] * 3, *[1e-5, 1e-5, 1e-5, 1e-4, 1e-4, 1e-3] * 2])
