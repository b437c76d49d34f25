"""A grid of few large dots across which a shadow lies, as on a sheet photographed out of doors."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from calibration.assignment.array_in_image import find_array

SAMPLES = 4  # of a pixel's side


def shadowed_grid(seed: int) -> np.ndarray:
    """10 x 8 dots seen at a slant, wider at the lower left than at the right; a soft shadow over the lower third."""
    rng = np.random.default_rng(seed)
    corners = np.array([[0, 0], [9, 0], [9, 7], [0, 7]], np.float32)
    seen = np.array([[40, 70], [400, 120], [460, 360], [50, 440]], np.float32)
    to_image = cv2.getPerspectiveTransform(corners, seen)
    sheet = np.full((480 * SAMPLES, 640 * SAMPLES), 215.0, np.float32)
    turn = np.linspace(0, 2 * np.pi, 120)
    for x in range(10):
        for y in range(8):
            rim = np.stack([x + 0.3 * np.cos(turn), y + 0.3 * np.sin(turn)], axis=-1)
            points = cv2.perspectiveTransform(rim[None], to_image)[0]
            fixed = np.round(((points + 0.5) * SAMPLES - 0.5) * 16).astype(np.int32)
            cv2.fillPoly(sheet, [fixed], 25, cv2.LINE_AA, 4)
    image = cv2.resize(sheet, (640, 480), interpolation=cv2.INTER_AREA)
    column, row = np.meshgrid(np.arange(640), np.arange(480))
    edge = 330 + 60 * np.sin(column / 70) + rng.uniform(-20, 20)
    image = cv2.GaussianBlur(image * (1 - 0.55 / (1 + np.exp(-(row - edge) / 6.0))), (0, 0), 0.8)
    return np.asarray(np.clip(image + rng.normal(0, 2, image.shape), 0, 255), np.uint8)


@pytest.mark.parametrize("seed", [0, 2])
def test_a_shadow_across_a_grid_hides_none_of_its_dots(seed: int) -> None:
    dots, lattice = find_array(shadowed_grid(seed))
    assert len(lattice) == 80
    assert len(dots) <= 81
