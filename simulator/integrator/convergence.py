"""Convergence check of a run: smaller step errors, or slightly different speeds, must give the same motion."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.integrator.run_kernel import MOST_STEPS

Array = NDArray[np.float64]

# A run is repeated with local errors smaller by the first factor, and by the second if both results disagree.
CHECKS, MOST_CHECK_STEPS = (100.0, 1000.0), 10 * MOST_STEPS
# Two results agree within SETTLED_MM, a fiftieth of a camera's accuracy, for the paper's robot (in proportion to size
# for others), plus SETTLED_SHARE of the path, half of the error that `simulate` documents.
SETTLED_MM, SETTLED_SHARE = 1e-3, 5e-4
# A run close to a bifurcation, where a wheel reverses its sliding, may take either branch, and smaller step errors may
# not reveal it. Therefore it is also repeated with one side slightly faster and the other slower, and vice versa, by
# the default uncertainty of a recording's clock and hence of a speed.
SPEEDS_KNOWN_TO = 1e-4


def settled_mm(models: Any) -> Any:
    """Distance, mm, within which two solutions agree, besides SETTLED_SHARE of the path; models: one record or (n,)."""
    return SETTLED_MM * models["time_unit"] ** 2


def unsettled_mm(usual: Array, other: Array, allowed_mm: float) -> float:
    """Largest distance between two solutions of a run, states (n, 6), mm; 0 where step errors explain it."""
    apart = np.hypot(*(usual - other)[:, :2].T)
    way = np.hypot(*np.diff(other[:, :2], axis=0).T).sum()
    largest = float(apart.max())
    return largest if largest > allowed_mm + SETTLED_SHARE * way else 0.0


def commands_beside(knots: Array) -> list[Array]:
    """Two commands (n, 3) whose speeds differ from knots by SPEEDS_KNOWN_TO, in opposite directions.

    The mean of both solutions is to be compared with the original: in it, changes in proportion to the speed cancel.
    """
    return [knots * np.array([1.0, 1.0 + change, 1.0 - change]) for change in (SPEEDS_KNOWN_TO, -SPEEDS_KNOWN_TO)]
