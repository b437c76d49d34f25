"""Camera model: points of the plate (at a height) to image points and back, with sensitivity to its parameters.

Frames: see frames.py. Camera frame: x right, y down, z along the optical axis (away from the camera), so the plate's
z axis points roughly against the camera's. Lens: see lens.py.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibration.lens import LensModel, distort, distorted_points, solve_2x2, undistort

Array = NDArray[np.float64]

# Order of the parameter vector: pose first, then lens. One place, so that indices never appear elsewhere.
PARAMETERS = (
    "rotation_x", "rotation_y", "rotation_z", "translation_x_mm", "translation_y_mm", "translation_z_mm",
    "focal_px", "aspect", "principal_x_px", "principal_y_px", "k1", "k2", "p1", "p2", "k3", "k4",
)  # fmt: skip
__all__ = ["PARAMETERS", "Camera", "LensModel", "camera_above", "camera_height", "project"]
CHORD = 0.15  # of the image's shorter side: half the length of the chords by which lengths are compared
POSE, PINHOLE, DISTORTION = slice(0, 6), slice(6, 10), slice(10, 16)


@dataclass(frozen=True, repr=False)
class Camera:
    """A fixed camera over the plate.

    size_px: (width, height) of its images. parameters: (16,) in the order of PARAMETERS; the rotation vector and
    translation take plate coordinates to camera coordinates. covariance: (16, 16) of the parameters, zero rows for
    those that are fixed, including the error of the gauge's pitch. lens: "brown" (k1, k2, p1, p2, k3) or "fisheye" (k1
    to k4). doubt: why its millimetres are not trustworthy, else empty. pitch_error: (16,) change of the parameters by
    one standard deviation of the gauge's pitch; its contribution to the covariance is the outer product.
    """

    size_px: tuple[int, int]
    parameters: Array
    lens: LensModel = "brown"
    covariance: Array = field(default_factory=lambda: np.zeros((len(PARAMETERS), len(PARAMETERS))))
    doubt: str = ""
    pitch_error: Array = field(default_factory=lambda: np.zeros(len(PARAMETERS)))

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for name in ("parameters", "covariance", "pitch_error"):
            array = np.array(getattr(self, name), dtype=float)
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def __repr__(self) -> str:
        """One line: image size, lens, focal length and height above the plate."""
        width, height = self.size_px
        return (
            f"Camera({width} × {height} px, {self.lens} lens, focal length {self.value('focal_px'):.1f} px, "
            f"{camera_height(self.pose)[0]:.1f} mm above the plate)"
        )

    def _repr_html_(self) -> str:
        """Every parameter with its standard uncertainty as a table, for notebooks; fixed parameters are omitted."""
        rows = (
            f"<tr><th>{name}</th><td>{self.value(name):.6g}</td><td>{self.sigma(name):.2g}</td></tr>"
            for name in PARAMETERS
            if self.sigma(name) > 0
        )
        head = "<tr><th>parameter</th><th>value</th><th>sigma</th></tr>"
        return f"<p>{self!r}</p><table>{head}{''.join(rows)}</table>"

    def value(self, name: str) -> float:
        """One parameter by its name."""
        return float(self.parameters[PARAMETERS.index(name)])

    def sigma(self, name: str) -> float:
        """Standard uncertainty of one parameter; 0 where it is fixed."""
        index = PARAMETERS.index(name)
        return float(np.sqrt(self.covariance[index, index]))

    @property
    def pose(self) -> Array:
        """Rotation vector and translation (6,), from the plate to the camera; mm."""
        return self.parameters[POSE]

    @property
    def lens_parameters(self) -> Array:
        """All but the pose (10,): pinhole, then distortion."""
        return self.parameters[POSE.stop :]

    @property
    def focal_xy_px(self) -> Array:
        """Focal length (2,) in pixel widths and pixel heights."""
        return self.value("focal_px") * np.array([1.0, self.value("aspect")])

    @property
    def principal_px(self) -> Array:
        """Principal point (2,), px."""
        return self.parameters[PINHOLE][2:]

    @property
    def distortion(self) -> Array:
        """Coefficients (6,) in the order of lens.py."""
        return self.parameters[DISTORTION]

    def scale_sigma(self, height_mm: float, middle_px: ArrayLike | None = None) -> float:
        """Relative standard uncertainty of lengths about an image point on the plane height_mm above the plate.

        It includes the whole covariance, and hence the tolerance of the gauge's pitch. middle_px: (2,), default the
        middle of the image. NaN if the plane is not visible there.
        """
        width, height = self.size_px
        middle = np.array([(width - 1) / 2, (height - 1) / 2]) if middle_px is None else np.asarray(middle_px)
        ends = middle + CHORD * min(width, height) * np.array([[-1, 0], [1, 0], [0, -1], [0, 1]])
        placed, sensitivity = self.plate_from_image(ends, height_mm), self.plate_sensitivity(ends, height_mm)
        total, slope = 0.0, np.zeros(len(PARAMETERS))
        for a, b in ((0, 1), (2, 3)):
            chord = placed[b] - placed[a]
            length = float(np.hypot(*chord))
            total += length
            slope += chord / length @ (sensitivity[b] - sensitivity[a])
        return float(np.sqrt(max(float(slope @ self.covariance @ slope), 0.0)) / total)

    def with_exact_pitch(self) -> Camera:
        """Return the camera for comparisons by the same gauge, in which an error of its pitch cancels."""
        exact = self.covariance - np.outer(self.pitch_error, self.pitch_error)
        return replace(self, covariance=exact, pitch_error=np.zeros(len(PARAMETERS)))

    def image_from_plate(self, points_mm: ArrayLike) -> Array:
        """Project points (..., 3) of the plate frame, mm; returns (..., 2) px, NaN behind the camera."""
        points = np.asarray(points_mm, dtype=float)
        return image_points(points.reshape(-1, 3), self.parameters, self.lens).reshape(*points.shape[:-1], 2)

    def plate_from_image(self, points_px: ArrayLike, height_mm: float) -> Array:
        """Map image points (..., 2) px to the plane height_mm above the plate; returns (..., 2) mm.

        NaN where the line of sight misses the plane or the lens model has no inverse.
        """
        points = np.asarray(points_px, dtype=float)
        flat = points.reshape(-1, 2)
        focal, aspect, *principal = self.parameters[PINHOLE]
        distorted = (flat - principal) / (focal, focal * aspect)
        normalised = undistort(distorted, self.parameters[DISTORTION], self.lens)
        rotation = cv2.Rodrigues(self.parameters[:3])[0]
        origin = -rotation.T @ self.parameters[3:6]
        rays = np.column_stack([normalised, np.ones(len(normalised))]) @ rotation
        with np.errstate(invalid="ignore", divide="ignore"):
            distance = (height_mm - origin[2]) / rays[:, 2]
            distance[~(distance > 0)] = np.nan
            placed = origin[:2] + distance[:, None] * rays[:, :2]
        return np.asarray(placed.reshape(*points.shape[:-1], 2))

    def plate_jacobian(self, points_px: ArrayLike, height_mm: float) -> Array:
        """Derivative of `plate_from_image` by the image point: (..., 2, 2), mm per px."""
        points = np.asarray(points_px, dtype=float)
        by_point, _ = self._at(points.reshape(-1, 2), height_mm)
        identity = np.broadcast_to(np.eye(2), by_point.shape)
        return solve_2x2(by_point, identity).reshape(*points.shape[:-1], 2, 2)

    def plate_sensitivity(self, points_px: ArrayLike, height_mm: float) -> Array:
        """Derivative of `plate_from_image` by the parameters: (..., 2, 16).

        With `covariance` it gives the systematic covariance between any points, J C Jᵀ: errors that do not average out
        over frames. By the implicit function theorem, at a fixed image point dX/dθ = -(du/dX)⁻¹ du/dθ.
        """
        points = np.asarray(points_px, dtype=float)
        by_point, by_parameter = self._at(points.reshape(-1, 2), height_mm)
        return -solve_2x2(by_point, by_parameter).reshape(*points.shape[:-1], 2, len(PARAMETERS))

    def plate_covariance(self, points_px: ArrayLike, height_mm: float) -> Array:
        """Covariance (..., 2, 2) mm² of a mapped point due to the calibration alone."""
        sensitivity = self.plate_sensitivity(points_px, height_mm)
        return np.asarray(sensitivity @ self.covariance @ np.swapaxes(sensitivity, -1, -2))

    def _at(self, points_px: Array, height_mm: float) -> tuple[Array, Array]:
        """Derivatives of the projection by plate x, y (n, 2, 2) and by the parameters (n, 2, 16) at image points."""
        placed = self.plate_from_image(points_px, height_mm)
        on_plane = np.column_stack([placed, np.full(len(placed), height_mm)])
        _, by_point, by_parameter = project(on_plane, self.parameters, self.lens)
        return by_point[:, :, :2], by_parameter


def project(points_mm: Array, parameters: Array, lens: LensModel) -> tuple[Array, Array, Array]:
    """Project (n, 3) plate points: image points (n, 2), derivatives by the point (n, 2, 3) and parameters (n, 2, 16).

    NaN behind the camera.
    """
    rotation, by_vector = cv2.Rodrigues(np.ascontiguousarray(parameters[:3]))
    normalised, depth = _in_camera(points_mm, rotation, parameters)
    distorted, by_normalised, by_coefficient = distort(normalised, parameters[DISTORTION], lens)
    focal, aspect, *principal = parameters[PINHOLE]
    scale = np.array([focal, focal * aspect])
    by_camera = np.zeros((len(points_mm), 2, 3))
    by_camera[:, 0, 0] = by_camera[:, 1, 1] = 1 / depth
    by_camera[:, :, 2] = -normalised / depth[:, None]
    by_camera = (scale[:, None] * by_normalised) @ by_camera
    by_parameter = np.zeros((len(points_mm), 2, len(PARAMETERS)))
    turned = np.einsum("nk,ijk->nji", points_mm, by_vector.reshape(3, 3, 3))  # dX/d(rotation vector)
    by_parameter[:, :, :3] = by_camera @ turned
    by_parameter[:, :, 3:6] = by_camera
    by_parameter[:, 0, 6] = distorted[:, 0]
    by_parameter[:, 1, 6] = aspect * distorted[:, 1]
    by_parameter[:, 1, 7] = focal * distorted[:, 1]
    by_parameter[:, 0, 8] = by_parameter[:, 1, 9] = 1.0
    by_parameter[:, :, DISTORTION] = scale[:, None] * by_coefficient
    return distorted * scale + principal, by_camera @ rotation, by_parameter


def image_points(points_mm: Array, parameters: Array, lens: LensModel) -> Array:
    """The image points (n, 2) of `project` alone, in a fraction of its time."""
    rotation = cv2.Rodrigues(np.ascontiguousarray(parameters[:3]))[0]
    normalised, _ = _in_camera(points_mm, rotation, parameters)
    focal, aspect, *principal = parameters[PINHOLE]
    return np.asarray(
        distorted_points(normalised, parameters[DISTORTION], lens) * np.array([focal, focal * aspect]) + principal
    )


def _in_camera(points_mm: Array, rotation: NDArray[Any], parameters: Array) -> tuple[Array, Array]:
    """Normalised coordinates (n, 2) and depth (n,), mm, in the camera's frame; NaN behind it."""
    in_camera = points_mm @ rotation.T + parameters[3:6]
    depth = np.where(in_camera[:, 2] > 0, in_camera[:, 2], np.nan)
    return in_camera[:, :2] / depth[:, None], depth


def camera_height(pose: Array) -> tuple[float, Array]:
    """Height of the lens above the plane z = 0, mm, for a pose, and its derivative by the pose (6,)."""

    def height(p: Array) -> float:
        return float(-(cv2.Rodrigues(np.ascontiguousarray(p[:3]))[0].T @ p[3:6])[2])

    step = 1e-6
    slope = [(height(pose + d) - height(pose - d)) / (2 * step) for d in step * np.eye(6)]
    return height(pose), np.array(slope)


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
    turn_deg: rotation about the optical axis. With all angles zero, image right is plate +x and image down is -y.
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
