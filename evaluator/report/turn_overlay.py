"""What is drawn over a tracked recording where a camera places it: centre, heading and turning circle."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from evaluator.pose import poses_from_marks
from evaluator.report.overlay import Drawing
from evaluator.turning import measure_turning
from evaluator.workflow import Tracked

NOSE_MM = 4.0  # just beyond the robot's front


def turn_drawing(tracked: Tracked) -> Drawing | None:
    """Centre, heading and turning circle in the frames; None where no camera places two marks."""
    camera, geometry, marks = tracked.camera, tracked.geometry, tracked.marks
    if camera is None or geometry is None:
        return None
    there = [name for name in geometry.marks().names if f"{name}_x_mm" in marks]
    if len(there) < 2:
        return None
    poses = poses_from_marks(marks, geometry.marks().only(there))
    turning = measure_turning(poses)
    height_mm = geometry.height_mm

    def in_frame(x_mm: ArrayLike, y_mm: ArrayLike) -> np.ndarray:
        x, y = np.broadcast_arrays(np.asarray(x_mm, float), np.asarray(y_mm, float))
        return camera.picture_from_plate(np.stack([x, y, np.full_like(x, height_mm)], axis=-1))

    circle, caption = np.empty((0, 2)), ""
    if np.isfinite([turning.radius_mm, turning.center_x_mm, turning.center_y_mm]).all():
        angle, radius = np.linspace(0.0, 2.0 * np.pi, 361), abs(turning.radius_mm)
        circle = in_frame(turning.center_x_mm + radius * np.cos(angle), turning.center_y_mm + radius * np.sin(angle))
        caption = f"R = {radius:.2f} mm"
    nose_x = poses.x_mm + NOSE_MM * np.cos(poses.heading_rad)
    nose_y = poses.y_mm + NOSE_MM * np.sin(poses.heading_rad)
    return Drawing(
        center_px=in_frame(poses.x_mm, poses.y_mm),
        nose_px=in_frame(nose_x, nose_y),
        circle_px=circle,
        caption=caption,
    )
