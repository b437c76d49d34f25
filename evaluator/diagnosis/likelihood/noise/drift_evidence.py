"""Log evidence of all runs with a common drift and varying friction, for many sizes of both.

Every size asks only for inner products of the features: those weighted by the variances of a random drift are formed
once, and a creep, the friction of the plate and late changes of commands are random parts U of few columns, so that
(D + U·Uᵀ)⁻¹ needs a matrix of their number. All runs are reckoned together.
Source: Hager (1989), SIAM Review 31, 221 (Woodbury's identity).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.linear.mixed_model import FLAT, Linearized, MixedModel, of_inner_products
from evaluator.diagnosis.likelihood.noise.tracking import Drift

Floats = NDArray[np.float64]

# Channels that drift, the first ones: both coordinates of the midpoint of the marks; of a pose, the heading as well.
OF_MARKS, OF_POSES = 2, 3


@dataclass(frozen=True)
class RunInModes:
    """One run in features with independent drift and unit variance of the noise without drift.

    view: its linearization. wanders: (k,), variances that a random drift of 1 mm adds to the features of each
    channel that drifts, the first ones. creeps: (k,), changes by a creep of 1 mm/s. friction: (d, m), changes of all
    features by each mode of a friction with a random walk of 1 per 1 mm. late: (d, c), changes by one sigma of each
    late change.
    """

    view: Linearized
    wanders: Floats
    creeps: Floats
    friction: Floats
    late: Floats


class RunsInModes:
    """Runs with the same correlation time of a random drift."""

    def __init__(self, runs: Sequence[RunInModes], axes: int = OF_MARKS) -> None:
        """Pad all runs to one shape with features and random parts that are zero; axes: channels that drift."""
        self._axes = axes
        self._sizes = np.array([len(run.view.response) - FLAT for run in runs])
        widths = [max((getattr(run, part).shape[1] for run in runs), default=0) for part in ("friction", "late")]
        self._random = [axes, *widths]
        columns = [_columns(run, widths, axes) for run in runs]
        count = columns[0].shape[1] if runs else 0
        self._model = count - sum(self._random)
        modes = max((len(run.wanders) for run in runs), default=0)
        self._wanders = np.zeros((len(runs), modes))
        self._middle = np.zeros((len(runs), axes, modes, count))
        self._rest = np.zeros((len(runs), count, count))
        for number, (run, every) in enumerate(zip(runs, columns, strict=True)):
            own = len(run.wanders)
            middle, rest = every[: axes * own], every[axes * own :]
            self._wanders[number, :own] = run.wanders
            self._middle[number, :, :own] = middle.reshape(axes, own, count)
            self._rest[number] = rest.T @ rest
        self._weighted: dict[float, tuple[Floats, float]] = {}

    def weighted(self, size_mm: float) -> tuple[Floats, float]:
        """Inner products (n, m, m) of all columns with a random drift of this size; log determinant of its variance."""
        if size_mm not in self._weighted:
            variance = 1 + size_mm**2 * self._wanders
            scaled = self._middle / np.sqrt(variance)[:, None, :, None]
            scaled = scaled.reshape(len(scaled), self._axes * scaled.shape[2], scaled.shape[3])
            inner = self._rest + np.matmul(scaled.transpose(0, 2, 1), scaled)
            self._weighted[size_mm] = inner, self._axes * float(np.log(variance).sum())
        return self._weighted[size_mm]

    def log_evidence(self, drift: Drift, walk: float, prior_precision: Floats) -> float:
        """Log evidence of the runs with a drift and a random walk of friction (change over 1 mm), start poses free."""
        inner, log_det = self.weighted(drift.size_mm)
        sizes = np.repeat([drift.creep_mm_s, walk, 1.0], self._random)
        random = inner[:, self._model :] * sizes[:, None]  # (n, r, m)
        own = np.eye(len(sizes)) + random[:, :, self._model :] * sizes
        inner = _without(inner[:, : self._model, : self._model], random[:, :, : self._model], own)
        start, beside = inner[:, :FLAT, :FLAT], inner[:, :FLAT, FLAT:]
        left = _without(inner[:, FLAT:, FLAT:], beside, start)
        log_det += float(np.linalg.slogdet(own)[1].sum() + np.linalg.slogdet(start)[1].sum())
        model = MixedModel(of_inner_products(left, self._sizes), prior_precision)
        return model.log_evidence(range(len(prior_precision))) - log_det / 2


def _columns(run: RunInModes, widths: Sequence[int], axes: int) -> Floats:
    """Columns (d, m) of a run: start pose, response, common parameters, scatter, then the random parts.

    widths: numbers of columns of friction and of late changes, for which those of the run are filled up with zeros.
    """
    view, count = run.view, len(run.wanders)
    creeps = np.zeros((len(view.response), axes))
    for axis in range(axes):
        creeps[axis * count : (axis + 1) * count, axis] = run.creeps
    filled = [
        np.pad(part, ((0, 0), (0, width - part.shape[1])))
        for part, width in zip((run.friction, run.late), widths, strict=True)
    ]
    return np.column_stack([view.start, view.response, view.common, view.scatter, creeps, *filled])


def _without(inner: Floats, beside: Floats, of: Floats) -> Floats:
    """Inner products (n, m, m) without columns; of (n, r, r): their own, beside (n, r, m): of these with the others."""
    return np.asarray(inner - np.matmul(beside.transpose(0, 2, 1), np.linalg.solve(of, beside)))
