"""Background objects of a mark's colour that do not move with the robot.

The two marks of one robot keep their distance, apart from perspective. If one of them never moves while the other
travels, and their distance changes by more than perspective explains, the one at rest belongs to the background. When a
robot turns about one of its marks, this mark is also at rest, but the distance does not change.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evaluator.tracking.following.pair import TOLERANCE

Array = NDArray[np.float64]

STILL_PX = 1.5  # largest deviation from its median, by noise and codec, of an object at rest
TRAVELS = 3.0  # radii that a mark must travel before an object at rest beside it is judged
APART = 2.0  # times TOLERANCE: ratio of the largest to the smallest distance from which two objects are not on one body
# Ratio of the change of the distance of two marks to their steps: on a body that turns, seen at 60 degrees, at most
# 0.5.
APART_STEPS = 0.6
STEADY_STEP = 0.5  # relative change of a step: a robot that turns by 28 degrees per frame, or starts in two frames
FEW = 4  # frames in which the other mark must be seen


def background(rest_px: Array, mover_px: Array, radius_px: float) -> NDArray[np.bool_]:
    """Frames in which a mark is an object at rest that is not on the body of the other mark; (n,).

    rest_px, mover_px: (n, 2), NaN where absent. radius_px: of the marks.
    """
    wrong = np.zeros(len(rest_px), bool)
    found = stays(rest_px, radius_px)
    always = len(found) > 0 and all(rests for _, rests in found)
    if always and np.isfinite(mover_px[:, 0]).sum() < FEW:
        return np.isfinite(rest_px[:, 0])  # no evidence that it is on a robot
    for rows, rests in found:
        if not rests:
            continue
        seen = mover_px[rows[0] : rows[-1] + 1]
        seen = seen[np.isfinite(seen[:, 0])]
        if len(seen) < FEW and always:
            seen = mover_px[np.isfinite(mover_px[:, 0])]  # an object that never moves is present in all frames
        if len(seen) >= FEW and not on_one_body(np.median(rest_px[rows], axis=0), seen, radius_px):
            wrong[rows] = True
    return wrong


def strangers(one_px: Array, other_px: Array, radius_px: float) -> bool:
    """Whether two moving objects are not on one body: their distance changes as much as they move; (n, 2) each.

    If they mostly rest, steps and changes are noise, and the distance must differ by more than perspective explains.
    """
    step = [np.hypot(*np.diff(places, axis=0).T) for places in (one_px, other_px)]
    distance = np.hypot(*(one_px - other_px).T)
    change = np.abs(np.diff(distance))
    both = np.isfinite(change)
    if both.sum() < FEW - 1 or _steady(distance[np.isfinite(distance)]):
        return False
    steps = (step[0][both] + step[1][both]) / 2.0
    return bool(steps.sum() > TRAVELS * radius_px and np.median(change[both]) > APART_STEPS * np.median(steps))


def on_one_body(rest_px: Array, mover_px: Array, radius_px: float) -> bool:
    """Whether an object at rest (2,) may be on the body of a mark seen at several positions (m, 2)."""
    if np.ptp(mover_px, axis=0).max() < TRAVELS * radius_px:
        return True
    apart = np.hypot(*(mover_px - rest_px).T)
    return _steady(apart)


def _steady(distance_px: Array) -> bool:
    """Whether perspective and noise explain the variation of distances (n,)."""
    near, far = np.quantile(distance_px, (0.1, 0.9))
    return bool(far < near * (1.0 + APART * TOLERANCE) + 2.0)


def travels(places_px: Array, radius_px: float) -> bool:
    """Whether a mark travels from frame to frame, instead of resting or jumping back and forth; places_px: (n, 2)."""
    for rows, _ in stays(places_px, radius_px):
        low, high = np.quantile(places_px[rows], (0.05, 0.95), axis=0)
        if (high - low).max() > TRAVELS * radius_px:
            return True
    step = np.diff(places_px, axis=0)
    way = np.hypot(*step.T)
    # Every step of a fast mark looks like a jump. Successive steps of a mark are similar, those of confused objects are
    # not.
    alike = np.hypot(*np.diff(step, axis=0).T) < STEADY_STEP * np.minimum(way[1:], way[:-1])
    fast = alike & (way[1:] > radius_px)
    return bool(np.convolve(fast, np.ones(FEW), "valid").max(initial=0) >= FEW)


def stays(places_px: Array, radius_px: float) -> list[tuple[NDArray[np.intp], bool]]:
    """Rows between jumps of more than a radius, each with whether the mark rests there; places_px: (n, 2)."""
    seen = np.flatnonzero(np.isfinite(places_px).all(axis=1))
    if not len(seen):
        return []
    steps = np.hypot(*np.diff(places_px[seen], axis=0).T)
    found = []
    for rows in np.split(seen, np.flatnonzero(steps > max(radius_px, 2.0 * STILL_PX)) + 1):
        low, high = np.quantile(places_px[rows], (0.05, 0.95), axis=0)
        found.append((rows, len(rows) >= FEW and float((high - low).max()) < 2.0 * STILL_PX))
    return found
