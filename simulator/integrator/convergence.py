"""Convergence check of a run: smaller step errors, or slightly different speeds, must give the same motion."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.integrator.run_kernel import MOST_STEPS

Array = NDArray[np.float64]

# A run is worked out again with so many times smaller local errors, and once more where the two disagree.
CHECKS, MOST_CHECK_STEPS = (100.0, 1000.0), 10 * MOST_STEPS
# They agree within a fiftieth of what cameras tell of a robot as small as the paper's, in proportion for others, and
# half of the share of the way that `simulate` states.
SETTLED_MM, SETTLED_SHARE = 1e-3, 5e-4
# A run near one at which a wheel turns over may take either way, and steps do not show it before their errors are far
# smaller than those checked. So it is worked out with one side a little faster and the other slower, too, and the other
# way round: by what a recording's clock, and so a speed, is known to by default.
SPEEDS_KNOWN_TO = 1e-4


def settled_mm(models: Any) -> Any:
    """What two solutions of a robot, or of each of several, may be apart beside their share of the way, mm."""
    return SETTLED_MM * models["time_unit"] ** 2


def unsettled_mm(usual: Array, other: Array, allowed_mm: float) -> float:
    """How far two solutions of a run, states (n, 6), are apart at most, mm; 0 where no more than errors add up to."""
    apart = np.hypot(*(usual - other)[:, :2].T)
    way = np.hypot(*np.diff(other[:, :2], axis=0).T).sum()
    largest = float(apart.max())
    return largest if largest > allowed_mm + SETTLED_SHARE * way else 0.0


def commands_beside(knots: Array) -> list[Array]:
    """Commands (n, 3) whose speeds differ by what they are known to, either way.

    The mean of the two solutions is to be compared: what a change makes in proportion to itself is no other way.
    """
    return [knots * np.array([1.0, 1.0 + change, 1.0 - change]) for change in (SPEEDS_KNOWN_TO, -SPEEDS_KNOWN_TO)]
