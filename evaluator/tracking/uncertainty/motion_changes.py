"""Starts, stops and reversals of a body, which are not errors of its marks."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from evaluator.tracking.uncertainty.course import EXACT_PX2, LEAST, OFFSETS, REACH, Course, to_the_middle

Array = NDArray[np.float64]

# Starts, stops and reversals of a robot are rare in a recording; frequent changes are errors of the codec. Sigmas that
# chance reaches once in 3e5 frames, and sigmas required of each mark of a body, which chance reaches in one of eight.
CHANGES, ABRUPT, SEEN = 3, 5.0, 2.0


def changes_of_motion(courses: Sequence[Course]) -> NDArray[np.bool_]:
    """Frames whose course includes an abrupt change of speed, which is not an error of a centre; (n,).

    Such a change leaves a characteristic pattern of deviations, different from that of a large error in one frame.
    courses: of marks on one body, which all change together; a change of one of them alone is an error.
    """
    wrong = np.zeros(len(courses[0].known), bool)
    if min(course.known.sum() for course in courses) < LEAST:
        return wrong
    changes, singles, around = np.zeros_like(wrong, float), np.zeros_like(wrong, float), 2 * REACH + 1
    together = ~wrong
    for course in courses:
        change, single = (_likeness(course.error, pattern) for pattern in _patterns())
        # For random errors it follows the square of a Rayleigh distribution, whose median is ln 4 variances.
        variance = float(np.median(change[course.known])) / np.log(4.0) + EXACT_PX2
        changes, singles = changes + change / variance, singles + single / variance
        together &= change > SEEN**2 * variance
    certain = together & (changes > ABRUPT**2 * len(courses))
    found = certain & (changes >= _most_around(changes)) & (changes > _most_around(singles))
    if found.sum() <= CHANGES:
        wrong = np.convolve(found, np.ones(around), "same") > 0
    return wrong


def _most_around(values: Array) -> Array:
    """The largest value within REACH frames of each; (n,)."""
    return np.asarray(np.lib.stride_tricks.sliding_window_view(np.pad(values, REACH), 2 * REACH + 1).max(axis=1))


def _likeness(error: Array, pattern: Array) -> Array:
    """Squares of errors (n, 2) explained by a pattern around each frame, px²; (n,)."""
    alike = [np.convolve(axis, pattern, "same") for axis in np.nan_to_num(error).T]
    return np.asarray(np.square(alike).sum(axis=0) / (pattern @ pattern))


@cache
def _patterns() -> tuple[Array, Array]:
    """Deviations for a path with a kink at frame 0, and for one with an error in frame 0 alone; (11,) each."""
    frames = np.arange(-REACH, REACH + 1.0)
    weights = to_the_middle(OFFSETS.astype(float), np.ones(len(OFFSETS), bool))
    bent = np.maximum(frames, 0.0) - np.maximum(frames[:, None] + OFFSETS, 0.0) @ weights
    single = (frames == 0.0) - (frames[:, None] + OFFSETS == 0.0) @ weights
    return bent, single
