"""Focal lengths of single images: autofocus and zoom change them, and so does a program that turns or crops an image.

All images are fitted with one focal length. From that fit, one step of Gauss and Newton shows how a focal length of
each image's own would differ, while all other unknowns adapt; the differences take up the fit's misfit if they are
real. A lens, a bent or a stretched gauge takes up only a part of them, and is then found instead, with a wrong value.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calibration.camera import PARAMETERS, project
from calibration.estimation.bundle_adjustment import POSE_COUNT, Fit, View, places_of_view, points_of, view_rows
from calibration.estimation.robust import huber_weights

Array = NDArray[np.float64]
# Sigmas of chi² (2 per degree of freedom) by which differences must explain the misfit. 26 sets of renderings with one
# focal length, of bent, dirty, blurred and wrongly printed gauges, reach 3.3; one with changes by 0.1 % has 16.
CLEAR = 10.0
# Variance of unit weight that may be left: far above, the model is wrong in another way, which the differences imitate.
MOST_LEFT = 9.0
UNDETERMINED = 1e-6  # of the best determined combination: the common focal length, which the fit has found


def focal_difference(views: Sequence[View], fit: Fit) -> float:
    """Clearest relative difference of the focal lengths of two images; 0 if a common one explains them as well.

    It is about right only: other unknowns of the fit have taken up a part of it.
    """
    if len(views) < 2:
        return 0.0
    count = len(views)
    cross, own, downhill = np.zeros((len(fit.normal), count)), np.zeros(count), np.zeros(count)
    for k, view in enumerate(views):
        parameters = fit.state.parameters(k)
        _, white, by_unknown = view_rows(view, fit.state, k)
        weight = huber_weights(white, fit.scale)
        by_focal = project(points_of(view, fit.state), parameters, fit.state.model)[2][:, :, POSE_COUNT, None]
        rows = (view.whitening @ by_focal)[..., 0] * fit.state.lens[0]
        cross[places_of_view(fit.state, k), k] = np.einsum("n,nap,na->p", weight, by_unknown, rows)
        own[k] = np.sum(weight[:, None] * rows**2)
        downhill[k] = np.sum(weight[:, None] * rows * white)
    values, vectors = np.linalg.eigh(np.diag(own) - cross.T @ np.linalg.solve(fit.normal, cross))
    known = values > UNDETERMINED * values[-1]
    covariance = (vectors[:, known] / values[known]) @ vectors[:, known].T
    found, variance, freedom = covariance @ downhill, max(fit.variance, 1.0), int(known.sum())
    explained = float(downhill @ found)
    left = fit.variance - explained / (2 * sum(len(view) for view in views))
    if not explained / variance > freedom + CLEAR * (2 * freedom) ** 0.5 or left > MOST_LEFT:
        return 0.0
    spread = np.diag(covariance)
    sigma = np.sqrt(np.maximum(variance * (spread[:, None] + spread - 2 * covariance), 1e-300))
    excess = found[:, None] - found
    return float(excess.flat[np.argmax(np.where(np.eye(count, dtype=bool), -1.0, excess / sigma))])


def covariance_by_focal(difference: float, parameters: Array) -> Array:
    """Covariance (16, 16) of a camera's parameters (16,) whose focal length is uncertain by a relative difference.

    It may be that of any image. The plate stays as large in its image if its distance changes in proportion: lengths on
    it keep their scale, and those at a height above it change by the share of the height in the distance. Of a camera
    150 mm away that was focused anew by 2 %, those of marks 6.5 mm above the plate were wrong by 0.093 %, and said to
    be known to 0.021 %.
    """
    change = np.zeros(len(PARAMETERS))
    for name in ("focal_px", "translation_z_mm"):
        change[PARAMETERS.index(name)] = difference * parameters[PARAMETERS.index(name)]
    return np.outer(change, change)
