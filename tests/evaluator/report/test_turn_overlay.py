"""What the overlay draws lies where camera and pose say it does."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.camera import camera_above
from evaluator.report.turn_overlay import plate_axes


@pytest.mark.parametrize("turn_deg", [0.0, 90.0, 205.0])
def test_axes_of_the_plate_point_where_the_plate_does(turn_deg: float) -> None:
    camera = camera_above(size_px=(640, 480), focal_px=2000, distance_mm=150, tilt_deg=20, turn_deg=turn_deg)
    corner, x_tip, y_tip = plate_axes(camera, 6.5)
    x, y = camera.plate_from_image(np.array([x_tip, y_tip]), 6.5) - camera.plate_from_image(corner, 6.5)
    assert x[0] > 1
    assert y[1] > 1
    assert abs(x[1]) < 1e-3 * x[0]
    assert abs(y[0]) < 1e-3 * y[1]
    assert ((corner >= 0) & (corner < [640, 480])).all()
