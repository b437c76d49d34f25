"""The record in which a run is worked out: where it stands, and scratch of the kernels.

One record stands for a dozen arrays in the arguments of the kernels, and costs them less: numba counts the users of an
array at every call that hands it on, a record is handed on as its place in memory. So whoever makes a record must hold
the array it stands in while the record is in use.
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
    """Type of the record for robots of up to so many wheels."""
    return np.dtype(
        [
            ("pose", float, 3),  # x, y, heading at the start of the step
            ("y", float, 6),  # twist since then, and velocity
            ("segment", float, COLUMNS),  # of the command, see simulator.dynamics.motors
            ("end", float, (2, 6)),  # y at the end of the step, and the estimate of its error
            ("stages", float, (STAGES, 6)),
            ("linear", float, (8, 3)),  # accelerations; derivative by velocity (3 rows), by twist (3 rows), by time
            ("bent", float, (8, 3)),  # the first four rows within an iteration
            ("inverse", float, (3, 3)),
            ("block", float, (3, 3)),
            ("contacts", float, (ROWS, slots)),  # see simulator.dynamics.contact
            ("spare", float, (8, 6)),
            ("table", float, (TABLE_ROWS, POINTS)),
            ("inverses", float, (POINTS, 3, 3)),
            ("growth", float),  # of a disturbance of the velocity at the start of the step, 1/s
            ("grown", float),  # logarithm of what disturbances have grown by in the segment
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
    """Copy numbers into the target (n,), by hand: an assignment of arrays brings the text of its errors to compile."""
    for item in range(len(target)):
        target[item] = source[item]
