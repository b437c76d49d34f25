"""Pose of the robot from its marks: centre and heading with covariance, on the plane of the marks.

Plate frame, mm; heading counter-clockwise from +x and unwrapped. The distances between the marks are constant. They are
used to check each frame (a mark with a deviating distance is left out, and the frame too if fewer than two marks
remain) and the scale of the whole recording. A single mark has a path, but no heading.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from calibration.camera import Camera
from evaluator.errors import InputError
from evaluator.mark_geometry import ONE_PLACE_MM, ROUNDING_SIGMA_MM, MarkGeometry
from evaluator.marks import points_of, require_marks
from evaluator.pose_systematic import systematic_shifts
from evaluator.rigid_fit import fitted_poses, learnt_places, odd_points, pose_jacobian
from evaluator.robust import robust_sigma

Array = NDArray[np.float64]

OK = "ok"
CORNER = "_corner1"  # suffix of the first corner of a tag
# Deviation of a distance, in robust standard deviations, beyond which it is an outlier: Gaussian noise exceeds it in
# one frame of 5e8, with or without correlation between frames.
SPACING_LIMIT_SIGMA = 6.0
NEIGHBOURS = 31  # frames whose common heading shows that one of them, or up to fifteen, is reversed
NO_HEADING = "no heading: a single mark has a position only"


@dataclass(frozen=True, repr=False)
class Poses:
    """Poses of the robot's centre over time, plate frame; NaN where a frame has none, with the reason in `status`.

    time_s, x_mm, y_mm, heading_rad: (n,). covariance: (n, 3, 3) of (x, y, heading), random from frame to frame.
    systematic: (n, 3, k), shift of every pose by one standard deviation of each of k independent errors common to all
    frames: of the camera, and of the marks' centres if they come from images; None without a camera. spacing_mm: (n,)
    measured distance of the two marks that are farthest apart; spacing_sigma_mm: (n,) its standard uncertainty, from
    those of the marks. For a robot with a single mark, x_mm and y_mm are the positions of this mark, and there is no
    heading.
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
    spacing_sigma_mm: Array = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        names = ("time_s", "x_mm", "y_mm", "heading_rad", "covariance", "spacing_mm", "systematic", "spacing_sigma_mm")
        for name in names:
            value = getattr(self, name)
            if value is not None:
                array = np.array(value, dtype=float)
                array.setflags(write=False)
                object.__setattr__(self, name, array)

    def __repr__(self) -> str:
        """One line: frames, frames with a pose, time, first and last position."""
        return "Poses(" + ", ".join(f"{name} {value}" for name, value in self._facts().items()) + ")"

    def _repr_html_(self) -> str:
        """Content of __repr__ as a table, for notebooks."""
        rows = (f"<tr><th>{name}</th><td>{value}</td></tr>" for name, value in self._facts().items())
        return f"<table>{''.join(rows)}</table>"

    def _facts(self) -> dict[str, str]:
        facts = {"frames": f"{len(self.time_s)}", "with a pose": f"{self.measured.sum()}"}
        known = np.flatnonzero(np.isfinite(self.x_mm))
        if len(known):
            facts["time"] = f"{self.time_s[0]:g} to {self.time_s[-1]:g} s"
            for name, at in (("from", known[0]), ("to", known[-1])):
                facts[name] = f"({self.x_mm[at]:.2f}, {self.y_mm[at]:.2f}) mm"
        return facts

    @property
    def measured(self) -> NDArray[np.bool_]:
        """Frames that have a pose, (n,)."""
        return np.isfinite(self.x_mm) & np.isfinite(self.y_mm) & np.isfinite(self.heading_rad)

    def spacing_ratio(self) -> tuple[float, float]:
        """Measured over nominal distance of the marks and its standard error: the running check of scale.

        NaN, NaN without geometry. The error is computed from the middle half of the frames as if independent: a lower
        bound.
        """
        spacing = self.spacing_mm[self.measured] if len(self.spacing_mm) == len(self.time_s) else np.empty(0)
        spacing = spacing[np.isfinite(spacing)]
        if self.geometry is None or len(spacing) < 2:
            return float("nan"), float("nan")
        scatter = robust_sigma(spacing)
        nominal = self.geometry.spacing_mm
        # 1.2533: the standard error of a median of Gaussian values is sqrt(pi/2) times that of their mean.
        return float(np.median(spacing) / nominal), float(1.2533 * scatter / np.sqrt(len(spacing)) / nominal)

    def spacing_scatter(self) -> tuple[float, float]:
        """Scatter of the distance of the marks over the distance, and over what the marks' uncertainties state.

        The distance on a rigid robot is constant: a second ratio above 1 shows errors that are not stated, for example
        of a mark that is partly hidden. NaN, NaN without two marks.
        """
        if len(self.spacing_mm) != len(self.time_s) or len(self.spacing_sigma_mm) != len(self.time_s):
            return float("nan"), float("nan")
        there = self.measured & np.isfinite(self.spacing_mm) & np.isfinite(self.spacing_sigma_mm)
        if there.sum() < 2:
            return float("nan"), float("nan")
        spacing = self.spacing_mm[there]
        scatter = robust_sigma(spacing)
        return float(scatter / np.median(spacing)), float(scatter / np.median(self.spacing_sigma_mm[there]))


def poses_from_marks(marks: pd.DataFrame, geometry: MarkGeometry, camera: Camera | None = None) -> Poses:
    """Reconstruct centre and heading from a marks table (evaluator.marks), frame by frame.

    Weighted least squares of a rigid body; if it has three or more marks, two must be visible. Uncertainties come from
    the sigma columns (NAME_x_sigma_mm, …, NAME_xy_cov_mm2) or, without these, from the scatter of the rigid distance. A
    frame with fewer than two marks is NaN, with the reason for one of the missing marks. With a camera, the poses
    include its uncertainty (needs geometry.height_mm). Raises InputError for a table whose marks are not placed on the
    plate.
    """
    geometry = geometry.seen_in(marks)
    names = geometry.names
    require_marks(marks, "marks", names)
    time, points = marks["time_s"].to_numpy(float), points_of(marks, names)
    if len(names) == 1:
        return _path_of_one(marks, time, points, geometry)
    spacing = _spacing(points, geometry)
    status = _status(marks, names, points)
    _take_out_odd(status, points)
    good = status == OK
    covariances = _mark_covariances(marks, names, spacing[good & np.isfinite(spacing)])
    weights = _weights(names, covariances, points, good)
    points = np.where(good[:, None, None], points, np.nan)
    places = learnt_places(points, geometry.places(), weights)
    pose = fitted_poses(points, places, weights)
    jump = _heading_jumps(time, pose[:, 2])
    status[jump] = "heading reversed for a moment: marks exchanged?"
    pose[jump] = np.nan
    pose[:, 2] = unwrapped_across_gaps(time, pose[:, 2])
    jacobian = pose_jacobian(points, pose[:, 2], places, weights)
    covariance = np.einsum("nmia,nmab,nmjb->nij", jacobian, covariances, jacobian)
    systematic = None
    if camera is not None:
        if geometry.height_mm is None:
            raise InputError(
                "marks: with a camera their height above the plate is needed; use MarkGeometry.of_robot(robot), or "
                "MarkGeometry(…, height_mm=…)"
            )
        by_name = {name: points[:, k] for k, name in enumerate(names)}
        systematic = systematic_shifts(
            *(marks, by_name, jacobian, pose[:, 2], covariances, geometry.height_mm, camera, geometry.height_sigma_mm)
        )
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
        spacing_sigma_mm=_spacing_sigma(points, covariances, geometry),
    )


def _path_of_one(marks: pd.DataFrame, time: Array, points: Array, geometry: MarkGeometry) -> Poses:
    """Poses from the positions of the only mark, without a heading."""
    covariance = np.full((len(time), 3, 3), np.nan)
    covariance[:, :2, :2] = _mark_covariances(marks, geometry.names, np.empty(0))[:, 0]
    status = _status(marks, geometry.names, points)
    status[status == OK] = NO_HEADING
    nothing = np.full(len(time), np.nan)
    x, y = points[:, 0].T
    return Poses(time, x, y, nothing, covariance, status.astype(str), nothing, geometry)


def unwrapped_across_gaps(time_s: Array, heading_rad: Array) -> Array:
    """Unwrap a heading (n,); NaN stays, and full turns in a gap are inferred from the yaw rates on either side."""
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


def _spacing(points: Array, geometry: MarkGeometry) -> Array:
    """Distance (n,) of the two marks that are farthest apart on the robot."""
    first, second = (geometry.names.index(name) for name in geometry.farthest_pair())
    return np.asarray(np.hypot(*(points[:, first] - points[:, second]).T))


def _spacing_sigma(points: Array, covariances: Array, geometry: MarkGeometry) -> Array:
    """Standard uncertainty (n,) of `_spacing`."""
    first, second = (geometry.names.index(name) for name in geometry.farthest_pair())
    apart = points[:, first] - points[:, second]
    along = apart / np.hypot(*apart.T)[:, None]
    variance = np.einsum("na,nab,nb->n", along, covariances[:, first] + covariances[:, second], along)
    return np.asarray(np.sqrt(variance))


def _status(marks: pd.DataFrame, names: Sequence[str], points: Array) -> NDArray[np.object_]:
    """OK if enough marks are visible, else the reason for the first missing one."""
    status = np.full(len(marks), OK, dtype=object)
    seen: NDArray[np.bool_] = np.isfinite(points).all(axis=2)  # type: ignore[assignment]
    few: NDArray[np.bool_] = np.asarray(seen.sum(axis=1) < min(2, len(names)))
    for k, name in reversed(list(enumerate(names))):
        absent = few & ~seen[:, k]
        reason = marks[f"{name}_status"].to_numpy(str) if f"{name}_status" in marks else np.full(len(marks), "absent")
        status[absent] = [f"{name}: {text if text not in ('nan', '', OK) else 'absent'}" for text in reason[absent]]
    return status


def _take_out_odd(status: NDArray[np.object_], points: Array) -> None:
    """Remove marks with deviating distances, and set the reason of frames without two remaining marks; in place."""
    low, high = np.nanmin(points, axis=1, initial=np.inf), np.nanmax(points, axis=1, initial=-np.inf)
    extent = np.asarray(np.hypot(*(high - low).T))
    all_of = "both" if points.shape[1] == 2 else "the"
    status[(status == OK) & ~(extent > ONE_PLACE_MM)] = f"{all_of} marks are at one position: no heading"
    there = status == OK
    wrong, refused = odd_points(
        np.where(there[:, None, None], points, np.nan), SPACING_LIMIT_SIGMA, np.sqrt(2) * ROUNDING_SIGMA_MM
    )
    points[wrong] = np.nan
    for row, (distance, usual) in refused.items():
        status[row] = f"marks {distance:.3f} mm apart, {usual:.3f} in the other frames"


def _heading_jumps(time: Array, heading: Array) -> NDArray[np.bool_]:
    """Frames whose heading is opposite to that of their neighbours: no robot reverses for a few frames."""
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


def _mark_covariances(marks: pd.DataFrame, names: Sequence[str], spacing: Array) -> Array:
    """Covariance of every mark, (n, m, 2, 2), mm²; spacing: distances of two of them in the frames with a pose."""
    result = np.zeros((len(marks), len(names), 2, 2))
    scatter = robust_sigma(spacing) if len(spacing) >= 3 else 0.0
    unknown = max(scatter / np.sqrt(2), ROUNDING_SIGMA_MM)  # the distance includes one coordinate of each mark
    for index, name in enumerate(names):
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


def _weights(names: Sequence[str], covariances: Array, points: Array, good: NDArray[np.bool_]) -> Array:
    """Weight of every mark in the pose: constant in a run, since otherwise a wrong spacing would move the centre."""
    traces = np.trace(covariances, axis1=2, axis2=3)
    seen = np.isfinite(points).all(axis=2) & good[:, None]
    scatter = np.array([np.median(traces[rows, k]) if rows.any() else np.inf for k, rows in enumerate(seen.T)])
    # The centre of a tag is that of its corners, and adds no information.
    return np.where([f"{name}{CORNER}" in names for name in names], 0.0, 1 / scatter)
