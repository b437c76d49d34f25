"""Dots of another size than the file's: the pitch may be as wrong."""

from __future__ import annotations

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from calibration.assessment.quality import _wrong_size
from calibration.assignment.gauge_in_image import BLOOM
from calibration.detection.dots import detect_dots


@pytest.mark.parametrize(
    ("ratio", "bloom", "told"),
    [
        (0.75, 0.0, True), (0.85, 0.0, False), (1.0, 0.0, False), (1.08, 0.0, False), (1.2, 0.0, True),
        (0.75, 0.1, False), (1.2, 0.1, False), (0.72, 0.1, True), (1.28, 0.1, True),  # out of focus
    ],
)  # fmt: skip
def test_a_wrong_pitch_or_diameter_is_told(ratio: float, bloom: float, told: bool) -> None:
    sightings = [SimpleNamespace(size_ratio=ratio * share, bloom=bloom) for share in (0.99, 1.0, 1.01)]
    seen = SimpleNamespace(sightings=sightings)
    sentences = _wrong_size(seen)  # type: ignore[arg-type]
    assert bool(sentences) == told
    assert all("pitch_mm or diameter_mm is wrong" in sentence for sentence in sentences)


def test_a_gamma_makes_a_dark_dot_out_of_focus_narrower_on_either_side() -> None:
    fine, radius, blur = 4, 9.0, 3.0
    light = np.full((60 * fine, 60 * fine), 0.8, np.float32)
    cv2.circle(light, (30 * fine, 30 * fine), round(radius * fine), 0.03, -1)
    small = cv2.resize(cv2.GaussianBlur(light, (0, 0), blur * fine), (60, 60), interpolation=cv2.INTER_AREA)
    dots = detect_dots(np.rint(255.0 * np.asarray(small, float) ** (1 / 2.2)).astype(np.uint8), "black", "white")
    assert len(dots) == 1
    assert radius - dots.diameter_px[0] / 2 == pytest.approx(BLOOM * blur, rel=0.1)
