"""SINDy on the discrepancy of velocities: weak form, ensemble, sequentially thresholded least squares (PySINDy).

The threshold is chosen by cross-validation over whole runs in favour of fewer terms, the empty model among the
choices. A name is the effect whose own discrepancy, simulated before anything measured is looked at and written in
the same library, is nearest to what was found.
Sources: Kaheman et al. (2019), arXiv:1909.08574 (discrepancy models); Fasel et al. (2022), Proc. R. Soc. A 478
(ensemble); Brunton & Kutz, PySINDy.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pysindy.optimizers import STLSQ, EnsembleOptimizer

from simulator.effects.coordinates import Candidate
from tests.benchmarks.discrepancy_peers.inputs import Floats, Inputs, gaps_mm
from tests.benchmarks.discrepancy_peers.velocities import Moment, Pieces, corrected_path, pieces, signatures, windows

# Settings: fixed on other experiments, before the bank was drawn.
THRESHOLDS = (0.03, 0.06, 0.12, 0.25, 0.5)  # of the RMS of the discrepancy, for terms of unit RMS
RIDGE = 1e-3
MODELS = 30
FOLDS = 5
ERRORS = 2.0  # standard errors of the folds by which fewer terms may predict worse
NEAR = 0.5  # share of what was found that an effect must explain to be named
SECOND = 0.2  # and what a second one must add
EACH = 0.02  # taken off for each further coordinate
LENGTH_MM, FAST_MM_S, START_S = 20.0, 2.0, 0.1  # of the plate, of speeds, of a start


@dataclass(frozen=True)
class Found:
    """Coefficients (p, 3) of the library, in mm/s."""

    coefficients: Floats

    def correction(self, at: Moment) -> Floats:
        """What is added to the nominal velocities."""
        return library(at) @ self.coefficients


def library(at: Moment) -> Floats:
    """Terms (n, p): what kinematics, forces fixed in body or plate, places, starts and wheel angles suggest."""
    c, s = np.cos(at.heading_rad), np.sin(at.heading_rad)
    x, y = at.x_mm / LENGTH_MM, at.y_mm / LENGTH_MM
    left, right = at.left_rpm / 30, at.right_rpm / 30
    moves = ((at.left_rpm != 0) | (at.right_rpm != 0)).astype(float)
    sense = np.sign(at.left_rpm + at.right_rpm)
    side = np.sign(at.yaw) * (np.abs(at.yaw) > 1e-3)
    u, v, w = at.along / FAST_MM_S, at.sideways / FAST_MM_S, at.yaw
    begin = np.exp(-at.since_s / START_S)
    terms = [
        *(moves, sense, side, u, v, w, u * np.abs(u), w * np.abs(w), u * w, u * u, w * w),
        *(left - right, np.abs(left - right), np.abs(u), np.abs(w), at.order / 10 * u, at.order / 10 * w),
        *(c * moves, s * moves, (x * c + y * s) * moves, (y * c - x * s) * moves, c * w, s * w),
        *(x * u, y * u, x * w, y * w, np.cos(2 * at.heading_rad) * w, np.sin(2 * at.heading_rad) * w),
        *(begin * u, begin * w, u * np.sin(at.turns), u * np.cos(at.turns), w * np.sin(at.turns), w * np.cos(at.turns)),
    ]
    return np.column_stack(terms)


def sindy(inputs: Inputs, seed: int = 0) -> dict[str, object]:
    """Fit on the fitted runs, name, gaps."""
    data = pieces(inputs, inputs.fitted, library)
    scale = np.sqrt(np.mean(data.features**2, axis=0)) + 1e-12
    rng = np.random.default_rng(seed)
    loud = _loudness(data)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of thresholds that leave no term
        columns = [
            _fitted(data.features / scale / loud[:, [k]], data.discrepancy[:, k] / loud[:, k], data.run, rng) / scale
            for k in range(3)
        ]
    coefficients = np.column_stack(columns)
    found = Found(coefficients)
    named = _named(inputs, found) if coefficients.any() else []
    gaps = gaps_mm(inputs, lambda run, start: corrected_path(inputs, run, start, found.correction))
    said = {"terms": int(np.count_nonzero(coefficients)), "alarm": bool(coefficients.any())}
    return {**said, "named": named, "gap": gaps}


def _loudness(data: Pieces) -> Floats:
    """RMS discrepancy (n, 3) of the run of each window beside the median run: fast runs leave more and count less."""
    runs = np.unique(data.run)
    rms = np.array([np.sqrt(np.mean(data.discrepancy[data.run == run] ** 2, axis=0)) for run in runs])
    relative = np.maximum(rms / np.median(rms, axis=0), 1e-3)
    return np.asarray(relative[np.searchsorted(runs, data.run)])


def _fitted(terms: Floats, wanted: Floats, run: Floats, rng: np.random.Generator) -> Floats:
    """Coefficients of one equation: zero where no term helps runs that were not fitted."""
    size = float(np.sqrt(np.mean(wanted**2)))
    folds = np.array_split(rng.permutation(np.unique(run)), FOLDS)
    errors = {
        threshold: [
            float(np.mean((wanted[held] - _predicted(terms, wanted / size, held, threshold) * size) ** 2))
            for held in (np.isin(run, fold) for fold in folds)
        ]
        for threshold in (*THRESHOLDS, np.inf)
    }
    best = min(errors, key=lambda t: np.mean(errors[t]))
    worse = {threshold: np.subtract(error, errors[best]) for threshold, error in errors.items()}
    chosen = max(t for t, more in worse.items() if np.mean(more) <= ERRORS * np.std(more, ddof=1) / np.sqrt(FOLDS))
    if np.isinf(chosen):
        return np.zeros(terms.shape[1])
    np.random.seed(int(rng.integers(2**31)))  # noqa: NPY002 - PySINDy draws its bags from the global generator
    ensemble = EnsembleOptimizer(STLSQ(threshold=chosen, alpha=RIDGE), bagging=True, n_models=MODELS)
    ensemble.fit(terms, (wanted / size)[:, None])
    coefficients = np.asarray(ensemble.coef_)[0]  # medians of the bags
    return np.where(np.abs(coefficients) >= chosen, coefficients, 0.0) * size


def _predicted(terms: Floats, wanted: Floats, held: Floats, threshold: float) -> Floats:
    if np.isinf(threshold):
        return np.zeros(int(held.sum()))
    fit = STLSQ(threshold=threshold, alpha=RIDGE)
    fit.fit(terms[~held], wanted[~held][:, None])
    return np.asarray(terms[held] @ fit.coef_[0])


def _named(inputs: Inputs, found: Found) -> list[str]:
    """Effects nearest to what was found, at most two, the nearest first; empty where none is near."""
    parts = [windows(inputs, run, inputs.simulated(run), library)[0] for run in inputs.fitted]
    said = (np.concatenate(parts) @ found.coefficients).ravel()
    basis = {
        label: part.reshape(len(said), -1)
        for label, part in signatures(inputs, inputs.fitted, library, offers(inputs.terms)).items()
        if np.isfinite(part).all()
    }
    chosen: list[str] = []
    taken, explained = np.zeros((len(said), 0)), 0.0
    for least in (NEAR, SECOND):
        scores = {label: _share(said, np.column_stack([taken, part])) for label, part in basis.items()}
        label = max(scores, key=lambda key: scores[key], default="")
        if not label or scores[label] - explained < least:
            break
        effect, explained = label.split(" ")[0], scores[label]
        chosen.append(effect)
        taken = np.column_stack([taken, basis[label]])
        basis = {key: part for key, part in basis.items() if key.split(" ")[0] != effect}
    return chosen


def _share(said: Floats, columns: Floats) -> float:
    """Share of the squares of what was said that columns explain, less EACH for every column but the first."""
    left = said - columns @ np.linalg.lstsq(columns, said, rcond=None)[0]
    return 1 - float(left @ left) / float(said @ said) - EACH * (columns.shape[1] - 1)


def offers(terms: Mapping[str, Candidate]) -> dict[str, Sequence[tuple[float, ...]]]:
    """Small effects of each kind, by "effect" or "effect number of its starting place": one for each coordinate."""
    found: dict[str, Sequence[tuple[float, ...]]] = {}
    for effect, term in terms.items():
        if term.starts:
            found |= {f"{effect} {k}": [_stepped(term, start, 0)] for k, start in enumerate(term.starts)}
        else:
            found[effect] = [_stepped(term, term.absent, k) for k in range(term.size)]
    return found


def _stepped(term: Candidate, values: tuple[float, ...], k: int) -> tuple[float, ...]:
    moved = list(values)
    if not term.stepwise:
        moved[k] += term.coordinates[k].step
    return tuple(moved)
