"""Intervals of a run: of constant command, and those in which its motion differs from the rest of the run, or stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.motion import WINDOW_S, Motion
from evaluator.robust import PER_MEDIAN

FEWEST_FRAMES = 4  # of a phase; fewer do not determine a motion
HELD_S = 0.25  # least duration of a disturbance, longer than the window of a velocity
# A lasting change of the speed: least time on either side; and least size, as a share of the larger speed, in scatters
# of the speed on either side, and in changes between the halves of a side. Where a wire, a magnet or a grain of the
# plate catches the heading of a robot, the yaw rate changes as suddenly, and the speed by 42 % at most, in 16 runs of
# 337 sessions; that of a robot whose motors are commanded backward by 200 %, with one motor off by 55 %.
LASTS_S, CHANGE_SHARE, CHANGE_SCATTERS, CHANGE_STEADY = 0.75, 0.48, 6.0, 4.0


def phases_of(run: RunData) -> list[RunData]:
    """The run itself, or for a run with a command log one part for each constant command with a motor on."""
    if run.log is None:
        return [run]
    seen = np.isfinite(run.marks_mm).all(axis=1)
    found = []
    for item in run.log.driven:
        inside = (run.time_s >= item.begin_s) & (run.time_s <= item.end_s)
        if np.count_nonzero(inside & seen) < FEWEST_FRAMES:
            continue
        found.append(
            replace(
                run,
                left_rpm=item.left_rpm,
                right_rpm=item.right_rpm,
                start_s=max(item.begin_s, float(run.time_s[0])),
                stop_s=item.end_s if np.isfinite(item.end_s) else None,
                time_s=run.time_s[inside],
                marks_mm=run.marks_mm[inside],
                systematic={},
                log=None,
            )
        )
    return found


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
        out |= np.abs(values - middle) > 8 * PER_MEDIAN * np.median(np.abs(values - middle))
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


def lasting_change(motion: Motion) -> tuple[float, float, float] | None:
    """When a steady speed along goes over at once to another one that lasts; None if it does not.

    Returns the time, s, and the speeds before and after it, mm/s.
    """
    speed = motion.along
    first = int(np.searchsorted(motion.time_s, motion.time_s[0] + LASTS_S))
    last = int(np.searchsorted(motion.time_s, motion.time_s[-1] - LASTS_S))
    apart = [sum(np.abs(part - np.median(part)).sum() for part in np.split(speed, [k])) for k in range(first, last + 1)]
    if not apart:
        return None
    split = first + int(np.argmin(apart))
    at_s = float(motion.time_s[split - 1 : split + 1].mean())
    sides = speed[motion.time_s < at_s - WINDOW_S], speed[motion.time_s > at_s + WINDOW_S]
    if min(map(len, sides)) < 2:  # frames are missing there
        return None
    before, after = (float(np.median(side)) for side in sides)
    scatter = max(PER_MEDIAN * float(np.median(np.abs(side - np.median(side)))) for side in sides)
    slow = max(abs(float(np.median(a) - np.median(b))) for a, b in (np.array_split(side, 2) for side in sides))
    least = max(CHANGE_SHARE * max(abs(before), abs(after)), CHANGE_SCATTERS * scatter, CHANGE_STEADY * slow)
    return (at_s, before, after) if abs(after - before) > least else None
