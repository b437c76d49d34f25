"""Corners and centre of a square tag from the lines of its black border, with their covariance.

Image coordinates of the luma, px. Along each side the edge is located on many normals; a line through these points is
much more accurate than a corner, which blur rounds off.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from evaluator.robust import PER_MEDIAN

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

REACH_SHARE, LEAST_REACH_PX, MOST_REACH_PX = 0.1, 1.6, 4.0  # of the side: less than a cell of border or of margin
KEPT = 0.15  # share of a side that is left out at each corner, where the other side is blurred into it
# Standard deviation over reach of the window about an edge. Cells inside the border, and the floor beyond the margin,
# are at least a reach away; their remaining weight moves an edge by 0.01 px on tags of 4 px a cell.
WINDOW, STEPS = 0.3, 5
STEP = 0.25  # px between samples of a profile
FEWEST = 5  # points for a line
# Points one pixel apart have correlated errors from interpolation and codec: least factor of the variance, and largest
# correlation of neighbours, from which the factor follows (nine at most).
ALIKE, MOST_CORRELATED = 2.0, 0.8
FLOOR_PX = 0.01  # least uncertainty of a point of an edge, per axis, by interpolation between pixels
CLIPPED = 3.0  # robust sigmas from the line beyond which a point is an outlier
MOST_SCATTER_PX = 0.6  # largest scatter of points about a straight border


def measured_tag(luma: Image, corners: Array) -> tuple[Array, Array] | None:
    """Centre and corners (5, 2) with covariances (5, 2, 2); None if the borders are not straight.

    corners: (4, 2) as OpenCV finds them, to about a pixel, clockwise.
    """
    for _ in range(2):  # the second time from more accurate lines
        lines = [_line(luma, corners[k], corners[(k + 1) % 4]) for k in range(4)]
        if any(line is None for line in lines):
            return None
        parameters = np.array([line[0] for line in lines if line is not None])
        frames = np.array([line[1] for line in lines if line is not None])
        found = _points(parameters, frames)
        corners = found[1:]
        if not np.isfinite(found).all():
            return None
    spread = np.zeros((8, 8))
    for k, line in enumerate(lines):
        assert line is not None
        spread[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = line[2]
    step = 1e-3
    moved = [_points(parameters + change, frames) for change in step * np.eye(8).reshape(8, 4, 2)]
    jacobian = (np.array(moved) - found) / step  # (8, 5, 2)
    covariances = np.einsum("pia,pq,qib->iab", jacobian, spread, jacobian)
    return found, covariances


def _line(luma: Image, start: Array, end: Array) -> tuple[Array, Array, Array] | None:
    """Edge between two corners: offset and slope (2,) in a frame (3, 2) of origin, along, outward; their covariance."""
    length = float(np.hypot(*(end - start)))
    count = int(length * (1 - 2 * KEPT))
    if count < FEWEST:
        return None
    along = (end - start) / length
    outward = np.array([along[1], -along[0]])  # corners are clockwise in the image, y down
    reach = min(max(REACH_SHARE * length, LEAST_REACH_PX), MOST_REACH_PX)
    at = np.linspace(-0.5 + KEPT, 0.5 - KEPT, count) * length
    depth = np.arange(-reach, reach + STEP / 2, STEP)
    middle = (start + end) / 2
    places = middle + at[:, None, None] * along + depth[None, :, None] * outward
    profile = cv2.remap(
        luma, places[..., 0].astype(np.float32), places[..., 1].astype(np.float32), cv2.INTER_LINEAR
    ).astype(float)
    steep = np.maximum(np.diff(profile, axis=1), 0.0)  # from black to white, outward
    total = steep.sum(axis=1)
    between = (depth[1:] + depth[:-1]) / 2
    usable = total > 0.5 * float(np.median(total)) + 1e-9
    if usable.sum() < FEWEST:
        return None
    offset = _centered(np.diff(profile, axis=1)[usable], between, steep[usable] @ between / total[usable], reach)
    where = at[usable] / length
    kept = np.ones(len(offset), bool)
    for _ in range(3):
        design = np.stack([np.ones(int(kept.sum())), where[kept]], axis=1)
        fitted = np.linalg.lstsq(design, offset[kept], rcond=None)[0]
        left = offset - fitted[0] - fitted[1] * where
        sigma = PER_MEDIAN * float(np.median(np.abs(left[kept])))
        kept = np.abs(left) <= CLIPPED * max(sigma, FLOOR_PX)
        if kept.sum() < FEWEST:
            return None
    variance = float(np.mean(left[kept] ** 2)) + FLOOR_PX**2
    if variance > MOST_SCATTER_PX**2:
        return None
    design = np.stack([np.ones(int(kept.sum())), where[kept]], axis=1)
    alike = min(float(np.mean(left[1:] * left[:-1])) / variance, MOST_CORRELATED)
    times = max((1 + alike) / (1 - alike), ALIKE)
    covariance = times * variance * np.linalg.inv(design.T @ design)
    return fitted, np.stack([middle, along * length, outward]), covariance


def _centered(rising: Array, depth: Array, start: Array, reach: float) -> Array:
    """Depth of each edge: the centre of its rise within a window, which excludes neighbouring edges; (n,).

    rising: (n, m) change of the luma between samples, outward, at depths (m,), px. start: (n,) initial depths.
    """
    offset = start
    for _ in range(STEPS):
        window = np.exp(-0.5 * ((depth - offset[:, None]) / (WINDOW * reach)) ** 2) * rising
        total = np.maximum(window.sum(axis=1), 1e-3 * np.abs(window).sum(axis=1) + 1e-9)
        # A window as wide as the edge reduces the change of the mean by about half.
        offset = np.clip(offset + 2.0 * (window @ depth / total - offset), -reach, reach)
    return offset


def _points(lines: Array, frames: Array) -> Array:
    """Centre, then corners: where the lines (4, 2) of offset and slope in frames (4, 3, 2) meet; (5, 2)."""
    start = frames[:, 0] + (lines[:, :1] - lines[:, 1:] / 2) * frames[:, 2] - frames[:, 1] / 2
    end = frames[:, 0] + (lines[:, :1] + lines[:, 1:] / 2) * frames[:, 2] + frames[:, 1] / 2
    corners = np.array([_meet(start[k - 1], end[k - 1], start[k], end[k]) for k in range(4)])
    return np.vstack([_meet(corners[0], corners[2], corners[1], corners[3]), corners])


def _meet(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Intersection of the line through a and b with that through c and d; NaN for parallels."""
    first, second = b - a, d - c
    across = first[0] * second[1] - first[1] * second[0]
    if abs(across) < 1e-9:
        return np.full(2, np.nan)
    apart = c - a
    return np.asarray(a + first * (apart[0] * second[1] - apart[1] * second[0]) / across)
