"""Rigid fit in the plane: heading and centre from observed points, and their derivatives by the points.

Weighted least squares (Schönemann 1966, Psychometrika 31, 1, in the plane). Points that are not visible are NaN; two
visible points suffice. Plate frame, mm and rad; places are positions in the body frame, mm.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from calibration.frames import body_from_plate, plate_from_body
from evaluator.robust import robust_sigma

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
HALF = 0.5  # of the limit of a distance, by which points are distinguished: three of six standard deviations
ENOUGH = 12  # frames with all marks, from which their mean positions on the body are more accurate than a robot file


def fitted_poses(points: Array, places: Array, weights: Array) -> Array:
    """Poses (n, 3) of x, y and heading; points (n, m, 2), places (m, 2), weights (m,) of the points.

    NaN where fewer than two points are seen. Headings are not unwrapped.
    """
    share, offset, mean = _about_mean(points, places, weights)
    if len(places) == 2:
        seen, body = points[:, 0] - points[:, 1], places[0] - places[1]
        heading = np.arctan2(seen[:, 1], seen[:, 0]) - np.arctan2(body[1], body[0])
    else:
        heading = np.angle(_moment(points, offset, share))
    center = mean - plate_from_body(_weighted(share, places), 0.0, 0.0, heading)
    return np.column_stack([center, heading])


def pose_jacobian(points: Array, heading: Array, places: Array, weights: Array) -> Array:
    """Derivative of (x, y, heading) by every point, (n, m, 3, 2); 0 for invisible points, NaN without a pose."""
    share, offset, _ = _about_mean(points, places, weights)
    with np.errstate(invalid="ignore"):  # NaN remains NaN; only complex division warns of it
        lean = share * np.conj(_complex(offset)) / _moment(points, offset, share)[:, None]
    turn = np.stack([lean.imag, lean.real], axis=-1)  # d(heading)
    middle = _weighted(share, places)
    lever = plate_from_body(np.stack([-middle[:, 1], middle[:, 0]], axis=1), 0.0, 0.0, heading)  # d(R m)/d(heading)
    result = np.empty((*points.shape[:2], 3, 2))
    result[:, :, :2] = share[:, :, None, None] * np.eye(2) - lever[:, None, :, None] * turn[:, :, None, :]
    result[:, :, 2] = turn
    result[~np.isfinite(heading)] = np.nan
    return result


def learnt_places(points: Array, places: Array, weights: Array) -> Array:
    """Places (m, 2) on the body, measured in frames that show all points; the given ones if there are too few frames.

    If one of several points is hidden for a while, an error of its place would move the centre. The weighted mean and
    the direction of the places remain as given.
    """
    whole = np.isfinite(points).all(axis=(1, 2))
    if len(places) < 3 or whole.all() or whole.sum() < ENOUGH:
        return places
    x, y, heading = fitted_poses(points[whole], places, weights).T[:, :, None]
    return np.asarray(body_from_plate(points[whole], x, y, heading).mean(axis=0))


def odd_points(points: Array, limit_sigma: float, least_mm: float) -> tuple[Flags, dict[int, tuple[float, float]]]:
    """Points (n, m) whose distances from the others deviate, and the frames without two consistent points.

    For each such frame: the distance that deviates most, and its value in the other frames. limit_sigma: robust
    standard deviations of a distance; least_mm: their lower bound.

    A point that moves at right angles to its line to another one hardly changes this distance. If the deviating
    distances have several points in common, the distances beyond half the limit decide between them.
    """
    count = points.shape[1]
    pairs = list(combinations(range(count), 2))
    distance = np.stack([np.hypot(*(points[:, a] - points[:, b]).T) for a, b in pairs], axis=1)
    usual, off = np.full(len(pairs), np.nan), np.zeros_like(distance)
    for k in range(len(pairs)):
        there = np.isfinite(distance[:, k])
        if there.sum() >= 3:
            usual[k] = float(np.median(distance[there, k]))
            limit = limit_sigma * max(robust_sigma(distance[there, k]), least_mm)
            off[:, k] = np.nan_to_num(np.abs(distance[:, k] - usual[k]) / limit)
    wrong, refused = np.zeros(points.shape[:2], bool), {}
    for row in np.flatnonzero((off > 1).any(axis=1)):
        seen = np.flatnonzero(np.isfinite(points[row]).all(axis=1))
        culprit = _odd_one(pairs, off[row], seen)
        if culprit is not None:
            wrong[row, culprit] = True
        else:
            worst = int(off[row].argmax())
            refused[int(row)] = float(distance[row, worst]), float(usual[worst])
    return wrong, refused


def _odd_one(pairs: list[tuple[int, int]], off: Array, seen: NDArray[np.int64]) -> int | None:
    """The point of several seen ones that alone is part of all deviating distances; off: deviations over the limit."""
    if len(seen) < 3:
        return None
    for limit in (1.0, HALF):
        odd = [pair for pair, size in zip(pairs, off, strict=True) if size > limit]
        common = [int(point) for point in seen if all(point in pair for pair in odd)]
        if len(common) == 1:
            return common[0]
    return None


def _about_mean(points: Array, places: Array, weights: Array) -> tuple[Array, Array, Array]:
    """Shares (n, m) of the points in the mean, places (n, m, 2) from their mean, mean (n, 2) of the points."""
    seen = np.isfinite(points).all(axis=2)
    share = weights * seen
    total = share.sum(axis=1, keepdims=True)
    share = np.divide(share, total, out=np.full_like(share, np.nan), where=seen.sum(axis=1, keepdims=True) > 1)
    offset = places - _weighted(share, places)[:, None]
    return share, offset, (share[:, :, None] * np.nan_to_num(points)).sum(axis=1)


def _weighted(share: Array, places: Array) -> Array:
    return np.asarray((share[:, :, None] * places).sum(axis=1))


def _moment(points: Array, offset: Array, share: Array) -> NDArray[np.complex128]:
    """Sum of conj(place) · point, whose angle is the heading. Places have mean zero, so that points need not."""
    return np.asarray((share * np.conj(_complex(offset)) * _complex(np.nan_to_num(points))).sum(axis=1))


def _complex(points: Array) -> NDArray[np.complex128]:
    return np.asarray(points[..., 0] + 1j * points[..., 1])
