"""Initial values: poses from plane homographies for a series of focal lengths and both lens models."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.camera import Camera
from calibration.estimation.bundle_adjustment import Fit, Prior, State, View, solve
from calibration.lens import LensModel, undistort

Array = NDArray[np.float64]
# Focal lengths in widths of the image, from fisheye to long lens; a step is smaller than the range of convergence.
LADDER: tuple[tuple[LensModel, float], ...] = (
    ("brown", 0.7), ("brown", 1.5), ("brown", 4.0), ("brown", 12.0),
    ("fisheye", 0.35), ("fisheye", 0.7), ("fisheye", 1.5),
)  # fmt: skip
SHORTEST = 0.2  # widths of the image: a fisheye of 180 degrees has 0.32
FEW = 80  # dots per image, sufficient for initial values


def rough_prior(size_px: tuple[int, int]) -> Prior:
    """Priors from real lenses, wide enough that informative images dominate them.

    Principal point: within 8 % of the width of the middle (assembly tolerances of small cameras). Aspect: square
    pixels to 0.2 %. Focal length: a factor e about 1.5 widths. Distortion: up to strong fisheyes; decentring: 0.002.
    """
    width, height = size_px
    mean = np.array([1.5 * width, 1.0, (width - 1) / 2, (height - 1) / 2, 0, 0, 0, 0, 0, 0])
    sigma = np.array([1.5 * width, 0.002, 0.08 * width, 0.08 * width, 1.0, 2.0, 0.002, 0.002, 5.0, 5.0])
    return Prior(mean, sigma, shortest_px=SHORTEST * width)


def rough_start(views: list[View], size_px: tuple[int, int], prior: Prior) -> list[Fit]:
    """Initial solutions, best first, with focal length and k1 free and the principal point in the middle."""
    few = [_spread(view) for view in views]
    fits = []
    for model, widths in LADDER:
        lens = prior.mean.copy()
        lens[0] = widths * size_px[0]
        poses = np.stack([_pose(view, lens, size_px) for view in few])
        start = State(poses, lens, model, ("focal_px", "k1"))
        fit = solve(few, start, prior, steps=30)
        if np.isfinite(fit.cost) and fit.whitened:
            fits.append(fit)
    return sorted(fits, key=lambda fit: fit.cost)


def rough_pose(view: View, camera: Camera) -> Array:
    """Pose (6,) of the gauge in one image of a known camera."""
    return _pose(
        replace(view, centers_px=_undistorted(view.centers_px, camera)), camera.lens_parameters, camera.size_px
    )


def _undistorted(points_px: Array, camera: Camera) -> Array:
    """Image points corrected for the distortion of the camera."""
    normalised = (points_px - camera.principal_px) / camera.focal_xy_px
    return undistort(normalised, camera.distortion, camera.lens) * camera.focal_xy_px + camera.principal_px


def _spread(view: View) -> View:
    """At most FEW dots, evenly over the list."""
    keep = np.zeros(len(view), dtype=bool)
    keep[np.linspace(0, len(view) - 1, min(len(view), FEW)).astype(int)] = True
    return view.take(keep)


def _pose(view: View, lens: Array, size_px: tuple[int, int]) -> Array:
    """Pose (6,) from the homography of the dots nearest the middle of the image, where distortion is least."""
    middle = (np.array(size_px) - 1) / 2
    distance = np.hypot(*(view.centers_px - middle).T)
    near = np.argsort(distance)[: max(12, len(view) // 2)]
    normalised = (view.centers_px[near] - lens[2:4]) / (lens[0], lens[0] * lens[1])
    plane = view.points_mm[near, :2]
    homography = cv2.findHomography(plane - plane.mean(axis=0), normalised, 0)[0]  # its last element is 1
    if homography is None:
        homography = np.diag([1.0, -1.0, 1.0])
    homography = homography / np.sqrt(np.linalg.norm(homography[:, 0]) * np.linalg.norm(homography[:, 1]))
    r1, r2, translation = homography.T
    u, _, vt = np.linalg.svd(np.stack([r1, r2, np.cross(r1, r2)], axis=1))
    rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    center = np.array([*plane.mean(axis=0), view.points_mm[near, 2].mean()])
    return np.concatenate([cv2.Rodrigues(rotation)[0][:, 0], translation - rotation @ center])
