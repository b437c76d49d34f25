"""Intervals of a run in which its motion differs from the rest of the run."""

from __future__ import annotations

import numpy as np

from evaluator.diagnosis.mistakes.motion import WINDOW_S, Motion

HELD_S = 0.25  # least duration of a disturbance, longer than the window of a velocity


def interrupts(stretch: tuple[float, float], odd: np.ndarray, motion: Motion) -> bool:
    """Whether a run moves as usual before an interval, s, and after it.

    A push ends; backlash of a gear shows at the start, and another regime of friction lasts.
    """
    around = odd[motion.time_s < stretch[0]], odd[motion.time_s > stretch[1]]
    return all(2 * np.count_nonzero(part) < len(part) for part in around)


def unlike(motion: Motion) -> np.ndarray:
    """Times at which the motion deviates far from the usual variation of the run (median, mean absolute deviation)."""
    out = np.zeros(len(motion.time_s), dtype=np.bool_)
    for values in (motion.along, motion.across, motion.yaw):
        middle = np.median(values)
        out |= np.abs(values - middle) > 8 * 1.4826 * np.median(np.abs(values - middle))
    return out


def longest(mask: np.ndarray, motion: Motion) -> tuple[float, float] | None:
    """Begin and end, s, of the longest interval of a mask, if it lasts HELD_S; else None."""
    spans = [(begin, end) for begin, end in stretches(mask, motion) if end - begin >= HELD_S]
    return max(spans, key=lambda span: span[1] - span[0], default=None)


def stretches(mask: np.ndarray, motion: Motion) -> list[tuple[float, float]]:
    """Begin and end, s, of the intervals of a mask; an interval without frames longer than a window ends one."""
    together = mask[1:] & mask[:-1] & (np.diff(motion.time_s) <= WINDOW_S)
    begins, ends = mask & ~np.insert(together, 0, False), mask & ~np.append(together, False)
    return list(zip(motion.time_s[begins].tolist(), motion.time_s[ends].tolist(), strict=True))
