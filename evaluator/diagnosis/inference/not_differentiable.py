"""Runs whose motion is not differentiable: at a fold of the model a tiny change of a parameter leads to another one.

A robot of a metre that hardly overcomes the friction of its own turning goes on along one of two ways, and a per cent
of a parameter decides which. There a linear view predicts any decrease, and no step reaches it. Such a run is taken as
it is: its misfit counts, its slopes do not, and the others say where the parameters lie.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.mixed_model import Linearized

Floats = NDArray[np.float64]

# Of the runs of a fit: one in eight may be outlying to a verdict (diagnosis.OUTLYING_SHARE), and as many may be without
# slopes.
MOST_SLOPELESS = 0.125


def most_slopeless(runs: int, length: float) -> int:
    """How many runs of a fit may be without slopes; none on a plate, where no fold keeps a fit from settling."""
    return max(int(MOST_SLOPELESS * runs), 1) if length > 1 else 0


def without_slopes(linear: Sequence[Linearized], theta: Floats, slopeless: Sequence[int]) -> list[Linearized]:
    """The views of runs, of which the slopeless do not change with the common parameters (p,) from theta on."""
    return [
        replace(item, response=item.response - item.common @ theta, common=np.zeros_like(item.common))
        if number in slopeless
        else item
        for number, item in enumerate(linear)
    ]
