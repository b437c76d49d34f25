"""Completion of a small lattice: dots that growth did not reach because perspective changes too fast from dot to dot.

Growth predicts from one dot to the next and must start somewhere with four even arms; a grid of three by four dots seen
at a slant has no such place. A homography of all dots assigned so far predicts the rest to a few percent of a pitch.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

BASE = 16  # nearest dots used for a prediction: over a larger area, distortion is no longer a homography
FEWEST_BASE = 6  # two more than a homography needs
# Of the distance to the next place: with strong distortion a dot lies up to 0.15 from the prediction by six others.
CATCH = 0.25
# Largest factors between diameters and between contrasts of neighbouring dots of the array.
WIDER, DARKER = 1.5, 2.0
OFF = 0.3  # of a pitch: members farther from the prediction of the others are removed
SMALLEST_PITCH_PX = 3.0  # dots with a smaller pitch cannot be fitted
NEXT = np.array([(1, 0), (-1, 0), (0, 1), (0, -1)])


def completed(
    points: Array, widths: Array, contrasts: Array, dot: Integers, index: Integers
) -> tuple[Integers, Integers]:
    """Add the dots that continue a lattice, ring by ring.

    points: (n, 2) px, widths: (n,) px and contrasts: (n,) of all dots. dot: (m,) members, index: (m, 2) their
    places. Returns dot and index with those added.
    """
    if len(dot) < FEWEST_BASE:
        return dot, index
    while True:
        places = _free_next_to(index)
        free = np.setdiff1d(np.arange(len(points)), dot)
        added: dict[int, tuple[float, int]] = {}
        for number, place in enumerate(places):
            found = _dot_at(points, (widths, contrasts), dot, index, place, free)
            if found is not None and found[0] < added.get(found[1], (np.inf, 0))[0]:
                added[found[1]] = found[0], number
        if not added:
            return dot, index
        dot = np.concatenate([dot, list(added)])
        index = np.concatenate([index, places[[number for _, number in added.values()]]])


def without_strays(points: Array, dot: Integers, index: Integers) -> NDArray[np.bool_]:
    """Which members (m,) lie where the others predict them; all of them if too few remain for a prediction."""
    keep = np.ones(len(dot), dtype=bool)
    while keep.sum() > FEWEST_BASE + 1:
        off = np.zeros(len(dot))
        for k in np.flatnonzero(keep):
            rest = keep & (np.arange(len(dot)) != k)
            predicted = _predicted(points[dot[rest]], index[rest], index[k])
            if predicted is not None:
                off[k] = float(np.hypot(*(points[dot[k]] - predicted[0]))) / predicted[1]
        worst = int(off.argmax())
        if off[worst] <= OFF:
            break
        keep[worst] = False
    return keep


def _free_next_to(index: Integers) -> Integers:
    """Empty places (k, 2) next to members."""
    taken = set(map(tuple, index.tolist()))
    around = {tuple(place) for place in (index[:, None] + NEXT).reshape(-1, 2).tolist()}
    return np.array(sorted(around - taken), dtype=np.int64).reshape(-1, 2)


def _predicted(points: Array, index: Integers, place: Integers) -> tuple[Array, float, NDArray[np.intp]] | None:
    """Position of a place, px, the local pitch, and the members used for the prediction."""
    near = np.argsort(np.hypot(*(index - place).T), kind="stable")[:BASE]
    if np.ptp(index[near], axis=0).min() == 0:
        return None
    matrix = cv2.findHomography(index[near].astype(float), points[near], 0)[0]
    if matrix is None:
        return None
    around = np.concatenate([[place], place + NEXT, index[near]]).astype(float)
    depth = around @ matrix[2, :2] + matrix[2, 2]
    if not (depth[: 1 + len(NEXT)] * np.median(depth) > 0).all():  # beyond the horizon
        return None
    seen = cv2.perspectiveTransform(around[None, : 1 + len(NEXT)], matrix)[0]
    pitch = float(np.hypot(*(seen[1:] - seen[0]).T).min())
    return (seen[0], pitch, near) if pitch > SMALLEST_PITCH_PX else None  # a degenerate homography folds the plane


def _dot_at(
    points: Array, looks: tuple[Array, Array], dot: Integers, index: Integers, place: Integers, free: Integers
) -> tuple[float, int] | None:
    """The free dot nearest to a place, and its distance from it in pitches; None if there is none within reach."""
    predicted = _predicted(points[dot], index, place)
    if predicted is None or len(free) == 0:
        return None
    at, pitch, near = predicted
    off = np.hypot(*(points[free] - at).T) / pitch
    for look, most in zip(looks, (WIDER, DARKER), strict=True):
        ratio = look[free] / np.median(look[dot[near[:4]]])
        off[(ratio > most) | (ratio < 1 / most)] = np.inf
    best = int(off.argmin())
    return (float(off[best]), int(free[best])) if off[best] < CATCH else None
