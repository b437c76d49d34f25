"""Derivatives of runs near a discontinuity of the model, where a tiny change of a parameter gives another motion.

A robot that turns on the spot continues along one of two branches. Close to the bifurcation, the finite difference for
a derivative contains the jump between both branches; divided by a small step, it dominates all information of the runs
about the parameter. Such a difference is replaced by that to the other side, where the motion is on the same branch; if
both sides jump, the derivative of the run is set to 0.
Source: one-sided differences at shocks, van Leer (1979), J. Comput. Phys. 32, 101.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized

Floats = NDArray[np.float64]

# Of the features of one run, in sigmas. On ground a step of a derivative, a fifth of a visible change or less, moves
# them by hundredths (of 24 runs of a Husky by 0.00 to 0.05), jumps by five to sixteen.
JUMP = 1.0


def jumps(slopes: Floats, steps: Floats) -> list[int]:
    """Columns of the derivatives (k, p) of a run's features that contain a jump over their steps (p,)."""
    return [int(i) for i in np.flatnonzero(np.linalg.norm(slopes * steps, axis=0) > JUMP)]


def smooth_slope(here: Floats, behind: Floats, step: float) -> Floats:
    """Backward difference (k,) of features; 0 if they jump there too, or are not known."""
    slope = (behind - here) / step
    if not np.isfinite(slope).all() or jumps(slope[:, None], np.array([step])):
        return np.zeros_like(here)
    return np.asarray(slope)


def with_slopes(
    views: Sequence[Linearized | None], slopes: Mapping[tuple[int, int], Floats], theta: Floats
) -> list[Linearized | None]:
    """Linearizations of runs with some derivatives (k,) replaced, by run and common parameter, at theta (p,)."""
    found = list(views)
    for (number, i), slope in slopes.items():
        view = found[number]
        assert view is not None
        common = view.common.copy()
        common[:, i] = slope
        found[number] = replace(view, common=common, response=view.response + (common - view.common) @ theta)
    return found
