"""Headings of poses in another unit than their column says, by the direction of the path.

A robot that does not slide far sideways drives along its heading, ahead or backward. Over a path that bends, heading
and direction therefore turn alike, which headings in another unit do not. On a straight path no unit shows.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pandas as pd
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEP_SIGMAS = 10.0  # a step so much longer than its noise has a direction to 6 degrees
FEWEST_STEPS = 30
# Agreement of heading and direction (length of the mean of unit vectors): 1 if they are equal, about 1/sqrt(steps) for
# directions at random. A sideslip of up to 25 degrees on either side leaves 0.8, as the angles are doubled; half of
# that is left of headings with a noise of 38 degrees, or of a heading that seems to stand while the path turns by 110.
AGREES, DISAGREES = 0.8, 0.4
UNITS = {"degrees, not radians": np.pi / 180, "radians, not degrees": 180 / np.pi}


def heading_unit(table: pd.DataFrame) -> str:
    """The unit that the headings of a PoseTable seem to have, and the stated one; "" if the stated one agrees."""
    pose = table[["x_mm", "y_mm", "heading_deg"]].dropna().to_numpy(float)
    sigma_mm = float(np.hypot(table["x_sigma_mm"].median(), table["y_sigma_mm"].median()))
    direction, heading = _steps(pose, STEP_SIGMAS * sigma_mm)
    if len(direction) < FEWEST_STEPS or _agreement(direction, heading) > DISAGREES:
        return ""
    if _agreement(direction, np.zeros(len(direction))) > AGREES:  # straight; a robot may spin as it is dragged along
        return ""
    fits = {words: _agreement(direction, times * heading) for words, times in UNITS.items()}
    best = max(fits, key=lambda words: fits[words])
    return best if fits[best] > AGREES else ""


def _steps(pose: Array, least_mm: float) -> tuple[Array, Array]:
    """Direction of the path and heading as stated, rad, over successive stretches (m,) of a least length."""
    kept, last = [0], pose[0, :2] if len(pose) else np.zeros(2)
    for k, place in enumerate(pose[:, :2]):
        if np.hypot(*(place - last)) > least_mm:
            kept.append(k)
            last = place
    ends = pose[kept] if len(pose) else pose
    chord = np.diff(ends[:, 0]) + 1j * np.diff(ends[:, 1])
    middle = [(before + after) // 2 for before, after in pairwise(kept)]
    return np.angle(chord), np.radians(pose[middle, 2])


def _agreement(direction: Array, heading: Array) -> float:
    """Length of the mean of exp(2i (direction - heading)): driving backward counts as ahead."""
    return float(abs(np.mean(np.exp(2j * (direction - heading)))))
