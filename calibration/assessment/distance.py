"""The measured distance of the lens beside the one by the images, which is proportional to the pitch of the gauge."""

from __future__ import annotations

import numpy as np

from calibration.camera import camera_height
from calibration.estimation.calibrate import Calibration

APART = 3.0  # standard deviations
PITCH_STEP = "measure the pitch over many dots, and the distance to the middle of the lens again"


def against_distance(calibration: Calibration) -> list[str]:
    """That the measured distance of the lens contradicts the one by the images; empty if it does not, or without one.

    Lengths by the images are proportional to the pitch of the gauge, which no image can check, but this distance can.
    """
    if calibration.distance_mm is None:
        return []
    measured, sigma = calibration.distance_mm
    found = float(camera_height(calibration.camera.pose)[0])
    sigmas = abs(measured - found) / np.hypot(sigma, calibration.gauge.scale_sigma * found)
    if sigmas < APART:
        return []
    pitch = float(np.mean(calibration.stated.pitch_mm))
    as_if = f"as if the pitch were {pitch * measured / found:.4g} mm and not {pitch:g}"
    places = f"the lens is {measured:g} mm away as measured and {found:.4g} mm by the images"
    return [f"{places}, {sigmas:.1f} standard deviations apart, {as_if}"]
