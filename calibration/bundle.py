"""Weighted, robust least squares over one camera and the pose of the gauge in each picture.

Levenberg and Marquardt on the normal equations, analytic derivatives; weak priors of real lenses keep parameters that
the pictures do not determine at plausible values with honest, wide uncertainties. Plate frame of the plate picture,
gauge frame of the others.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from calibration.camera import PARAMETERS, project
from calibration.disc import fitted_centers
from calibration.lens import LensModel

Array = NDArray[np.float64]
POSE_COUNT, LENS_COUNT = 6, len(PARAMETERS) - 6
LENS_PARAMETERS = PARAMETERS[6:]
STEPS = 60
# Residuals beyond this many standard deviations pull with constant force (Huber); of 10 000 sound ones 27 are.
HUBER = 3.0
# After the fit, those beyond this are left out: of 10 000 sound dots 0.04 are.
OUTLIER = 5.0


@dataclass(frozen=True)
class View:
    """Dots of one picture: where they are seen and which places of the gauge they are.

    centers_px: (n, 2). covariance_px2: (n, 2, 2). points_mm: (n, 3) on the gauge, z = its height. radius_mm: (n,).
    site: (n,) number of the place on the gauge. name: of the picture, for messages.
    """

    centers_px: Array
    covariance_px2: Array
    points_mm: Array
    radius_mm: Array
    site: NDArray[np.int64]
    name: str = ""

    def take(self, keep: NDArray[np.bool_]) -> View:
        """Some of the dots."""
        return replace(
            self,
            centers_px=self.centers_px[keep],
            covariance_px2=self.covariance_px2[keep],
            points_mm=self.points_mm[keep],
            radius_mm=self.radius_mm[keep],
            site=self.site[keep],
        )

    def __len__(self) -> int:
        """Count of dots."""
        return len(self.site)


@dataclass(frozen=True)
class Prior:
    """Independent normal priors on lens parameters, mean and sigma (10,), and optionally on the camera's distance."""

    mean: Array
    sigma: Array
    distance_mm: tuple[float, float] | None = None  # of the lens from the plate along its normal, with sigma


@dataclass(frozen=True)
class State:
    """Pose (n_views, 6) of the gauge in each picture, the lens (10,), its model and its free parameters."""

    poses: Array
    lens: Array
    model: LensModel = "brown"
    free: tuple[str, ...] = ()

    def parameters(self, view: int) -> Array:
        """Camera parameters (16,) as seen from one picture's gauge."""
        return np.concatenate([self.poses[view], self.lens])

    @property
    def free_index(self) -> NDArray[np.int64]:
        """Which of the ten lens parameters are free."""
        return np.array([LENS_PARAMETERS.index(name) for name in self.free], dtype=np.int64)


@dataclass(frozen=True)
class Fit:
    """A solved bundle. residual_px: per view (n, 2). normal: (free + 6 n_views)² matrix.

    variance: of unit weight: 1 where the stated dot uncertainties are right. cost: robust sum of squares.
    """

    state: State
    cost: float
    residual_px: list[Array] = field(repr=False)
    whitened: list[Array] = field(repr=False)
    normal: Array = field(repr=False)
    variance: float = 1.0


def whiten(view: View, residual: Array) -> Array:
    """Residuals (n, 2, ...) in standard deviations, uncorrelated."""
    factor = np.linalg.cholesky(view.covariance_px2)
    flat = residual.reshape(len(residual), 2, -1)
    first = flat[:, 0] / factor[:, 0, 0, None]
    second = (flat[:, 1] - factor[:, 1, 0, None] * first) / factor[:, 1, 1, None]
    return np.stack([first, second], axis=1).reshape(residual.shape)


def solve(views: list[View], start: State, prior: Prior, *, discs: bool = True, steps: int = STEPS) -> Fit:
    """Minimise from a start; always returns the best state met, whose cost says how good it is.

    discs: predict the centre of the disc's imaged ellipse; without it the image of the centre (for rough starts).
    """
    state, damping = start, 1e-4
    scale = 1.0
    normal, gradient, cost, whitened, residual = _normal(views, state, prior, discs, scale)
    scale = robust_scale(whitened)
    normal, gradient, cost, whitened, residual = _normal(views, state, prior, discs, scale)
    for _ in range(steps):
        diagonal = np.maximum(np.diag(normal), 1e-12)
        root = 1 / np.sqrt(diagonal)
        step = root * np.linalg.solve(normal * root[:, None] * root + damping * np.eye(len(root)), root * gradient)
        trial = _moved(state, step)
        result = _normal(views, trial, prior, discs, scale)
        if result[2] < cost:
            small = float(step @ (normal @ step)) < 1e-10 * max(1.0, cost) or cost - result[2] < 1e-9 * cost
            state, damping = trial, max(damping * 0.1, 1e-12)
            normal, gradient, cost, whitened, residual = result
            if small:
                break
            fresh = robust_scale(whitened)
            if abs(np.log(fresh / scale)) > 0.1:
                scale = fresh
                normal, gradient, cost, whitened, residual = _normal(views, state, prior, discs, scale)
        else:
            damping = max(damping * 10, 1e-8)
            if damping > 1e8:
                break
    return Fit(state, cost * scale**2, residual, whitened, normal * scale**2, _variance(whitened, len(gradient)))


def robust_scale(whitened: list[Array]) -> float:
    """Standard deviation of whitened residuals from their median size (a Rayleigh median is 1.177)."""
    size = np.concatenate([np.hypot(r[:, 0], r[:, 1]) for r in whitened])
    size = size[np.isfinite(size)]
    return float(max(np.median(size) / 1.1774, 1e-3)) if len(size) else 1.0


def outliers(fit: Fit) -> list[NDArray[np.bool_]]:
    """Dots to keep, per view: those within OUTLIER robust standard deviations."""
    scale = robust_scale(fit.whitened)
    return [np.hypot(r[:, 0], r[:, 1]) < OUTLIER * scale for r in fit.whitened]


def _variance(whitened: list[Array], unknowns: int) -> float:
    count = sum(r.size for r in whitened)
    return float(sum(np.nansum(r**2) for r in whitened) / max(count - unknowns, 1))


def _moved(state: State, step: Array) -> State:
    lens = state.lens.copy()
    count = len(state.free)
    lens[state.free_index] += step[:count]
    lens[0] = max(lens[0], 0.3 * state.lens[0])  # a focal length stays positive, and a step bounded
    poses = state.poses + step[count:].reshape(-1, POSE_COUNT)
    return replace(state, lens=lens, poses=poses)


def _normal(
    views: list[View], state: State, prior: Prior, discs: bool, scale: float
) -> tuple[Array, Array, float, list[Array], list[Array]]:
    """Normal matrix, gradient (downhill), robust cost, whitened and plain residuals at a state."""
    free, count = state.free_index, len(state.free)
    size = count + POSE_COUNT * len(views)
    normal, gradient, cost = np.zeros((size, size)), np.zeros(size), 0.0
    whitened, residuals = [], []
    for k, view in enumerate(views):
        parameters = state.parameters(k)
        predicted, _, by_parameter = project(view.points_mm, parameters, state.model)
        if discs:
            predicted = fitted_centers(view.points_mm, view.radius_mm, parameters, state.model)
        residual = view.centers_px - predicted
        white = whiten(view, residual)
        if not np.isfinite(white).all():  # a dot behind the camera: no valid state
            return normal, gradient, np.inf, [], []
        size_ = np.hypot(white[:, 0], white[:, 1]) / scale
        weight = np.where(size_ > HUBER, HUBER / np.maximum(size_, HUBER), 1.0) / scale**2
        cost += float(np.where(size_ > HUBER, 2 * HUBER * size_ - HUBER**2, size_**2).sum())
        rows = whiten(view, by_parameter[:, :, np.concatenate([6 + free, np.arange(POSE_COUNT)])])
        weighted = rows * weight[:, None, None]
        block = np.einsum("nci,ncj->ij", weighted, rows, optimize=True)
        right = np.einsum("nci,nc->i", weighted, white, optimize=True)
        place = np.concatenate([np.arange(count), count + POSE_COUNT * k + np.arange(POSE_COUNT)])
        normal[np.ix_(place, place)] += block
        gradient[place] += right
        whitened.append(white)
        residuals.append(residual)
    difference = prior.mean[free] - state.lens[free]
    normal[np.arange(count), np.arange(count)] += prior.sigma[free] ** -2
    gradient[:count] += difference * prior.sigma[free] ** -2
    cost += float(((difference / prior.sigma[free]) ** 2).sum())
    if prior.distance_mm is not None:
        mean, sigma = prior.distance_mm
        value, slope = camera_height(state.poses[0])
        place = count + np.arange(POSE_COUNT)
        normal[np.ix_(place, place)] += np.outer(slope, slope) / sigma**2
        gradient[place] += slope * (mean - value) / sigma**2
        cost += ((mean - value) / sigma) ** 2
    return normal, gradient, cost, whitened, residuals


def camera_height(pose: Array) -> tuple[float, Array]:
    """Height of the lens above the plane z = 0 of a pose, mm, and its derivative by the pose (6,)."""

    def height(p: Array) -> float:
        import cv2

        return float(-(cv2.Rodrigues(np.ascontiguousarray(p[:3]))[0].T @ p[3:6])[2])

    step = 1e-6
    slope = [(height(pose + d) - height(pose - d)) / (2 * step) for d in step * np.eye(POSE_COUNT)]
    return height(pose), np.array(slope)


def fitted_only(views: list[View], state: State) -> list[Array]:
    """Whitened residuals (n, 2) per view at a state, nothing fitted."""
    whitened = []
    for k, view in enumerate(views):
        predicted = fitted_centers(view.points_mm, view.radius_mm, state.parameters(k), state.model)
        whitened.append(whiten(view, view.centers_px - predicted))
    return whitened
