"""Errors of the measurement that all runs of a camera share, as parameters with a prior.

A camera is known to within the covariance of its calibration, and a tracker may locate a mark slightly off its centre
in all frames. These errors do not average out over runs; a diagnosis that took the camera for exact would report them
as an effect (plane-scale, camera-tilt, mark-offset). Here each independent error is represented by the shift of the
marks by one standard deviation; the fit may adjust it, like nominal values of the robot within their tolerances.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from calibration.camera import Camera
from evaluator.marks import columns_of
from evaluator.pose_systematic import camera_shifts, common_error_mm

Floats = NDArray[np.float64]

# A direction that bends or scales no path by more than this (RMS) is left out: the distance of the marks, averaged over
# twenty runs of H.264 at 12 px/mm, is known to about as much.
NEGLIGIBLE_MM = 5e-5
SAMPLES = 40  # frames of a run in which directions are compared: a lens is smooth
BENDS = [(i, j) for i in range(4) for j in range(4) if 2 <= i + j <= 3]  # powers of x and y: a keystone, a lens


@dataclass(frozen=True)
class Sighting:
    """Two marks of one run, mapped by a camera of this name to the plane at height_mm (from evaluator.tracking)."""

    table: pd.DataFrame
    marks: tuple[str, ...]
    camera_name: str
    camera: Camera
    height_mm: float


def shared_errors(sightings: Sequence[Sighting | None]) -> list[dict[str, Floats]]:
    """Shifts of the marks (n, 4) of every run, mm, by one standard deviation of each shared error, by key.

    Runs without a sighting have none. Missing marks have zeros. Keys hold no dot, unlike those of robot.toml.
    """
    found: list[dict[str, Floats]] = [{} for _ in sightings]
    groups: dict[str, list[int]] = {}
    for number, item in enumerate(sightings):
        if item is not None:
            groups.setdefault(item.camera_name, []).append(number)
    for name, runs in groups.items():
        seen = [item for number in runs if (item := sightings[number]) is not None]
        points = [_points(item) for item in seen]
        shifts = [_of_camera(item, where) for item, where in zip(seen, points, strict=True)]
        chosen = _main_directions(points, shifts)
        for number, item, where, shift in zip(runs, seen, points, shifts, strict=True):
            own = np.concatenate([shift @ chosen, _fixed_to_body(item, where)], axis=2)
            found[number] = {f"{name}, error {k + 1}": np.nan_to_num(own[:, :, k]) for k in range(own.shape[2])}
    return found


def plane_errors(places_mm: Sequence[Floats | None], scale: float) -> list[dict[str, Floats]]:
    """Shifts of marks (n, 4), mm, by one standard deviation of each smooth error of their plane, by key.

    If lengths are known to a relative scale (one standard deviation), local lengths are not known better: a calibration
    has residual errors that distort the plane and grow toward its edges. Each power of the position is scaled to have
    this slope at the edge. None for marks from a camera with a known covariance.
    """
    there = [where for where in places_mm if where is not None]
    if not there or scale <= 0:
        return [{} for _ in places_mm]
    xy = np.concatenate([where.reshape(-1, 2) for where in there])
    xy = xy[np.isfinite(xy).all(axis=1)]
    middle, reach = np.median(xy, axis=0), float(np.ptp(xy, axis=0).max()) / 2
    points = [{"first": where[:, :2], "second": where[:, 2:]} for where in there]
    shifts = [_bent(where, middle, reach, scale) for where in there]
    chosen = _main_directions(points, shifts)
    own = iter([np.nan_to_num(shift @ chosen) for shift in shifts])
    return [
        {} if where is None else {f"plane, error {k + 1}": part for k, part in enumerate(np.moveaxis(next(own), 2, 0))}
        for where in places_mm
    ]


def _bent(where: Floats, middle: Floats, reach: float, scale: float) -> Floats:
    """Shifts (n, 4, k) of marks (n, 4) by each power of the position, along x and along y."""
    places = (where.reshape(-1, 2, 2) - middle) / reach
    shifts = np.zeros((len(where), 2, 2, 2, len(BENDS)))
    for number, (i, j) in enumerate(BENDS):
        size = scale * reach / (i + j) * places[..., 0] ** i * places[..., 1] ** j
        shifts[:, :, 0, 0, number] = shifts[:, :, 1, 1, number] = size
    return shifts.reshape(len(where), 4, -1)


def _points(item: Sighting) -> dict[str, Floats]:
    return {mark: item.table[columns_of([mark])].to_numpy(float) for mark in item.marks}


def _of_camera(item: Sighting, points: dict[str, Floats]) -> Floats:
    """Shifts (n, 4, k) by the independent errors of the camera."""
    both = np.isfinite(np.concatenate(list(points.values()), axis=1)).all(axis=1)
    points = {mark: np.where(both[:, None], where, np.nan) for mark, where in points.items()}
    shifts = camera_shifts(item.table, points, item.height_mm, item.camera)
    return np.asarray(shifts.reshape(len(shifts), 4, -1))


def _main_directions(points: Sequence[Mapping[str, Floats]], shifts: Sequence[Floats]) -> Floats:
    """Combinations (k, m) of a camera's errors that are relevant; orthonormal, so that each is one standard deviation.

    Errors that shift or rotate a run as a whole are excluded, because the start pose of every run is free.
    """
    rows = []
    for where, shift in zip(points, shifts, strict=True):
        there = np.flatnonzero(np.isfinite(shift).all(axis=(1, 2)))
        frames = there[np.unique(np.linspace(0, len(there) - 1, min(len(there), SAMPLES)).astype(int))]
        xy = np.concatenate([places[frames] for places in where.values()], axis=1).reshape(-1, 2)
        rigid = np.zeros((len(xy), 2, 3))
        rigid[:, 0, 0] = rigid[:, 1, 1] = 1.0
        rigid[:, :, 2] = (xy - xy.mean(axis=0))[:, ::-1] * [-1.0, 1.0]
        basis = np.linalg.qr(rigid.reshape(-1, 3))[0]
        moved = shift[frames].reshape(-1, shift.shape[2])
        rows.append(moved - basis @ (basis.T @ moved))
    stacked = np.concatenate(rows)
    _, size, directions = np.linalg.svd(stacked, full_matrices=False)
    return np.asarray(directions[size / np.sqrt(len(stacked)) > NEGLIGIBLE_MM].T)


def _fixed_to_body(item: Sighting, points: dict[str, Floats]) -> Floats:
    """Shifts (n, 4, 4) by an error of either mark along and across their line; empty for marks not tracked."""
    table = item.table
    if not all(f"{mark}_{column}" in table for mark in item.marks for column in ("x_px", "x_sigma_mm")):
        return np.zeros((len(table), 4, 0))
    variances = np.stack(
        [table[[f"{m}_x_sigma_mm", f"{m}_y_sigma_mm"]].to_numpy(float) ** 2 for m in item.marks], axis=1
    )
    error = common_error_mm(table, points, variances[..., None] * np.eye(2))
    line = np.subtract(*points.values())
    line = line / np.hypot(line[:, 0], line[:, 1])[:, None]
    across = line[:, ::-1] * [-1.0, 1.0]
    shifts = np.zeros((len(table), 4, 4))
    for mark in range(2):
        shifts[:, 2 * mark : 2 * mark + 2, 2 * mark] = line
        shifts[:, 2 * mark : 2 * mark + 2, 2 * mark + 1] = across
    return error * shifts
