"""Offset between the centre of the ellipse fitted to a disc's image and the image of the disc's centre.

Derivation. Let F take the gauge plane to the image and J be its derivative at the disc's centre. The circle of
radius R maps to B(t) = F(c + R e(t)). In the coordinates u = (R J)⁻¹ (B - F(c)) this is almost the unit circle, u =
(1 + ρ(t)) e(t); perspective and distortion make ρ of order R (second derivatives of F against the first). A shift s
of an ellipse adds s·e to ρ, a change of its axes 1, cos 2t and sin 2t. The fit of `fit_dots` matches pixels; an edge
displaced by δ along its normal changes them by an amount that, squared and summed, is ∮ δ² dl to first order,
whatever the blur. With δ = Rρ/|J⁻ᵀe| and dl = R |det J| |J⁻ᵀe| dt, the weight of ρ² is 1/|J⁻ᵀe(t)|: the fitted
ellipse is the weighted least-squares fit of those five terms to ρ, and its centre F(c) + R J s. A second pass about
the shifted centre leaves errors of order R⁴. (For a circle-preserving J this is the offset that Heikkilä derived for
perspective alone; see Mallon and Whelan 2007 for the two biases. The edge weighting applies to a maximum-likelihood fit
of the dot, not to the centroid of its area.)
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibration.camera import image_points, project
from calibration.lens import LensModel, solve_2x2

Array = NDArray[np.float64]
SAMPLES = 16  # of the circle: separates harmonics up to the seventh; already the third vanishes as R²


def fitted_centers(points_mm: Array, radius_mm: Array, parameters: Array, lens: LensModel) -> Array:
    """Image points (n, 2), px, of the ellipse centres that `detect_dots` reports for discs parallel to the plate.

    points_mm: (n, 3) disc centres, plate frame. radius_mm: (n,). parameters, lens: of the camera.
    """
    angle = np.arange(SAMPLES) * (2 * np.pi / SAMPLES)
    circle = np.stack([np.cos(angle), np.sin(angle)], 1)
    center, by_point, _ = project(points_mm, parameters, lens)
    scaled = by_point[:, :, :2] * radius_mm[:, None, None]
    rim = points_mm[:, None, :] + np.pad(radius_mm[:, None, None] * circle, ((0, 0), (0, 0), (0, 1)))
    seen = image_points(rim.reshape(-1, 3), parameters, lens).reshape(len(points_mm), SAMPLES, 2)
    u = np.swapaxes(solve_2x2(scaled, np.swapaxes(seen - center[:, None], 1, 2)), 1, 2)
    shift = np.zeros_like(center)
    for _ in range(2):
        about = u - shift[:, None]
        length = np.hypot(about[..., 0], about[..., 1])
        e = about / length[..., None]
        cos_2, sin_2 = e[..., 0] ** 2 - e[..., 1] ** 2, 2 * e[..., 0] * e[..., 1]
        terms = np.stack([e[..., 0], e[..., 1], np.ones_like(cos_2), cos_2, sin_2], axis=-1)
        # |J⁻ᵀ e| = |J e⊥| / |det J|, and a common factor does not matter
        across = np.stack([-e[..., 1], e[..., 0]], axis=-1) @ np.swapaxes(scaled, 1, 2)
        weighted = terms / np.hypot(across[..., 0], across[..., 1])[..., None]
        normal = np.swapaxes(weighted, 1, 2) @ terms
        right = np.swapaxes(weighted, 1, 2) @ (length - 1)[..., None]
        shift = shift + _solved(normal, right)[:, :2]
    return np.asarray(center + (scaled @ shift[..., None])[..., 0])


def _solved(normal: Array, right: Array) -> Array:
    """Solve a stack of systems, NaN where one holds NaN."""
    bad: NDArray[np.bool_] = np.asarray(~np.isfinite(normal).all(axis=(1, 2)))
    solution = np.linalg.solve(np.where(bad[:, None, None], np.eye(normal.shape[1]), normal), right)[..., 0]
    solution[bad] = np.nan
    return np.asarray(solution)
