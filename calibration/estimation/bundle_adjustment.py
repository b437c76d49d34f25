"""Weighted, robust least squares over one camera and the pose of the gauge in each image.

Levenberg-Marquardt on the normal equations with analytic derivatives. Weak priors from real lenses keep parameters that
the images do not determine at plausible values with wide uncertainties. Frames: that of the plate for the plate image,
that of the gauge for the others.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from calibration.camera import PARAMETERS, camera_height, image_points, project
from calibration.estimation.disc_projection import fitted_centers
from calibration.estimation.robust import HUBER, OUTLIER, huber_weights, robust_scale
from calibration.lens import LensModel

Array = NDArray[np.float64]
POSE_COUNT = 6  # a rotation vector and a translation
LENS_PARAMETERS = PARAMETERS[6:]
STEPS = 60  # most of a fit, which ends when its cost does not fall any more
DISC_ROUNDS = 4  # most solutions, which end when the discs' centres rest (DISC_REST_PX)
DISC_REST_PX = 1e-5  # a hundredth of the best centre's uncertainty


@dataclass(frozen=True)
class View:
    """Dots of one image: image points and the corresponding places of the gauge.

    centers_px: (n, 2). whitening: (n, 2, 2) lower triangles that convert a residual to standard deviations. points_mm:
    (n, 3) on the gauge where it is flat, z = its height. radius_mm: (n,). site: (n,) number of the place on the gauge.
    name: of the image, for messages. offset_px: (n, 2) from the image of a disc's centre to the centre of its image.
    terms: (n, k) values there of the terms of a face that is not flat (flatness.py).
    """

    centers_px: Array
    whitening: Array
    points_mm: Array
    radius_mm: Array
    site: NDArray[np.int64]
    offset_px: Array
    terms: Array
    name: str = ""

    def take(self, keep: NDArray[np.bool_]) -> View:
        """Some of the dots."""
        return replace(
            self,
            centers_px=self.centers_px[keep],
            whitening=self.whitening[keep],
            points_mm=self.points_mm[keep],
            radius_mm=self.radius_mm[keep],
            site=self.site[keep],
            offset_px=self.offset_px[keep],
            terms=self.terms[keep],
        )

    def __len__(self) -> int:
        """Count of dots."""
        return len(self.site)


def whitening(covariance_px2: Array) -> Array:
    """Inverse Cholesky factors (n, 2, 2) of covariances (n, 2, 2)."""
    factor = np.linalg.cholesky(covariance_px2)
    inverse = np.zeros_like(factor)
    inverse[:, 0, 0], inverse[:, 1, 1] = 1 / factor[:, 0, 0], 1 / factor[:, 1, 1]
    inverse[:, 1, 0] = -factor[:, 1, 0] * inverse[:, 0, 0] * inverse[:, 1, 1]
    return inverse


@dataclass(frozen=True)
class Prior:
    """Independent normal priors on lens parameters, mean and sigma (10,), and optionally on the camera's distance.

    The prior on the focal length is on its logarithm, with sigma[0] / mean[0]. shortest_px: lower limit of the focal
    length; with a flat model, a bent gauge seen from above would drive it to 0. face_mm: sigma of each coefficient of
    the gauge's face, with mean 0 (flat).
    """

    mean: Array
    sigma: Array
    shortest_px: float = 0.0
    face_mm: float = 1.0
    distance_mm: tuple[float, float] | None = None  # of the lens from the plate along its normal, with sigma


@dataclass(frozen=True)
class State:
    """Pose (n_views, 6) of the gauge in each image, the lens (10,), its model and its free parameters.

    face_mm: (k,) free coefficients of the gauge's face, of the first k terms; empty if it is assumed to be flat.
    """

    poses: Array
    lens: Array
    model: LensModel = "brown"
    free: tuple[str, ...] = ()
    face_mm: Array = field(default_factory=lambda: np.zeros(0))

    def parameters(self, view: int) -> Array:
        """Camera parameters (16,) with the pose of one image's gauge."""
        return np.concatenate([self.poses[view], self.lens])

    @property
    def free_index(self) -> NDArray[np.int64]:
        """Which of the ten lens parameters are free."""
        return np.array([LENS_PARAMETERS.index(name) for name in self.free], dtype=np.int64)

    @property
    def shared(self) -> int:
        """Number of unknowns common to all images; they precede the poses."""
        return len(self.free) + len(self.face_mm)


@dataclass(frozen=True)
class Fit:
    """A solved bundle. residual_px: per view (n, 2). normal: (shared + 6 n_views)² matrix.

    variance: of unit weight, 1 if the stated dot uncertainties are right. cost: robust sum of squares. scale: of the
    residuals in huber_weights, which the normal matrix includes.
    """

    state: State
    cost: float
    residual_px: list[Array] = field(repr=False)
    whitened: list[Array] = field(repr=False)
    normal: Array = field(repr=False)
    variance: float = 1.0
    scale: float = 1.0


def solve_discs(views: list[View], start: State, prior: Prior) -> tuple[Fit, list[View]]:
    """Solve repeatedly with updated offsets of the discs' centres until these converge; returns the views with them."""
    fit: Fit | None = None
    for _ in range(DISC_ROUNDS):
        state = start if fit is None else fit.state
        fresh = with_disc_offsets(views, state)
        change = max(float(np.abs(new.offset_px - old.offset_px).max()) for new, old in zip(fresh, views, strict=True))
        if fit is not None and change < DISC_REST_PX:
            break
        views = fresh
        fit = solve(views, state, prior)
    assert fit is not None
    return fit, views


def points_of(view: View, state: State) -> Array:
    """Positions of a view's dots on the gauge (n, 3), mm, with the face of a state."""
    raised = view.terms[:, : len(state.face_mm)] @ state.face_mm
    return view.points_mm + raised[:, None] * [0.0, 0.0, 1.0]


def with_disc_offsets(views: list[View], state: State) -> list[View]:
    """The views with the disc offsets at a state; they vary slowly, so that a solve may keep them fixed."""
    renewed = []
    for k, view in enumerate(views):
        parameters = state.parameters(k)
        points = points_of(view, state)
        center = image_points(points, parameters, state.model)
        offset = fitted_centers(points, view.radius_mm, parameters, state.model) - center
        renewed.append(replace(view, offset_px=np.where(np.isfinite(offset), offset, 0.0)))
    return renewed


def solve(views: list[View], start: State, prior: Prior, *, steps: int = STEPS) -> Fit:
    """Minimise from a start; always returns the best state found, with its cost."""
    state, damping = start, 1e-4
    now = _normal(views, state, prior, 1.0)
    scale = robust_scale(now.whitened)
    now = _weighted(now.rows, state, prior, scale)
    for _ in range(steps):
        root = 1 / np.sqrt(np.maximum(np.diag(now.matrix), 1e-12))
        damped = now.matrix * root[:, None] * root + damping * np.eye(len(root))
        step = root * np.linalg.solve(damped, root * now.gradient)
        trial = _moved(state, step)
        then = _normal(views, trial, prior, scale)
        if then.cost < now.cost:
            rests = now.cost - then.cost < 1e-9 * now.cost
            state, now, damping = trial, then, max(damping * 0.1, 1e-12)
            if rests:
                break
            fresh = robust_scale(now.whitened)
            if abs(np.log(fresh / scale)) > 0.1:
                scale = fresh
                now = _weighted(now.rows, state, prior, scale)
        else:
            # no improvement within 0.001 of the step's uncertainty: converged
            if float(step @ now.matrix @ step) < 1e-6:
                break
            damping = max(damping * 10, 1e-8)
            if damping > 1e8:
                break
    variance = _variance(now.whitened, len(now.gradient))
    return Fit(state, now.cost * scale**2, now.residual, now.whitened, now.matrix * scale**2, variance, scale)


def outliers(fit: Fit) -> list[NDArray[np.bool_]]:
    """Dots to keep, per view: those within OUTLIER robust standard deviations, or of their own uncertainty.

    Where glare or defocus makes most dots of an image uncertain, their residuals are often smaller than stated. The
    scale is then below 1, and falls with every round: good dots of other images are beyond it, but not wrong.
    """
    scale = max(robust_scale(fit.whitened), 1.0)
    return [np.hypot(r[:, 0], r[:, 1]) < OUTLIER * scale for r in fit.whitened]


def _variance(whitened: list[Array], unknowns: int) -> float:
    count = sum(r.size for r in whitened)
    return float(sum(np.nansum(r**2) for r in whitened) / max(count - unknowns, 1))


def _moved(state: State, step: Array) -> State:
    lens = state.lens.copy()
    count = len(state.free)
    lens[state.free_index] += step[:count]
    lens[0] = max(lens[0], 0.3 * state.lens[0])  # a focal length stays positive, and a step bounded
    poses = state.poses + step[state.shared :].reshape(-1, POSE_COUNT)
    return replace(state, lens=lens, poses=poses, face_mm=state.face_mm + step[count : state.shared])


Rows = tuple[Array, Array, Array]


@dataclass(frozen=True)
class _Normal:
    """Normal matrix, downhill gradient and robust cost at a state; rows: `view_rows` of every view, none if invalid."""

    matrix: Array
    gradient: Array
    cost: float
    rows: list[Rows]

    @property
    def residual(self) -> list[Array]:
        """Plain residuals of every view."""
        return [residual for residual, _, _ in self.rows]

    @property
    def whitened(self) -> list[Array]:
        """Whitened residuals of every view."""
        return [white for _, white, _ in self.rows]


def view_rows(view: View, state: State, k: int) -> Rows:
    """Plain (n, 2) and whitened (n, 2) residuals and whitened derivatives (n, 2, shared + 6) of one view."""
    predicted, by_point, by_parameter = project(points_of(view, state), state.parameters(k), state.model)
    residual = view.centers_px - view.offset_px - predicted
    by_face = by_point[:, :, 2:] * view.terms[:, None, : len(state.face_mm)]
    by_unknown = [by_parameter[:, :, POSE_COUNT + state.free_index], by_face, by_parameter[:, :, :POSE_COUNT]]
    rows = view.whitening @ np.concatenate(by_unknown, axis=2)
    return residual, (view.whitening @ residual[..., None])[..., 0], rows


def places_of_view(state: State, k: int) -> NDArray[np.int64]:
    """Indices of the columns of `view_rows` in the normal matrix."""
    return np.concatenate([np.arange(state.shared), state.shared + POSE_COUNT * k + np.arange(POSE_COUNT)])


def _normal(views: list[View], state: State, prior: Prior, scale: float) -> _Normal:
    """The normal equations of residuals with a scale; of infinite cost at a state that is not valid."""
    rows: list[Rows] = []
    if state.lens[0] >= prior.shortest_px:
        for k, view in enumerate(views):
            rows.append(view_rows(view, state, k))
            if not np.isfinite(rows[-1][1]).all():  # a dot behind the camera
                break
        else:
            return _weighted(rows, state, prior, scale)
    size = state.shared + POSE_COUNT * len(views)
    return _Normal(np.zeros((size, size)), np.zeros(size), np.inf, [])


def _weighted(rows: list[Rows], state: State, prior: Prior, scale: float) -> _Normal:
    """The normal equations of the rows of all views with a scale of their residuals."""
    size = state.shared + POSE_COUNT * len(rows)
    matrix, gradient, cost = np.zeros((size, size)), np.zeros(size), 0.0
    for k, (_, white, by_unknown) in enumerate(rows):
        size_ = np.hypot(white[:, 0], white[:, 1]) / scale
        far = size_ > HUBER
        weight = huber_weights(white, scale) / scale**2
        cost += float(np.where(far, 2 * HUBER * size_ - HUBER**2, size_**2).sum())
        place = places_of_view(state, k)
        flat = by_unknown.reshape(-1, len(place))
        weighted = (by_unknown * weight[:, None, None]).reshape(-1, len(place))
        matrix[np.ix_(place, place)] += weighted.T @ flat
        gradient[place] += weighted.T @ white.ravel()
    cost += add_prior(matrix, gradient, state, prior)
    return _Normal(matrix, gradient, cost, rows)


def add_prior(matrix: Array, gradient: Array, state: State, prior: Prior) -> float:
    """Add the priors to a normal matrix (n, n) and gradient (n,) in place; returns their cost."""
    free, count = state.free_index, len(state.free)
    difference, weight = prior.mean[free] - state.lens[free], prior.sigma[free] ** -2
    focal = free == 0
    ratio = state.lens[0] / prior.mean[0]
    difference[focal], weight[focal] = -state.lens[0] * np.log(ratio), weight[focal] / ratio**2
    matrix[np.arange(count), np.arange(count)] += weight
    gradient[:count] += difference * weight
    cost = float((difference**2 * weight).sum())
    face = np.arange(count, state.shared)
    matrix[face, face] += prior.face_mm**-2
    gradient[face] -= state.face_mm / prior.face_mm**2
    cost += float((state.face_mm**2).sum()) / prior.face_mm**2
    if prior.distance_mm is not None:
        mean, sigma = prior.distance_mm
        value, slope = camera_height(state.poses[0])
        place = state.shared + np.arange(POSE_COUNT)
        matrix[np.ix_(place, place)] += np.outer(slope, slope) / sigma**2
        gradient[place] += slope * (mean - value) / sigma**2
        cost += ((mean - value) / sigma) ** 2
    return cost
