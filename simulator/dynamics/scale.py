"""Internal units of the kernels, scaled with the robot, so that all sizes are resolved equally well.

Robots of different size are similar (Froude similarity): with lengths in a unit L, times in √L seconds per √mm and
forces in µN, gravity keeps its value. The steps, roundings and tolerances of the kernels, chosen for a robot whose
wheels are 2.83 mm from their middle, then hold for all sizes. Units are powers of two, so that scaling causes no
rounding; for the shipped microrobots they are mm and s.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from simulator.dynamics.terms import (
    ABS_U,
    ABS_YAW,
    MOMENT,
    TIME,
    TOWARD_X,
    TOWARD_Y,
    U_ABS,
    V_ABS,
    YAW,
    YAW_ABS,
    Term,
    U,
    V,
    X,
    Y,
)

USUAL_DISTANCE_MM = math.sqrt(8.0)  # of the paper's wheels from their middle, root mean square
# Depth below the robot of a point that attracts it. It is a property of the point, not of the robot, whatever its size.
POINT_DEPTH_MM = 2.0
# Dimensions of the bases, as powers of length and of time; bases that are not listed are dimensionless.
DIMENSIONS = {
    U: (1, -1),
    V: (1, -1),
    ABS_U: (1, -1),
    U_ABS: (2, -2),
    V_ABS: (2, -2),
    YAW: (0, -1),
    ABS_YAW: (0, -1),
    YAW_ABS: (0, -2),
    X: (1, 0),
    Y: (1, 0),
    TIME: (0, 1),
}


def time_unit_s(places_mm: NDArray[np.float64]) -> float:
    """Unit of time, s, of a robot with supports at (n, 2): a power of two. Its square is the unit of length, mm."""
    off = places_mm - places_mm.mean(axis=0)
    distance = math.sqrt(float((off * off).sum()) / len(off))
    return float(2.0 ** round(math.log(max(distance, 1e-9) / USUAL_DISTANCE_MM, 4)))


def scaled_coefficient(term: Term, time_unit: float) -> float:
    """A term's coefficient in the units of the kernels: forces in µN, moments in µN times the unit of length."""
    length, time = DIMENSIONS.get(term.basis, (0, 0))
    power = 2.0 * length + time - (2 if term.channel == MOMENT else 0)
    if term.basis in (TOWARD_X, TOWARD_Y):
        power -= 2.0 * term.falloff  # stated at 10 mm, used by the kernels at 10 of their units
    return float(term.coefficient * time_unit**power)


def scaled_states(states: NDArray[np.float64], time_unit: float) -> NDArray[np.float64]:
    """States (n, 6), pose and velocity in mm, rad and s, in the units of the kernels."""
    scaled: NDArray[np.float64] = np.divide(states, state_units(time_unit))
    return scaled


def state_units(time_unit: float) -> NDArray[np.float64]:
    """Units of a state (6,): x, y, heading, u, v, yaw rate."""
    length = time_unit * time_unit
    return np.array([length, length, 1.0, time_unit, time_unit, 1.0 / time_unit])


def scaled_knots(knots: NDArray[np.float64], time_unit: float) -> NDArray[np.float64]:
    """Knots (k, 3) of a command, s and rpm, in the units of the kernels."""
    scaled: NDArray[np.float64] = np.multiply(knots, [1.0 / time_unit, time_unit, time_unit])
    return scaled


def most_slots(counts: Sequence[int]) -> int:
    """Number of wheels that a record has room for, so that robots with these counts of wheels fit: a multiple of four.

    Kernels are compiled for each such number, and process four wheels as one vector.
    """
    return 4 * math.ceil(max(counts) / 4)
