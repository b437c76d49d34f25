"""Selection of lens and flatness terms by cross-validation over held-out dots.

Every dot is predicted once by a model fitted without it. Blocks of neighbouring places are held out together, so that a
term is accepted only if it predicts regions that the fit has not seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.estimation.bundle_adjustment import (
    Fit,
    Prior,
    View,
    places_of_view,
    solve,
    view_rows,
)
from calibration.estimation.robust import OUTLIER, robust_scale
from calibration.lens import LensModel

Array = NDArray[np.float64]
FOLDS = 4  # neighbouring blocks, along rows, columns and diagonals, are in different ones (_fold)
ENOUGH = 2000  # dots over all images
CENTER = ("principal_x_px", "principal_y_px")
# Lens models from simple to complex. The principal point is always free, because fixing it would hide its uncertainty.
# A fisheye has at least two terms; with fewer, the assumed curve of the lens would determine the focal length even in
# images without perspective.
MODELS: tuple[tuple[LensModel, tuple[str, ...]], ...] = (
    ("brown", ("focal_px", *CENTER)),
    ("brown", ("focal_px", *CENTER, "k1")),
    ("brown", ("focal_px", *CENTER, "k1", "k2")),
    ("brown", ("focal_px", *CENTER, "k1", "k2", "k3")),
    ("brown", ("focal_px", *CENTER, "k1", "k2", "p1", "p2")),
    ("brown", ("focal_px", "aspect", *CENTER, "k1", "k2", "k3", "p1", "p2")),
    ("fisheye", ("focal_px", *CENTER, "k1", "k2")),
    ("fisheye", ("focal_px", *CENTER, "k1", "k2", "k3")),
    ("fisheye", ("focal_px", "aspect", *CENTER, "k1", "k2", "k3", "k4")),
)


@dataclass(frozen=True)
class Trial:
    """A candidate model: its fit to all dots, and the mean squared whitened error of held-out dots.

    face: number of free terms of the gauge's face.
    """

    model: LensModel
    free: tuple[str, ...]
    fit: Fit
    held_out: float
    face: int = 0


def choose_model(views: list[View], rough: list[Fit], prior: Prior, faces: tuple[int, ...] = (0,)) -> list[Trial]:
    """Trials of all models: first the simplest of those that predict as well as the best.

    faces: numbers of free terms of the gauge's face to try. Those after the first are tried only if the next one
    predicts better than the best lens without it: most gauges are flat.
    """
    views = [view.take(_every(view, views)) for view in views]
    trials = _trials(views, rough, prior, faces[0])
    if len(faces) > 1:
        best = min(trials, key=lambda trial: trial.held_out)
        bent = _trials(views, [best.fit], prior, faces[1], ((best.model, best.free),))
        if bent[0].held_out < best.held_out - chance(best, views):
            for face in faces[1:]:
                trials += _trials(views, rough, prior, face)
    near = _near(trials, views)
    good = [trial for trial in trials if trial.held_out <= near]
    rest = [trial for trial in trials if trial.held_out > near]
    # if equal, prefer the lens model whose form does not constrain the focal length
    good.sort(key=lambda trial: (trial.model == "fisheye", len(trial.free) + trial.face))
    return good + sorted(rest, key=lambda trial: trial.held_out)


def _trials(
    views: list[View],
    rough: list[Fit],
    prior: Prior,
    face: int,
    models: tuple[tuple[LensModel, tuple[str, ...]], ...] = MODELS,
) -> list[Trial]:
    """Trials of lens models with `face` free terms of the gauge's face, each started from the previous one."""
    trials: list[Trial] = []
    for model, free in models:
        start = next((fit.state for fit in rough if fit.state.model == model), None)
        simpler = [trial for trial in trials if trial.model == model and set(trial.free) <= set(free)]
        if simpler:
            start = simpler[-1].fit.state
        if start is None:
            continue
        lens = start.lens.copy()
        if "k1" not in free:
            lens[4] = 0.0
        bent = start.face_mm if len(start.face_mm) == face else np.zeros(face)
        fit = solve(views, replace(start, lens=lens, free=free, face_mm=bent), prior)
        trials.append(Trial(model, free, fit, _held_out(views, fit), face))
    return trials


def _every(view: View, views: list[View]) -> NDArray[np.bool_]:
    """Mask that thins dense arrays to ENOUGH dots, which decide as well as thousands and faster."""
    step = max(1, sum(len(other) for other in views) // ENOUGH)
    return np.asarray(np.arange(len(view)) % step == 0)


def _near(trials: list[Trial], views: list[View]) -> float:
    """Held-out error that counts as equal to the best: a term must gain more than by chance (two σ²)."""
    best = min(trials, key=lambda trial: trial.held_out)
    return best.held_out + chance(best, views)


def focal_of_lens_models(trials: Sequence[Trial], views: list[View]) -> float:
    """Relative uncertainty of the focal length that the choice of the lens model adds to that of the chosen one.

    trials: the chosen one first. From images without tilt, the form of a lens model determines the focal length: a
    fisheye knew it to 0.2 %, where a lens with tangential terms, which predicts as well but for 1.9 times chance, knows
    it to 3.5 %. Models count whose further terms may by chance predict as much worse.
    """
    chosen, by_chance = trials[0], chance(trials[0], views)
    focal, variance = chosen.fit.state.lens[0], _focal_variance(chosen)
    more = 0.0
    for trial in trials[1:]:
        if trial.face == chosen.face and trial.held_out < chosen.held_out + len(trial.free) * by_chance:
            more = max(more, (trial.fit.state.lens[0] - focal) ** 2 + _focal_variance(trial) - variance)
    return float(np.sqrt(more) / focal)


def _focal_variance(trial: Trial) -> float:
    """Variance of a fitted focal length, the first of the free parameters, px²."""
    unit = np.zeros(len(trial.fit.normal))
    unit[0] = 1.0
    return float(max(trial.fit.variance, 1.0) * np.linalg.lstsq(trial.fit.normal, unit, rcond=None)[0][0])


def chance(best: Trial, views: list[View]) -> float:
    """Gain of an unnecessary term by chance."""
    return 2 * best.fit.variance / max(sum(len(view) for view in views), 1)


def _held_out(views: list[View], fit: Fit) -> float:
    """Mean over dots of the squared held-out error, each capped as an outlier is.

    Near the minimum the problem is linear, and the fit without a fold lies one Newton step away: with the fold's rows
    A and residuals r, (N - AᵀA)⁻¹ Aᵀ r. No fold is fitted again.
    """
    if not np.isfinite(fit.cost) or not fit.whitened:
        return np.inf
    cap = (OUTLIER * robust_scale(fit.whitened)) ** 2
    size = len(fit.normal)
    rows = [view_rows(view, fit.state, k)[1:] for k, view in enumerate(views)]
    folds = [_fold(view) for view in views]
    errors = []
    for fold in range(FOLDS):
        without, right = fit.normal.copy(), np.zeros(size)
        for k, ((white, by), of) in enumerate(zip(rows, folds, strict=True)):
            place = places_of_view(fit.state, k)
            sound = (of == fold) & ((white**2).sum(axis=1) < cap)
            block = by[sound].reshape(-1, len(place))
            without[np.ix_(place, place)] -= block.T @ block
            right[place] += block.T @ white[sound].ravel()
        root = 1 / np.sqrt(np.maximum(np.diag(without), 1e-12))
        step = root * np.linalg.lstsq(without * root[:, None] * root, root * right, rcond=1e-12)[0]
        for k, ((white, by), of) in enumerate(zip(rows, folds, strict=True)):
            held = of == fold
            error = white[held] + by[held] @ step[places_of_view(fit.state, k)]
            errors.append(np.minimum((error**2).sum(axis=1), cap))
    return float(np.mean(np.concatenate(errors)))


def _fold(view: View) -> NDArray[np.int64]:
    """Fold of each dot: blocks of about a sixth of the array's extent, dealt out in a pattern."""
    plane = view.points_mm[:, :2]
    span = np.maximum(np.ptp(plane, axis=0), 1e-9)
    block = np.minimum(((plane - plane.min(axis=0)) / span * 6).astype(np.int64), 5)
    return np.asarray((block[:, 0] + 2 * block[:, 1]) % FOLDS)
