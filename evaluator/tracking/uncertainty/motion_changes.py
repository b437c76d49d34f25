"""Starts, stops and reversals of a body, which are not errors of its marks, and the errors of a codec beside them.

A codec predicts most frames from those before and after, so that the last frames at rest begin to move and the first in
motion lag. Both marks err alike, and their course bends there anyway, so that nothing else shows it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluator.tracking.uncertainty.course import EXACT_PX2, LEAST, OFFSETS, REACH, Course, to_the_middle

Array = NDArray[np.float64]

# Starts, stops and reversals of a robot are rare in a recording; frequent changes are errors of the codec. Sigmas that
# chance reaches once in 3e5 frames, and sigmas required of each mark of a body, which chance reaches in one of eight.
CHANGES, ABRUPT, SEEN = 3, 5.0, 2.0
# Standard error of the frame at a change, of those beside it, and of the next ones, over the change of the motion in a
# frame: 132 starts of marks by x264 with B frames, at rates of 20 to 28; key frames alone (MJPEG) have 0.02.
SMEARED = (0.22, 0.22, 0.11)
PREDICTED = ("P", "B")


def kinks(courses: Sequence[Course]) -> NDArray[np.bool_]:
    """Last frames before an abrupt change of speed, which is not an error of a centre; (n,).

    Such a change leaves a characteristic pattern of deviations, different from that of a large error in one frame.
    courses: of marks on one body, which all change together; a change of one of them alone is an error.
    """
    none = np.zeros(len(courses[0].known), bool)
    if min(course.known.sum() for course in courses) < LEAST:
        return none
    changes, singles = np.zeros_like(none, float), np.zeros_like(none, float)
    together = ~none
    for course in courses:
        change, single = (_likeness(course.error, pattern) for pattern in _patterns())
        # For random errors it follows the square of a Rayleigh distribution, whose median is ln 4 variances.
        variance = float(np.median(change[course.known])) / np.log(4.0) + EXACT_PX2
        changes, singles = changes + change / variance, singles + single / variance
        together &= change > SEEN**2 * variance
    certain = together & (changes > ABRUPT**2 * len(courses))
    found = certain & (changes >= _most_around(changes)) & (changes > _most_around(singles))
    return found if found.sum() <= CHANGES else none


def around(found: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Frames whose course includes one of some kinks; (n,)."""
    return np.asarray(_around(found).any(axis=1))


def _around(values: NDArray[Any]) -> NDArray[Any]:
    """Values within REACH frames of each, (n, 2 REACH + 1); 0 beyond the ends."""
    return np.lib.stride_tricks.sliding_window_view(np.pad(values, REACH), 2 * REACH + 1)


def changes_of_motion(courses: Sequence[Course]) -> NDArray[np.bool_]:
    """Frames whose course includes an abrupt change of speed; (n,). courses: of `kinks`."""
    return around(kinks(courses))


def smeared(centers_px: Array, found: NDArray[np.bool_], kinds: NDArray[np.str_]) -> Array:
    """Variances in x and y and their covariance, px², to add to frames beside kinks that a codec has predicted; (n, 3).

    centers_px: (n, 2) of a mark, NaN where absent. found: of `kinks`. kinds: of the frames, see `recording.Frame`.
    """
    extra = np.zeros((len(found), 3))
    last = len(found) - 1
    for kink in map(int, np.flatnonzero(found)):
        before, here, after = (centers_px[k] for k in (max(kink - REACH, 0), kink, min(kink + REACH, last)))
        x, y = np.nan_to_num((after + before - 2 * here) / REACH)  # 0 beside a frame without the mark
        for frame in range(max(kink - len(SMEARED) + 1, 0), min(kink + len(SMEARED) - 1, last) + 1):
            if kinds[frame] in PREDICTED:
                extra[frame] += SMEARED[abs(frame - kink)] ** 2 * np.array([x * x, y * y, x * y])
    return extra


def _most_around(values: Array) -> Array:
    """The largest value within REACH frames of each; (n,)."""
    return np.asarray(_around(values).max(axis=1))


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
