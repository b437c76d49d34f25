"""Which lens terms the pictures ask for: cross-validation over dots held out, not habit.

Every dot is predicted once by a model fitted without it. Blocks of neighbouring places are held out together, so that a
term earns its place by predicting ground the fit has not seen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.bundle import Fit, Prior, View, fitted_only, robust_scale, solve
from calibration.lens import LensModel

Array = NDArray[np.float64]
FOLDS = 4
CENTER = ("principal_x_px", "principal_y_px")
# From plain to rich. All but the first free the principal point: fixing it would hide its uncertainty.
MODELS: tuple[tuple[LensModel, tuple[str, ...]], ...] = (
    ("brown", ("focal_px", *CENTER)),
    ("brown", ("focal_px", *CENTER, "k1")),
    ("brown", ("focal_px", *CENTER, "k1", "k2")),
    ("brown", ("focal_px", *CENTER, "k1", "k2", "k3")),
    ("brown", ("focal_px", *CENTER, "k1", "k2", "p1", "p2")),
    ("brown", ("focal_px", "aspect", *CENTER, "k1", "k2", "k3", "p1", "p2")),
    ("fisheye", ("focal_px", *CENTER)),
    ("fisheye", ("focal_px", *CENTER, "k1")),
    ("fisheye", ("focal_px", *CENTER, "k1", "k2")),
    ("fisheye", ("focal_px", "aspect", *CENTER, "k1", "k2", "k3", "k4")),
)


@dataclass(frozen=True)
class Trial:
    """One lens model on trial: its fit to all dots and the mean squared whitened error on dots held out."""

    model: LensModel
    free: tuple[str, ...]
    fit: Fit
    held_out: float


def choose_model(views: list[View], rough: list[Fit], prior: Prior) -> list[Trial]:
    """Trials of all lens models, best first."""
    trials: list[Trial] = []
    for model, free in MODELS:
        start = next((fit.state for fit in rough if fit.state.model == model), None)
        simpler = [trial for trial in trials if trial.model == model and set(trial.free) <= set(free)]
        if simpler:
            start = simpler[-1].fit.state
        if start is None:
            continue
        lens = start.lens.copy()
        if "k1" not in free:
            lens[4] = 0.0
        fit = solve(views, replace(start, lens=lens, free=free), prior)
        trials.append(Trial(model, free, fit, _held_out(views, fit, prior)))
    return sorted(trials, key=lambda trial: trial.held_out)


def _held_out(views: list[View], fit: Fit, prior: Prior) -> float:
    """Mean over dots of the squared held-out error, each capped as an outlier is."""
    if not np.isfinite(fit.cost) or not fit.whitened:
        return np.inf
    scale = robust_scale(fit.whitened)
    errors = []
    for fold in range(FOLDS):
        held = [_fold(view) == fold for view in views]
        if any((~part).sum() < 6 for part in held):
            continue
        trained = solve([view.take(~part) for view, part in zip(views, held, strict=True)], fit.state, prior, steps=8)
        tested = fitted_only([view.take(part) for view, part in zip(views, held, strict=True)], trained.state)
        errors += [np.minimum((part**2).sum(axis=1), (5 * scale) ** 2) for part in tested if len(part)]
    return float(np.mean(np.concatenate(errors))) if errors else np.inf


def _fold(view: View) -> NDArray[np.int64]:
    """Fold of each dot: blocks of about a sixth of the array's extent, dealt out in a pattern."""
    plane = view.points_mm[:, :2]
    span = np.maximum(np.ptp(plane, axis=0), 1e-9)
    block = np.minimum(((plane - plane.min(axis=0)) / span * 6).astype(np.int64), 5)
    return np.asarray((block[:, 0] + 2 * block[:, 1]) % FOLDS)
