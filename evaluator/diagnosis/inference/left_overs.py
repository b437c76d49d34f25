"""Residuals of the whitened features of each run for a fitted model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized
from evaluator.diagnosis.likelihood.point import Column

Floats = NDArray[np.float64]


def left_overs(views: Sequence[Linearized], columns: Sequence[Column], theta: Floats) -> tuple[Floats, Floats]:
    """Residual sums of squares of runs and their degrees of freedom, (n,), (n,), at common parameters theta (p,).

    Start pose, random effects and effects are free in every run, so that residuals they could explain do not count.
    Quantities known to a tolerance are common to the session and keep their fitted values.
    """
    effects = np.array([column.term is not None for column in columns], dtype=np.bool_)
    squares, freedom = np.zeros(len(views)), np.zeros(len(views))
    for number, view in enumerate(views):
        left = view.response - view.common @ theta
        taken = np.column_stack([view.start, view.scatter, view.common[:, effects]])
        basis = np.linalg.qr(taken[:, taken.any(axis=0)])[0]
        squares[number] = float(left @ left) - float(np.sum((basis.T @ left) ** 2))
        freedom[number] = max(len(left) - basis.shape[1], 1)
    return squares, freedom
