"""What the overlay draws lies where camera and pose say it does."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from calibration.camera import camera_above
from evaluator.report import turn_overlay
from evaluator.report.turn_overlay import plate_axes
from evaluator.robot_geometry import RobotGeometry
from simulator.robot import load_robot


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


def test_poses_of_the_overlay_lie_where_the_camera_sees_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """A robot that turns about (10, 20) mm at 8 mm, to its left; what is drawn is at the height of its marks."""
    turning = SimpleNamespace(radius_mm=-8.0, center_x_mm=10.0, center_y_mm=20.0)
    monkeypatch.setattr(turn_overlay, "measure_turning", lambda _poses: turning)
    robot, camera = load_robot("barrel"), camera_above(size_px=(640, 480), focal_px=200, distance_mm=150)
    time = np.arange(20) / 60
    angle = 0.6 * time
    pose = [10 + 8 * np.sin(angle), 20 - 8 * np.cos(angle), angle]
    table: dict[str, Any] = {"frame": np.arange(20), "time_s": time}
    for name, x, y in (("green", -1.55, 1.83), ("yellow", -1.55, -1.83)):
        table[f"{name}_x_mm"] = pose[0] + np.cos(angle) * x - np.sin(angle) * y
        table[f"{name}_y_mm"] = pose[1] + np.sin(angle) * x + np.cos(angle) * y
        table |= {f"{name}_{axis}_sigma_mm": 1e-3 for axis in "xy"}
    tracked: Any = SimpleNamespace(camera=camera, geometry=RobotGeometry(robot.layout), marks=pd.DataFrame(table))
    drawing = turn_overlay.turn_drawing(tracked)
    assert drawing is not None

    def seen(x: Any, y: Any) -> np.ndarray:
        return camera.image_from_plate(np.stack([x, y, np.full_like(x, 6.5)], axis=-1))

    cos, sin = np.cos(angle), np.sin(angle)
    np.testing.assert_allclose(drawing.center_px, seen(*pose[:2]), atol=0.01)
    ahead, left = 1.1 * 3.66, 0.55 * 3.66  # the marks are 3.66 mm apart
    np.testing.assert_allclose(drawing.nose_px, seen(pose[0] + ahead * cos, pose[1] + ahead * sin), atol=0.01)
    np.testing.assert_allclose(drawing.left_px, seen(pose[0] - left * sin, pose[1] + left * cos), atol=0.01)
    middle, at = (
        camera.image_from_plate(np.array([10.0, 20.0, 6.5])),
        camera.image_from_plate(np.array([18.0, 20.0, 6.5])),
    )
    np.testing.assert_allclose(drawing.circle_px[0], at, atol=0.01)
    np.testing.assert_allclose(drawing.circle_px[:-1].mean(axis=0), middle, atol=0.01)
    assert drawing.caption == "R = 8.00 mm"
    tracked.camera = None
    assert turn_overlay.turn_drawing(tracked) is None
