"""Figures of the calibration page show what there is, and no rounding errors."""

from __future__ import annotations

from calibration.camera import camera_above
from evaluator.report.figures.calibration import distortion_map


def test_lens_without_distortion_is_said_to_have_none() -> None:
    figure = distortion_map(camera_above(size_px=(400, 300), focal_px=1200, distance_mm=120))
    assert "no distortion" in figure.caption
    assert (figure.data[["shift_x_px", "shift_y_px"]] == 0).all(axis=None)


def test_distortion_is_drawn_so_much_longer_that_it_is_seen() -> None:
    figure = distortion_map(camera_above(size_px=(400, 300), focal_px=1200, distance_mm=120, k1=-0.01))
    assert "200 times their length" in figure.caption
