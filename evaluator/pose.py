"""Pose of the robot from its two marks: centre and heading with covariance, on the plane of the marks.

Plate frame, mm; heading counter-clockwise from +x and unwrapped. The distance between the marks is rigid: it checks
each frame (a frame whose distance stands out is absent with that reason) and the scale of the whole recording.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from calibration.camera import Camera
from calibration.frames import plate_from_body
from evaluator.errors import InputError
from evaluator.marks import require_columns
from evaluator.pose_systematic import systematic_shifts

Array = NDArray[np.float64]

OK = "ok"
# A rigid distance that stands out by more than this many robust standard deviations is no Gaussian accident: one frame
# in 5e8 would. Correlation between frames does not change that share.
SPACING_LIMIT_SIGMA = 6.0
# Marks CSV carry six decimals of a millimetre: the rounding error of one coordinate, the least sigma a file can have.
ROUNDING_SIGMA_MM = 1e-6 / np.sqrt(12)
GAUSSIAN_SIGMA_PER_MAD = 1.4826
# Marks nearer than this, the rounding of four coordinates, are one place: no heading.
ONE_PLACE_MM = 10 * ROUNDING_SIGMA_MM
NEIGHBOURS = 31  # frames whose common heading tells that one of them, or up to fifteen, is turned about


@dataclass(frozen=True)
class MarkGeometry:
    """Where the two marks sit on the robot: body frame, mm; height_mm above the plate (needed with a camera only)."""

    green_mm: tuple[float, float]
    yellow_mm: tuple[float, float]
    height_mm: float | None = None

    def __post_init__(self) -> None:
        """Refuse marks that coincide: they carry no heading."""
        if not self.spacing_mm > ONE_PLACE_MM:
            raise InputError(
                f"marks: green and yellow are both at {self.green_mm}; two different places give a heading"
            )

    @property
    def spacing_mm(self) -> float:
        """Distance between the marks."""
        return float(np.hypot(self.green_mm[0] - self.yellow_mm[0], self.green_mm[1] - self.yellow_mm[1]))


@dataclass(frozen=True)
class Poses:
    """Poses of the robot's centre over time, plate frame; NaN where a frame has none, with the reason in `status`.

    time_s, x_mm, y_mm, heading_rad: (n,). covariance: (n, 3, 3) of (x, y, heading), what is random from frame to frame.
    systematic: (n, 3, k), shift of every pose by one standard deviation of each of k independent errors common to all
    frames: of the camera, and of the marks' centres where they come from pictures; None without a camera. spacing_mm:
    (n,) measured distance of the marks.
    """

    time_s: Array
    x_mm: Array
    y_mm: Array
    heading_rad: Array
    covariance: Array
    status: NDArray[np.str_]
    spacing_mm: Array = field(default_factory=lambda: np.empty(0))
    geometry: MarkGeometry | None = None
    systematic: Array | None = None

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for name in ("time_s", "x_mm", "y_mm", "heading_rad", "covariance", "spacing_mm", "systematic"):
            value = getattr(self, name)
            if value is not None:
                array = np.array(value, dtype=float)
                array.setflags(write=False)
                object.__setattr__(self, name, array)

    @property
    def measured(self) -> NDArray[np.bool_]:
        """Frames that have a pose, (n,)."""
        return np.isfinite(self.x_mm) & np.isfinite(self.y_mm) & np.isfinite(self.heading_rad)

    def spacing_ratio(self) -> tuple[float, float]:
        """Measured over nominal distance of the marks and its standard error: the running check of scale.

        NaN, NaN without geometry. The error is that of the middle half of the frames taken as independent: a floor.
        """
        spacing = self.spacing_mm[self.measured] if len(self.spacing_mm) == len(self.time_s) else np.empty(0)
        if self.geometry is None or len(spacing) < 2:
            return float("nan"), float("nan")
        scatter = _robust_sigma(spacing)
        nominal = self.geometry.spacing_mm
        # 1.2533: the median of Gaussian values scatters sqrt(pi/2) times as much as their mean.
        return float(np.median(spacing) / nominal), float(1.2533 * scatter / np.sqrt(len(spacing)) / nominal)


def poses_from_marks(marks: pd.DataFrame, geometry: MarkGeometry, camera: Camera | None = None) -> Poses:
    """Reconstruct centre and heading from a marks table (evaluator.marks), frame by frame.

    Weighted least squares of a rigid body: heading from the direction between the marks, position from their weighted
    mean. Uncertainties come from the sigma columns (`green_x_sigma_mm`, …, `green_xy_cov_mm2`) or, where the table has
    none, from the scatter of the rigid distance itself. A frame with a missing mark is NaN with the mark's reason.
    With a camera the poses also carry what its uncertainty does to them (needs geometry.height_mm).
    Raises InputError for a table whose marks are not placed on the plate.
    """
    require_columns(marks, "marks")
    time = marks["time_s"].to_numpy(float)
    green, yellow = (marks[[f"{m}_x_mm", f"{m}_y_mm"]].to_numpy(float) for m in ("green", "yellow"))
    spacing = np.hypot(*(green - yellow).T)
    status = _status(marks, green, yellow, spacing)
    good = status == OK
    covariances = _mark_covariances(marks, spacing, good)
    weight = _green_weight(covariances, good)
    green, yellow = (np.where(good[:, None], points, np.nan) for points in (green, yellow))
    pose = _pose_of(green, yellow, geometry, weight)
    jump = _heading_jumps(time, pose[:, 2])
    status[jump] = "heading turned about for a moment: marks exchanged?"
    pose[jump] = np.nan
    pose[:, 2] = unwrapped_across_gaps(time, pose[:, 2])
    jacobian = _pose_jacobian(green, yellow, pose[:, 2], geometry, weight)
    covariance = np.einsum("nmia,nmab,nmjb->nij", jacobian, covariances, jacobian)
    systematic = None
    if camera is not None:
        if geometry.height_mm is None:
            raise InputError("marks: their height above the plate carries the camera's uncertainty; say height_mm")
        points = {"green": green, "yellow": yellow}
        systematic = systematic_shifts(marks, points, jacobian, pose[:, 2], covariances, geometry.height_mm, camera)
    return Poses(
        time_s=time,
        x_mm=pose[:, 0],
        y_mm=pose[:, 1],
        heading_rad=pose[:, 2],
        covariance=covariance,
        status=status.astype(str),
        spacing_mm=spacing,
        geometry=geometry,
        systematic=systematic,
    )


def unwrapped_across_gaps(time_s: Array, heading_rad: Array) -> Array:
    """Make a heading continuous: NaN stays, and turns made during a gap are counted from the yaw rate beside it."""
    result = np.array(heading_rad, dtype=float)
    there = np.flatnonzero(np.isfinite(result))
    if len(there) < 2:
        return result
    steps, heading_steps = np.diff(time_s[there]), np.diff(result[there])
    heading_steps -= 2 * np.pi * np.round(heading_steps / (2 * np.pi))
    gaps = np.flatnonzero(steps > 1.5 * np.median(steps))
    rates = heading_steps / steps
    rates[gaps] = np.nan
    for gap in gaps:
        beside = rates[max(gap - 5, 0) : gap + 6]
        if np.isfinite(beside).any():
            expected = float(np.nanmedian(beside)) * steps[gap]
            heading_steps[gap] += 2 * np.pi * np.round((expected - heading_steps[gap]) / (2 * np.pi))
    result[there] = result[there[0]] + np.concatenate([[0.0], np.cumsum(heading_steps)])
    return result


def _status(marks: pd.DataFrame, green: Array, yellow: Array, spacing: Array) -> NDArray[np.object_]:
    status = np.full(len(marks), OK, dtype=object)
    for name, points in (("yellow", yellow), ("green", green)):
        absent = ~np.isfinite(points).all(axis=1)
        reason = marks[f"{name}_status"].to_numpy(str) if f"{name}_status" in marks else np.full(len(marks), "absent")
        status[absent] = [f"{name}: {text if text not in ('nan', '', OK) else 'absent'}" for text in reason[absent]]
    status[(status == OK) & ~(spacing > ONE_PLACE_MM)] = "both marks are in one place: no heading"
    there = status == OK
    if there.sum() >= 3:
        usual = float(np.median(spacing[there]))
        limit = SPACING_LIMIT_SIGMA * max(_robust_sigma(spacing[there]), np.sqrt(2) * ROUNDING_SIGMA_MM)
        odd = there & (np.abs(spacing - usual) > limit)
        status[odd] = [f"marks {d:.3f} mm apart, {usual:.3f} in the other frames" for d in spacing[odd]]
    return status


def _heading_jumps(time: Array, heading: Array) -> NDArray[np.bool_]:
    """Frames whose heading points away from that of their neighbours: no robot turns about for a few frames."""
    there = np.flatnonzero(np.isfinite(heading))
    result = np.zeros(len(heading), dtype=bool)
    if len(there) < NEIGHBOURS:
        return result
    steps = np.angle(np.exp(1j * np.diff(heading[there])))
    usual = float(np.median(steps / np.diff(time[there])))
    pointing = np.exp(1j * (heading[there] - usual * time[there]))
    around = np.convolve(pointing, np.ones(NEIGHBOURS), mode="same")
    result[there] = (pointing * around.conj()).real < 0
    return result


def _mark_covariances(marks: pd.DataFrame, spacing: Array, good: NDArray[np.bool_]) -> Array:
    """Covariance of both marks, (n, 2, 2, 2), mm²: green first."""
    result = np.zeros((len(marks), 2, 2, 2))
    scatter = _robust_sigma(spacing[good]) if good.sum() >= 3 else 0.0
    unknown = max(scatter / np.sqrt(2), ROUNDING_SIGMA_MM)  # the distance holds one coordinate of each mark
    for index, name in enumerate(("green", "yellow")):
        for axis, letter in enumerate("xy"):
            column = f"{name}_{letter}_sigma_mm"
            sigma = marks[column].to_numpy(float) if column in marks else np.full(len(marks), np.nan)
            known = np.isfinite(sigma) & (sigma > 0)
            sigma = np.where(known, sigma, np.median(sigma[known]) if known.any() else unknown)
            result[:, index, axis, axis] = np.maximum(sigma, ROUNDING_SIGMA_MM) ** 2
        column = f"{name}_xy_cov_mm2"
        if column in marks:
            both = np.nan_to_num(marks[column].to_numpy(float))
            limit = 0.99 * np.sqrt(result[:, index, 0, 0] * result[:, index, 1, 1])
            result[:, index, 0, 1] = result[:, index, 1, 0] = np.clip(both, -limit, limit)
    return result


def _green_weight(covariances: Array, good: NDArray[np.bool_]) -> float:
    """Weight of the green mark in the position: one for the run, lest a wrong spacing make the centre jump."""
    if not good.any():
        return 0.5
    green, yellow = np.median(np.trace(covariances[good], axis1=2, axis2=3), axis=0)
    return float(yellow / (green + yellow))


def _pose_of(green: Array, yellow: Array, geometry: MarkGeometry, weight: float) -> Array:
    body_green, body_yellow = np.array(geometry.green_mm), np.array(geometry.yellow_mm)
    across, body_across = green - yellow, body_green - body_yellow
    heading = np.arctan2(across[:, 1], across[:, 0]) - np.arctan2(body_across[1], body_across[0])
    mean = weight * green + (1 - weight) * yellow
    body_mean = weight * body_green + (1 - weight) * body_yellow
    center = mean - plate_from_body(body_mean, 0.0, 0.0, heading)
    return np.column_stack([center, heading])


def _pose_jacobian(green: Array, yellow: Array, heading: Array, geometry: MarkGeometry, weight: float) -> Array:
    """Derivative of (x, y, heading) by green and by yellow: (n, 2, 3, 2)."""
    across = green - yellow
    by_green = np.stack([-across[:, 1], across[:, 0]], axis=1) / (across**2).sum(axis=1)[:, None]
    body_mean = weight * np.array(geometry.green_mm) + (1 - weight) * np.array(geometry.yellow_mm)
    lever = plate_from_body(np.array([-body_mean[1], body_mean[0]]), 0.0, 0.0, heading)  # d(R m)/d(heading)
    result = np.empty((len(green), 2, 3, 2))
    for index, (share, turn) in enumerate(((weight, by_green), (1 - weight, -by_green))):
        result[:, index, :2] = share * np.eye(2) - lever[:, :, None] * turn[:, None, :]
        result[:, index, 2] = turn
    return result


def _robust_sigma(values: Array) -> float:
    return float(GAUSSIAN_SIGMA_PER_MAD * np.median(np.abs(values - np.median(values))))
