"""Information gained from each image of a set, and the most useful next image of the gauge.

Every image adds its information about the lens, with the pose of its gauge eliminated (Schur complement). An image can
therefore be removed from a solved calibration, or a hypothetical one added, without solving again; the criterion is the
uncertainty of positions at the height of the marks. Camera frame: x right, y down, z away from the camera.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.assignment.gauge_in_image import fewest_dots
from calibration.camera import PARAMETERS, POSE, Camera, image_points
from calibration.estimation.bundle_adjustment import (
    POSE_COUNT,
    State,
    View,
    add_prior,
    places_of_view,
    view_rows,
)
from calibration.estimation.calibrate import Calibration
from calibration.estimation.flatness import coefficient_sigma, face_terms
from calibration.estimation.initial_values import rough_prior
from calibration.estimation.robust import huber_weights
from calibration.lens import undistort

Array = NDArray[np.float64]
MAP = (32, 24)  # columns and rows of the grid on which the uncertainty is evaluated: as fine as it varies
TILT_DEG = 30.0  # the middle of the 20 to 40 degrees that separate focal length and distance best
WORTH = 0.9  # ratio of the uncertainties after and before an image, above which the image is not recommended
NOTHING = 0.001  # relative gain below which an image adds nothing; even a redundant image adds 0.006
COLUMNS, ROWS = ("left", "middle", "right"), ("upper", "middle", "lower")
TOWARD = {  # which side of the gauge comes nearer to the camera: direction in the image
    "left edge": (-1, 0), "right edge": (1, 0), "upper edge": (0, -1), "lower edge": (0, 1),
    "upper left corner": (-1, -1), "upper right corner": (1, -1),
    "lower left corner": (-1, 1), "lower right corner": (1, 1),
}  # fmt: skip


@dataclass(frozen=True)
class NextImage:
    """The image of the gauge that reduces the uncertainty of positions most.

    place: part of the view for the middle of the gauge. lifted: the side of the gauge that is tilted toward the camera
    by TILT_DEG, empty if the gauge faces the camera. pose: (6,) of the gauge there, rotation vector and translation,
    mm, to the camera frame. outline_px: (4, 2) corners of the array in this image. before_mm, after_mm: RMS uncertainty
    of positions at the height of the marks (1 sigma) without it and with it.
    """

    place: str
    lifted: str
    pose: tuple[float, ...]
    outline_px: tuple[tuple[float, float], ...]
    before_mm: float
    after_mm: float

    @property
    def sentence(self) -> str:
        """How to hold the gauge, and the resulting uncertainty."""
        how = f"tilted by {TILT_DEG:.0f} degrees, its {self.lifted} nearer to the camera" if self.lifted else "untilted"
        return (
            f"gauge in the {self.place} of the view, {how}; positions at the height of the marks would be known to "
            f"{1000 * self.after_mm:.2g} µm instead of {1000 * self.before_mm:.2g} µm (1 sigma, exact pitch)"
        )


def place_sigmas_mm(camera: Camera, height_mm: float, grid: tuple[int, int] = MAP) -> Array:
    """Uncertainty (rows, columns), mm, of positions at a height relative to the middle of the image; NaN out of view.

    1 sigma of a coordinate, from the calibration alone. A common shift of all positions changes no length and is
    excluded. grid: columns, rows.
    """
    relative = _relative_sensitivity(camera, height_mm, grid)
    covariance = relative @ camera.covariance @ np.swapaxes(relative, -1, -2)
    sigma = np.sqrt(np.clip(np.trace(covariance, axis1=1, axis2=2) / 2, 0.0, None))
    return np.asarray(sigma.reshape(grid[1], grid[0]))


def _relative_sensitivity(camera: Camera, height_mm: float, grid: tuple[int, int]) -> Array:
    """Derivative (places, 2, 16) of positions relative to the middle of the image by the camera's parameters."""
    columns, rows = grid
    width, tall = camera.size_px
    x, y = (np.arange(columns) + 0.5) * width / columns, (np.arange(rows) + 0.5) * tall / rows
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    middle = camera.plate_sensitivity(np.array([[width / 2, tall / 2]]), height_mm)
    return camera.plate_sensitivity(points, height_mm) - middle


@dataclass(frozen=True)
class Advice:
    """Gain of each image of a calibration (see `gains`), and the most useful next image; None if none helps."""

    gains: tuple[float, ...]
    next: NextImage | None

    @property
    def sentence(self) -> str:
        """The next image to take; empty if it would not be worthwhile."""
        best = self.next
        return "" if best is None or best.after_mm > WORTH * best.before_mm else best.sentence

    def adds_nothing(self, k: int) -> bool:
        """Whether the uncertainty of positions would be the same without image k, within NOTHING."""
        return bool(self.gains[k] - 1 < NOTHING)


def advise(found: Calibration, height_mm: float) -> Advice:
    """Gain of each image of a calibration, and the best next image, for marks at a height above the plate."""
    return Advice(gains(found, height_mm), next_image(found, height_mm))


def image_notes(advice: Advice, names: Sequence[str]) -> tuple[str, ...]:
    """A sentence on the images that add nothing, if there are any."""
    idle = [name for k, name in enumerate(names) if advice.adds_nothing(k)]
    if not idle:
        return ()
    return (
        (
            f"{' or '.join(idle)} {'add' if len(idle) > 1 else 'adds'} nothing: the uncertainty is the same without "
            f"{'each' if len(idle) > 1 else 'it'}"
        ),
    )


class Information:
    """Information of a calibration on the lens and the plate's pose, by image."""

    def __init__(self, found: Calibration, height_mm: float) -> None:
        """Compute the information of each image. height_mm: of the marks above the plate."""
        self._found = found
        fit = found.fit
        self._parts = []
        for k, (view, white) in enumerate(zip(found.views, fit.whitened, strict=True)):
            rows = view_rows(view, fit.state, k)[2]
            weight = huber_weights(white, fit.scale)
            flat = rows.reshape(-1, rows.shape[-1])
            self._parts.append((rows * weight[:, None, None]).reshape(flat.shape).T @ flat)
        prior = replace(
            rough_prior(found.camera.size_px), distance_mm=found.distance_mm, face_mm=coefficient_sigma(found.gauge)
        )
        # The images hardly determine some directions of the parameters. There the prior must have exactly the weight
        # that it had in the fit, or the uncertainty would be dominated by rounding.
        self._prior = np.zeros_like(fit.normal)
        add_prior(self._prior, np.zeros(len(fit.normal)), fit.state, prior)
        self._prior *= fit.scale**2
        relative = _relative_sensitivity(found.camera, height_mm, MAP)
        relative = relative[np.isfinite(relative).all(axis=(1, 2))]
        joint = [*(POSE_COUNT + fit.state.free_index), *range(*POSE.indices(len(PARAMETERS)))]
        by_joint = np.zeros((len(relative), 2, fit.state.shared + POSE_COUNT))
        by_joint[:, :, [*range(len(fit.state.free)), *range(fit.state.shared, by_joint.shape[2])]] = relative[
            :, :, joint
        ]
        self._square = np.einsum("nij,nik->jk", by_joint, by_joint) / (2 * max(len(relative), 1))
        self._plate = self._of_images(range(len(found.views)))

    def place_sigma_mm(self, more: Array | None = None, *, without: int | None = None) -> float:
        """RMS uncertainty of positions, mm, 1 sigma, with more information (shared, shared) or without one image."""
        fit, normal = self._found.fit, self._plate
        if without is not None:
            normal = self._of_images([k for k in range(len(self._parts)) if k != without])
        if more is not None:
            normal = normal.copy()
            normal[: len(more), : len(more)] += more
        root = 1 / np.sqrt(np.diag(normal))  # scales mm, rad and px, which differ by ten orders of magnitude
        covariance = np.linalg.inv(normal * root[:, None] * root) * max(fit.variance, 1.0)
        return float(np.sqrt(max(np.sum(self._square * root[:, None] * root * covariance), 0.0)))

    def _of_images(self, images: Sequence[int]) -> Array:
        """Normal matrix of the shared parameters and the plate's pose from some images, other poses eliminated."""
        state = self._found.fit.state
        whole = self._prior.copy()
        for k in images:
            place = places_of_view(state, k)
            whole[np.ix_(place, place)] += self._parts[k]
        kept = np.concatenate([np.arange(state.shared), *(places_of_view(state, k)[state.shared :] for k in images)])
        normal, count = whole[np.ix_(kept, kept)], state.shared + POSE_COUNT
        rest = normal[count:, count:]
        cross = normal[:count, count:]
        return np.asarray(normal[:count, :count] - cross @ np.linalg.solve(rest, cross.T)) if len(rest) else normal

    def of_image(self, view: View, pose: Array) -> Array:
        """Information (shared, shared) of an image of the gauge in an unknown pose near `pose` (6,)."""
        state = replace(self._found.fit.state, poses=pose[None])
        rows = view_rows(view, state, 0)[2]
        flat = rows.reshape(-1, rows.shape[-1])
        normal, shared = flat.T @ flat, state.shared
        cross = normal[:shared, shared:]
        return np.asarray(normal[:shared, :shared] - cross @ np.linalg.solve(normal[shared:, shared:], cross.T))


def gains(found: Calibration, height_mm: float) -> tuple[float, ...]:
    """Factor on the uncertainty of positions without each image; NaN for the image of the plate, which is needed."""
    known = Information(found, height_mm)
    whole = known.place_sigma_mm()
    rest = [known.place_sigma_mm(without=k) / whole for k in range(1, len(found.views))]
    return (float("nan"), *rest)


def next_image(found: Calibration, height_mm: float) -> NextImage | None:
    """The best of 81 further images of the gauge; None if none of them shows enough of it.

    The middle of the gauge is in one of nine parts of the view, as far from the camera as the plate (in focus), and the
    gauge is untilted or has one of eight sides tilted toward the camera.
    """
    known = Information(found, height_mm)
    # with what the images leave open of the lens model, which is chosen anew with the next one
    before = float(np.sqrt(np.nanmean(place_sigmas_mm(found.camera.with_exact_pitch(), height_mm) ** 2)))
    whole = _whole_gauge(found)
    best: NextImage | None = None
    for row, line in enumerate(ROWS):
        for column, side in enumerate(COLUMNS):
            target = np.array(found.camera.size_px) * [(1 + 2 * column) / 6, (1 + 2 * row) / 6]
            for lifted, direction in {"": (0, 0), **TOWARD}.items():
                pose = _pose(found, whole, target, direction)
                seen, outline = _in_view(whole, pose, found)
                if len(seen) < fewest_dots(found.gauge):
                    continue
                after = known.place_sigma_mm(known.of_image(seen, pose))
                if best is None or after < best.after_mm:
                    place = "middle" if (line, side) == ("middle", "middle") else f"{line} {side}"
                    best = NextImage(place, lifted, tuple(pose.tolist()), outline, before, after)
    return best


def _whole_gauge(found: Calibration) -> View:
    """All dots of the gauge, with the median image uncertainty of the dots found."""
    gauge = found.gauge
    there = gauge.present()
    points = gauge.positions_mm()[there]
    count = len(points)
    inverse = np.concatenate([view.whitening for view in found.views])
    typical = float(np.median(np.sqrt(np.abs(np.linalg.det(inverse)))))
    return View(
        centers_px=np.zeros((count, 2)),
        whitening=np.tile(typical * np.eye(2), (count, 1, 1)),
        points_mm=np.column_stack([points, np.zeros(count)]),
        radius_mm=gauge.diameters_mm()[there] / 2,
        site=np.flatnonzero(there.ravel()),
        offset_px=np.zeros((count, 2)),
        terms=face_terms(gauge)[there],
    )


def _pose(found: Calibration, whole: View, target_px: Array, direction: tuple[int, int]) -> Array:
    """Pose (6,) of the gauge with its middle at an image point and one side (direction in the image) tilted up."""
    camera = found.camera
    plate: Array = np.asarray(cv2.Rodrigues(np.ascontiguousarray(found.fit.state.poses[0][:3]))[0], dtype=float)
    middle = (whole.points_mm.max(axis=0) + whole.points_mm.min(axis=0)) / 2
    depth = float((plate @ middle + found.fit.state.poses[0][3:])[2])
    facing = _turned(plate[:, 2], np.array([0.0, 0.0, -1.0])) @ plate
    if direction != (0, 0):
        toward = np.array(direction) / np.hypot(*direction)
        axis = np.array([-toward[1], toward[0], 0.0])  # a rotation about it moves that side toward the camera
        facing = cv2.Rodrigues(np.radians(TILT_DEG) * axis)[0] @ facing
    ray = undistort(((target_px - camera.principal_px) / camera.focal_xy_px)[None], camera.distortion, camera.lens)[0]
    shift = depth * np.array([*ray, 1.0]) - facing @ middle
    return np.concatenate([cv2.Rodrigues(facing)[0][:, 0], shift])


def _turned(start: Array, end: Array) -> Array:
    """The smallest rotation (3, 3) that maps one unit vector to another."""
    axis = np.cross(start, end)
    sine, cosine = float(np.linalg.norm(axis)), float(start @ end)
    if sine < 1e-12:
        return np.eye(3) if cosine > 0 else np.diag([1.0, -1.0, -1.0])
    return np.asarray(cv2.Rodrigues(axis / sine * np.arctan2(sine, cosine))[0])


def _in_view(whole: View, pose: Array, found: Calibration) -> tuple[View, tuple[tuple[float, float], ...]]:
    """The dots that are inside the image in a pose, and the outline of the whole array there."""
    state: State = found.fit.state
    parameters = np.concatenate([pose, state.lens])
    seen = image_points(whole.points_mm, parameters, state.model)
    inside = np.all((seen > 0) & (seen < np.array(found.camera.size_px) - 1), axis=1)
    low, high = whole.points_mm.min(axis=0), whole.points_mm.max(axis=0)
    corners = np.array([[low[0], low[1], 0], [high[0], low[1], 0], [high[0], high[1], 0], [low[0], high[1], 0]])
    outline = image_points(corners, parameters, state.model)
    return whole.take(inside), tuple((round(float(x), 1), round(float(y), 1)) for x, y in outline)
