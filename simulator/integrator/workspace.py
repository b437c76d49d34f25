"""The record with the state of a run during integration, and the work arrays of the kernels.

One record replaces a dozen arrays in the arguments of the kernels and is faster: numba counts references to an array at
every call, but passes a record as a pointer. Whoever makes a record must therefore keep its array alive while the
record is in use.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba.extending import overload

from simulator.compilation import compiled
from simulator.dynamics.motors import COLUMNS
from simulator.dynamics.wheel import ROWS

STAGES = 6
POINTS, TABLE_ROWS = 12, 16  # of a step by collocation, see simulator.integrator.collocation


def work_type(slots: int) -> np.dtype[np.void]:
    """Type of the record for robots with up to `slots` wheels."""
    return np.dtype(
        [
            ("pose", float, 3),  # x, y, heading at the start of the step
            ("y", float, 6),  # twist since then, and velocity
            ("segment", float, COLUMNS),  # of the command, see simulator.dynamics.motors
            ("end", float, (2, 6)),  # y at the end of the step, and the estimate of its error
            ("stages", float, (STAGES, 6)),
            ("linear", float, (8, 3)),  # accelerations; derivative by velocity (3 rows), by twist (3 rows), by time
            ("bent", float, (8, 3)),  # the first four rows of linear at an iterate of Newton's method
            ("inverse", float, (3, 3)),
            ("block", float, (3, 3)),
            ("contacts", float, (ROWS, slots)),  # see simulator.dynamics.contact
            ("spare", float, (8, 6)),
            ("table", float, (TABLE_ROWS, POINTS)),
            ("inverses", float, (POINTS, 3, 3)),
            ("growth", float),  # of a disturbance of the velocity at the start of the step, 1/s
            ("grown", float),  # logarithm of the growth of disturbances in the segment
            ("tried", float),  # evaluations of the forces by implicit Euler steps since the start of the run
        ],
        align=True,
    )


def new_work(model: Any) -> Any:
    """An array of one record, zero, with room for the wheels of a model; for kernels only."""
    raise NotImplementedError(model)  # compiled code takes what follows


@overload(new_work)
def _new_work(model: Any) -> Any:
    kind = work_type(model.typeof("wheel_x").shape[0])

    def zeros(model: Any) -> Any:  # noqa: ARG001  # named and typed like new_work, as numba demands
        return np.zeros(1, kind)

    return zeros


@compiled()
def copy(source: Any, target: Any) -> None:
    """Copy numbers to target (n,), in a loop: an array assignment would add error texts to the compiled code."""
    for item in range(len(target)):
        target[item] = source[item]
