"""Centre, heading and turning circle for the overlay of a tracked recording with a camera."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from calibration.camera import Camera
from evaluator.pose import poses_from_marks
from evaluator.report.overlay import Drawing
from evaluator.turning import measure_turning
from evaluator.workflow import Tracked

AXES, MARGIN = 0.08, 0.14  # length of the plate's axes, distance from the lower left corner, in heights of the image


def turn_drawing(tracked: Tracked) -> Drawing | None:
    """Centre, heading and turning circle in the frames; None without a camera or with fewer than two marks."""
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
        return camera.image_from_plate(np.stack([x, y, np.full_like(x, height_mm)], axis=-1))

    circle, caption = np.empty((0, 2)), ""
    if np.isfinite([turning.radius_mm, turning.center_x_mm, turning.center_y_mm]).all():
        angle, radius = np.linspace(0.0, 2.0 * np.pi, 361), abs(turning.radius_mm)
        circle = in_frame(turning.center_x_mm + radius * np.cos(angle), turning.center_y_mm + radius * np.sin(angle))
        caption = f"R = {radius:.2f} mm"
    ahead_mm, left_mm = geometry.marks().axes_mm
    cos, sin = np.cos(poses.heading_rad), np.sin(poses.heading_rad)
    return Drawing(
        center_px=in_frame(poses.x_mm, poses.y_mm),
        nose_px=in_frame(poses.x_mm + ahead_mm * cos, poses.y_mm + ahead_mm * sin),
        left_px=in_frame(poses.x_mm - left_mm * sin, poses.y_mm + left_mm * cos),
        circle_px=circle,
        axes_px=plate_axes(camera, height_mm),
        caption=caption,
    )


def plate_axes(camera: Camera, height_mm: float) -> np.ndarray:
    """A point in the lower left of the image, and the tips of the plate's x and y from there, (3, 2) px."""
    rows = camera.size_px[1]
    corner = np.array([MARGIN * rows, (1 - MARGIN) * rows])
    x, y = camera.plate_from_image(corner, height_mm)
    step = 1.0  # mm: small relative to the field of view
    near = camera.image_from_plate(np.array([[x + step, y, height_mm], [x, y + step, height_mm]])) - corner
    tips = corner + AXES * rows * near / np.hypot(*near.T)[:, None]
    seen = np.vstack([corner, tips])
    return seen if np.isfinite(seen).all() else np.empty((0, 2))
