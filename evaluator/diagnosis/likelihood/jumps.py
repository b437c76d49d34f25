"""Derivatives of runs near a discontinuity of the model, where a tiny change of a parameter gives another motion.

A robot that turns about on the spot goes on along one of two ways. Next to the point where they part, a difference over
the step of a derivative holds the jump from one way to the other: divided by so short a step it outweighs all that the
runs say of the parameter. Such a difference is replaced by that to the other side, where the motion is the same; where
both sides jump, the run says nothing of the parameter.
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
    """Which slopes (k, p) of the features of a run hold a jump over their steps (p,)."""
    return [int(i) for i in np.flatnonzero(np.linalg.norm(slopes * steps, axis=0) > JUMP)]


def smooth_slope(here: Floats, behind: Floats, step: float) -> Floats:
    """Slope (k,) of features from those a step behind, (k,); nought where they jump there too, or are not known."""
    slope = (behind - here) / step
    if not np.isfinite(slope).all() or jumps(slope[:, None], np.array([step])):
        return np.zeros_like(here)
    return np.asarray(slope)


def with_slopes(
    views: Sequence[Linearized | None], slopes: Mapping[tuple[int, int], Floats], theta: Floats
) -> list[Linearized | None]:
    """The views of runs with other slopes (k,), by number of run and of common parameter, seen from theta (p,)."""
    found = list(views)
    for (number, i), slope in slopes.items():
        view = found[number]
        assert view is not None
        common = view.common.copy()
        common[:, i] = slope
        found[number] = replace(view, common=common, response=view.response + (common - view.common) @ theta)
    return found
