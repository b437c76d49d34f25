"""A Gaussian process on the discrepancy of velocities, as a function of command and state.

Source: Kennedy & O'Hagan (2001), J. R. Statist. Soc. B 63, 425; here modular: the nominal model stays as it is.
Which inputs count is chosen by predicting whole runs that were left out.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Kernel, WhiteKernel

from tests.benchmarks.discrepancy_peers.inputs import Floats, Inputs, gaps_mm
from tests.benchmarks.discrepancy_peers.velocities import Moment, corrected_path, pieces

EVERY = 2  # of the windows, which overlap by half: the rest are independent
LONGEST, SHORTEST = 1e3, 0.3  # length scales, of inputs of about 1
FOLDS = 5
# What a discrepancy may depend on, the first inputs of `state`: commands and time since the start; heading; place; run.
NESTED = (3, 5, 7, 8)


@dataclass(frozen=True)
class Process:
    """One component of the discrepancy as a function of the first inputs; none: it is zero."""

    inputs: int
    size: float
    fitted: GaussianProcessRegressor | None

    def __call__(self, at: Floats) -> Floats:
        """Mean (n,) at states (n, 8)."""
        return np.zeros(len(at)) if self.fitted is None else self.size * self.fitted.predict(at[:, : self.inputs])


def state(at: Moment) -> Floats:
    """Inputs (n, 8) of about 1: commands, time since the start, heading, place, number of the run."""
    return np.column_stack(
        [
            *(at.left_rpm / 30, at.right_rpm / 30, np.exp(-at.since_s / 0.3)),
            *(np.cos(at.heading_rad), np.sin(at.heading_rad), at.x_mm / 20, at.y_mm / 20, at.order / 10),
        ]
    )


def gaussian_process(inputs: Inputs, seed: int = 0) -> dict[str, object]:
    """Fit on the fitted runs; gaps. It has no names."""
    data = pieces(inputs, inputs.fitted, state)
    features, wanted, run = data.features[::EVERY], data.discrepancy[::EVERY], data.run[::EVERY]
    folds = np.array_split(np.random.default_rng(seed).permutation(np.unique(run)), FOLDS)
    processes = [_best(features, wanted[:, k], [np.isin(run, fold) for fold in folds]) for k in range(3)]

    def correction(at: Moment) -> Floats:
        here = state(at)
        return np.column_stack([process(here) for process in processes])

    gap = gaps_mm(inputs, lambda run, start: corrected_path(inputs, run, start, correction))
    return {"inputs": [process.inputs for process in processes], "gap": gap}


def _best(features: Floats, wanted: Floats, folds: list[Floats]) -> Process:
    """The process, of nested inputs, that predicts best the runs that were left out; or none."""
    size = float(np.sqrt(np.mean(wanted**2)))
    scores = {0: float(np.mean(wanted**2))}
    found = {0: Process(0, size, None)}
    for count in NESTED:
        kernel = ConstantKernel(0.5, (1e-4, 1e2)) * RBF(np.ones(count), (SHORTEST, LONGEST))
        kernel += WhiteKernel(0.5, (1e-6, 1e1))
        found[count] = Process(count, size, _fit(kernel, features[:, :count], wanted / size))
        scores[count] = 0.0
        for held in folds:
            left = GaussianProcessRegressor(found[count].fitted.kernel_, optimizer=None)
            left.fit(features[~held, :count], wanted[~held] / size)
            missed = left.predict(features[held, :count]) * size - wanted[held]
            scores[count] += float(missed @ missed) / len(wanted)
    return found[min(scores, key=lambda count: scores[count])]


def _fit(kernel: Kernel, features: Floats, wanted: Floats) -> GaussianProcessRegressor:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # length scales at their bounds: inputs without use
        return GaussianProcessRegressor(kernel).fit(features, wanted)
