"""Propagation of errors of the gauge to the camera: of single dots, and of the common pitch.

A misplaced dot is misplaced in every image, so that its error does not average out over images like noise. With
the normal matrix N, whitened derivatives A by the parameters and B by the gauge's coordinates, a displacement d of
the dots moves the solution by -N⁻¹ Aᵀ B d (implicit function); summed over images this gives the covariance.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibration.camera import project
from calibration.estimation.bundle_adjustment import (
    Fit,
    State,
    View,
    places_of_view,
    points_of,
    view_rows,
    whitening,
)
from calibration.estimation.robust import huber_weights
from calibration.gauge.geometry import Tolerance

Array = NDArray[np.float64]


def with_tolerance(views: list[View], state: State, tolerance: Tolerance) -> list[View]:
    """The views with the dots' own tolerance added to the uncertainty of their images, at a state."""
    if tolerance.dot_mm == 0:
        return views
    wider = []
    for k, view in enumerate(views):
        by_point = by_plane(view, state, k)
        inverse = np.linalg.inv(view.whitening)
        covariance = inverse @ np.swapaxes(inverse, 1, 2)
        covariance = covariance + tolerance.dot_mm**2 * by_point @ np.swapaxes(by_point, 1, 2)
        wider.append(replace(view, whitening=whitening(covariance)))
    return wider


def covariance_with_tolerance(views: list[View], fit: Fit, tolerance: Tolerance) -> Array:
    """Covariance (n, n) of the free lens parameters and all poses, by noise and by the tolerance of single dots."""
    inverse = np.linalg.inv(fit.normal)
    if tolerance.dot_mm == 0:
        return np.asarray(inverse * fit.variance, dtype=float)
    size = len(fit.normal)
    sites = 1 + max(int(view.site.max()) for view in views)
    common, single = np.zeros((size, 2 * sites)), np.zeros((size, size))
    for k, view in enumerate(views):
        place, pull = _pulls(view, fit, k)
        here = np.zeros((size, 2 * sites))
        for axis in (0, 1):
            here[place[:, None], 2 * view.site + axis] = pull[:, :, axis].T
        common += here
        single += here @ here.T
    # the noise term treats the dots' errors as independent between images: replace this part
    errors = tolerance.dot_mm**2 * (common @ common.T - single)
    return np.asarray(inverse * max(fit.variance, 1.0) + inverse @ errors @ inverse)


def change_by_pitch(views: list[View], fit: Fit) -> Array:
    """Derivative of the solution (shared + 6 n_views,) by a common relative error of the pitch."""
    moved = np.zeros(len(fit.normal))
    for k, view in enumerate(views):
        place, pull = _pulls(view, fit, k)
        moved[place] += np.einsum("npa,na->p", pull, view.points_mm[:, :2])
    return np.asarray(-np.linalg.solve(fit.normal, moved))


def _pulls(view: View, fit: Fit, k: int) -> tuple[NDArray[np.int64], Array]:
    """Indices of a view's unknowns in the normal matrix, and the gradient (n, unknowns, 2) by each dot's position."""
    _, white, by_parameter = view_rows(view, fit.state, k)
    by_parameter = by_parameter * huber_weights(white, fit.scale)[:, None, None]  # those of the normal matrix
    by_dot = view.whitening @ by_plane(view, fit.state, k)
    return places_of_view(fit.state, k), np.swapaxes(by_parameter, 1, 2) @ by_dot


def by_plane(view: View, state: State, k: int) -> Array:
    """Derivative of the image points by x and y on the gauge, (n, 2, 2)."""
    return project(points_of(view, state), state.parameters(k), state.model)[1][:, :, :2]
