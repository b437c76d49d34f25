"""Camera model: points of the plate (at a height) to picture points and back, with sensitivity to its parameters.

Frames: see frames.py. Camera frame: x right, y down, z along the optical axis (away from the camera), so the plate's
z axis points roughly against the camera's. Lens: pinhole with radial distortion, r_d = r·(1 + k1 r² + k2 r⁴ + k3 r⁶)
plus decentring (Brown 1971), or the equidistant series θ_d = θ·(1 + k1 θ² + …) (Kannala and Brandt 2006).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
LensModel = Literal["brown", "fisheye"]

# Order of the parameter vector: pose first, then lens. One place, so that indices never appear elsewhere.
PARAMETERS = (
    "rotation_x", "rotation_y", "rotation_z", "translation_x_mm", "translation_y_mm", "translation_z_mm",
    "focal_px", "aspect", "principal_x_px", "principal_y_px", "k1", "k2", "p1", "p2", "k3", "k4",
)  # fmt: skip


@dataclass(frozen=True)
class Camera:
    """A fixed camera over the plate.

    size_px: (width, height) of its pictures. parameters: (16,) in the order of PARAMETERS; the rotation vector and
    translation take plate coordinates to camera coordinates. covariance: (16, 16) of the parameters, zero rows for
    those that are fixed. lens: "brown" (k1, k2, p1, p2, k3) or "fisheye" (k1 to k4).
    """

    size_px: tuple[int, int]
    parameters: Array
    lens: LensModel = "brown"
    covariance: Array = field(default_factory=lambda: np.zeros((len(PARAMETERS), len(PARAMETERS))))

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for name in ("parameters", "covariance"):
            array = np.array(getattr(self, name), dtype=float)
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def value(self, name: str) -> float:
        """One parameter by its name."""
        return float(self.parameters[PARAMETERS.index(name)])

    def picture_from_plate(self, points_mm: ArrayLike) -> Array:
        """Project points (..., 3) of the plate frame, mm; returns (..., 2) px, NaN behind the camera."""
        points = np.asarray(points_mm, dtype=float)
        shape = points.shape[:-1]
        rotation = cv2.Rodrigues(self.parameters[:3])[0]
        in_camera = points.reshape(-1, 3) @ rotation.T + self.parameters[3:6]
        with np.errstate(invalid="ignore", divide="ignore"):
            normalised = in_camera[:, :2] / in_camera[:, 2:]
        normalised[in_camera[:, 2] <= 0] = np.nan
        return self._picture_from_normalised(normalised).reshape(*shape, 2)

    def plate_from_picture(self, points_px: ArrayLike, height_mm: float) -> Array:
        """Place picture points (..., 2) px on the plane height_mm above the plate; returns (..., 2) mm."""
        points = np.asarray(points_px, dtype=float)
        shape = points.shape[:-1]
        normalised = self._normalised_from_picture(points.reshape(-1, 2))
        rotation = cv2.Rodrigues(self.parameters[:3])[0]
        origin = -rotation.T @ self.parameters[3:6]
        rays = np.column_stack([normalised, np.ones(len(normalised))]) @ rotation
        distance = (height_mm - origin[2]) / rays[:, 2]
        return np.asarray((origin[:2] + distance[:, None] * rays[:, :2]).reshape(*shape, 2))

    def plate_jacobian(self, points_px: ArrayLike, height_mm: float) -> Array:
        """Derivative of `plate_from_picture` by the picture point: (..., 2, 2), mm per px (central difference)."""
        points, step = np.asarray(points_px, dtype=float), 0.05
        columns = [
            (self.plate_from_picture(points + shift, height_mm) - self.plate_from_picture(points - shift, height_mm))
            / (2 * step)
            for shift in (np.array([step, 0.0]), np.array([0.0, step]))
        ]
        return np.stack(columns, axis=-1)

    def plate_sensitivity(self, points_px: ArrayLike, height_mm: float) -> Array:
        """Derivative of `plate_from_picture` by the parameters: (..., 2, 16).

        With `covariance` it gives the systematic covariance between any points, J C Jᵀ: errors that no more frames
        would average away.
        """
        points = np.asarray(points_px, dtype=float)
        scale = np.maximum(np.abs(self.parameters), 1.0) * 1e-6
        columns = []
        for index, step in enumerate(scale):
            shift = np.zeros(len(PARAMETERS))
            shift[index] = step
            ahead = replace(self, parameters=self.parameters + shift).plate_from_picture(points, height_mm)
            behind = replace(self, parameters=self.parameters - shift).plate_from_picture(points, height_mm)
            columns.append((ahead - behind) / (2 * step))
        return np.stack(columns, axis=-1)

    def _matrix(self) -> Array:
        focal, aspect, cx, cy = self.parameters[6:10]
        return np.array([[focal, 0.0, cx], [0.0, focal * aspect, cy], [0.0, 0.0, 1.0]])

    def _picture_from_normalised(self, normalised: Array) -> Array:
        rays = np.column_stack([normalised, np.ones(len(normalised))])[:, None, :]
        zero = np.zeros(3)
        if len(rays) == 0:
            return np.empty((0, 2))
        if self.lens == "fisheye":
            coefficients = self.parameters[[10, 11, 14, 15]]
            return np.asarray(cv2.fisheye.distortPoints(normalised[:, None, :], self._matrix(), coefficients)[:, 0])
        return np.asarray(cv2.projectPoints(rays, zero, zero, self._matrix(), self.parameters[10:15])[0][:, 0])

    def _normalised_from_picture(self, points_px: Array) -> Array:
        if len(points_px) == 0:
            return np.empty((0, 2))
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-13)
        points, matrix = points_px[:, None, :], self._matrix()
        if self.lens == "fisheye":
            coefficients = self.parameters[[10, 11, 14, 15]]
            return np.asarray(cv2.fisheye.undistortPoints(points, matrix, coefficients, criteria=criteria)[:, 0])
        return np.asarray(cv2.undistortPoints(points, matrix, self.parameters[10:15], criteria=criteria)[:, 0])


def camera_above(
    *,
    size_px: tuple[int, int],
    focal_px: float,
    distance_mm: float,
    tilt_deg: float = 0.0,
    tilt_azimuth_deg: float = 0.0,
    turn_deg: float = 0.0,
    center_mm: tuple[float, float] = (0.0, 0.0),
    k1: float = 0.0,
    k2: float = 0.0,
    lens: LensModel = "brown",
    principal_offset_px: tuple[float, float] = (0.0, 0.0),
) -> Camera:
    """Build the camera that looks down on the plate point center_mm from distance_mm.

    tilt_deg: angle of the optical axis to the plate's normal, leaning toward tilt_azimuth_deg of the plate frame;
    turn_deg: rotation about the optical axis. With all angles zero, picture right is plate +x and picture down is -y.
    """
    tilt, azimuth, turn = np.radians([tilt_deg, tilt_azimuth_deg, turn_deg])
    looking_down = np.diag([1.0, -1.0, -1.0])
    tilting = cv2.Rodrigues(np.array([-np.sin(azimuth), np.cos(azimuth), 0.0]) * tilt)[0]
    turning = cv2.Rodrigues(np.array([0.0, 0.0, turn]))[0]
    rotation = turning @ looking_down @ tilting
    translation = np.array([0.0, 0.0, distance_mm]) - rotation @ np.array([*center_mm, 0.0])
    parameters = np.zeros(len(PARAMETERS))
    parameters[:3] = cv2.Rodrigues(rotation)[0][:, 0]
    parameters[3:6] = translation
    parameters[6:8] = focal_px, 1.0
    parameters[8:10] = (size_px[0] - 1) / 2 + principal_offset_px[0], (size_px[1] - 1) / 2 + principal_offset_px[1]
    parameters[10:12] = k1, k2
    return Camera(size_px=size_px, parameters=parameters, lens=lens)
