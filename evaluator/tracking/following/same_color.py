"""Identity of two marks of one colour on a body, from the rotation of the body.

When the marks are first found, the names are assigned by chance. After an occlusion they may be found again in the
other order. A body does not turn around within a few frames: if the line between the marks does, the names are
exchanged back. If it was out of view for so long that it may have turned by a right angle, the order is unknown.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Rows = NDArray[np.bool_]

LATELY = 10  # frames with both marks that determine the yaw rate: a third of a second
NEARER = 0.5  # of the usual distance: below it, one mark was found under both names


def exchanged(time_s: Array, one_px: Array, other_px: Array) -> tuple[Rows, Rows]:
    """Rows in which the names of two marks of one body are exchanged, and rows in which their order is unknown.

    time_s: (n,). one_px, other_px: (n, 2), NaN where absent; both results (n,).
    """
    swapped, unknown = np.zeros(len(time_s), bool), np.zeros(len(time_s), bool)
    apart = (other_px - one_px) @ np.array([1.0, 1j])
    distance = np.nan_to_num(np.abs(apart))
    both = (
        np.flatnonzero(distance > NEARER * np.median(distance[distance > 0.0])) if distance.any() else np.array([], int)
    )
    rates: list[float] = []
    fastest = 0.0
    for before, now in pairwise(both):
        lapse, rate = float(time_s[now] - time_s[before]), float(np.median(rates[-LATELY:])) if rates else 0.0
        if now > before + 1 and lapse * fastest > np.pi / 2:
            unknown[before + 1 :] = True
            break
        turn = np.angle(apart[now] / apart[before] * np.exp(-1j * rate * lapse))
        swapped[now:] ^= abs(turn) > np.pi / 2
        if abs(turn) > np.pi / 2:
            unknown[before + 1 : now] = True  # one of them was followed under the name of the other
        elif now == before + 1 and lapse > 0.0:
            rates.append(rate + float(turn) / lapse)
            fastest = max(fastest, abs(float(np.median(rates[-LATELY:]))))
    return swapped, unknown
