"""Figures of the calibration page show what there is, and no rounding errors."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.camera import camera_above
from evaluator.report.figures.calibration import distortion_map, plate_axes_px


def test_lens_without_distortion_is_said_to_have_none() -> None:
    figure = distortion_map(camera_above(size_px=(400, 300), focal_px=1200, distance_mm=120))
    assert "no distortion" in figure.caption
    assert (figure.data[["shift_x_px", "shift_y_px"]] == 0).all(axis=None)


def test_distortion_is_drawn_so_much_longer_that_it_is_seen() -> None:
    figure = distortion_map(camera_above(size_px=(400, 300), focal_px=1200, distance_mm=120, k1=-0.01))
    assert "drawn 200 times too long" in figure.caption


@pytest.mark.parametrize("turn_deg", [0.0, 35.0, 180.0])
def test_axes_drawn_point_where_a_step_along_x_and_y_leads(turn_deg: float) -> None:
    camera = camera_above(size_px=(400, 300), focal_px=1200, distance_mm=120, turn_deg=turn_deg, center_mm=(1.0, 2.0))
    (x_from, x_to), (y_from, y_to) = plate_axes_px(camera)
    placed = camera.plate_from_image(np.array([x_from, x_to, y_to]), 0.0)
    assert np.allclose(placed[0], 0.0, atol=1e-6)
    assert placed[1][0] > 1
    assert placed[2][1] > 1
    assert np.allclose([placed[1][1], placed[2][0]], 0.0, atol=1e-6)
    assert np.allclose(x_from, y_from)
    size = np.array(camera.size_px)
    assert ((x_to > 0) & (x_to < size) & (y_to > 0) & (y_to < size)).all()


def test_axes_start_in_the_middle_where_the_origin_is_out_of_view() -> None:
    camera = camera_above(size_px=(400, 300), focal_px=1200, distance_mm=120, center_mm=(100.0, 0.0))
    assert np.allclose(plate_axes_px(camera)[0, 0], (200, 150))
