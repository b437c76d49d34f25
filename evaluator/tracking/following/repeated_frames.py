"""Repeated frames, detected from the motion of the marks.

A recorder that fills a gap repeats a frame, which a codec then stores again, slightly changed. A repeated frame is
detected because all marks stand still for a frame during motion and then catch up in one step. At the end of a
recording with repeated frames there is no such step: it suffices that all marks stand still no longer than in earlier
repeated frames.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from evaluator.tracking.observation import REPEATED
from evaluator.wording import counted, verb

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Frames in the mean that defines the usual step: two pairs. If a screen at 60 frames/s shows a recording of 30
# frames/s, every frame appears twice, and the usual step is half of every second step.
PACED = 4
AROUND = 5  # frames on either side from which the usual step is determined
MOVING_PX = 0.5  # usual step from which a standstill is distinguished from errors of the codec
STILL = 0.25  # of the usual step: largest apparent motion in a repeated frame
AGAIN = 0.35  # relative difference between the step after a standstill and the motion that was missed
LONGEST = 5  # consecutive repeated frames


def repeated_note(marks: pd.DataFrame) -> str:
    """A sentence on the frames of a tracked recording that show moving marks where they were; empty without any.

    A codec repeats frames of a scene at rest to the bit; these say nothing of the recorder.
    """
    status = [name for name in marks if str(name).endswith("_status")]
    again = marks.loc[(marks[status] == REPEATED).any(axis=1), "frame"]
    if not len(again):
        return ""
    shown, it = verb(len(again), "shows", "show"), verb(len(again), "it is", "they are")
    return (
        f"{counted(len(again), 'frame')} {shown} the one before again, the first is frame {again.iloc[0]:.0f}; {it} "
        "left out: record at a frame rate that the camera keeps"
    )


def repeated_frames(marks_px: list[Array]) -> list[Flags]:
    """Repeated frames, per mark that moves: frames in which all moving marks stand still and then catch up.

    marks_px: (n, 2) each, NaN where absent. Marks at rest do not matter: their position is right in a repeated frame.
    """
    if not marks_px:
        return []
    each = [_of_mark(points) for points in marks_px]
    moving, shown, ending = (np.array(part) for part in zip(*each, strict=True))
    again = (shown | ~moving).all(axis=0) & moving.any(axis=0)
    at_end = (ending | ~moving).all(axis=0) & moving.any(axis=0)
    if at_end.sum() <= _longest_run(again):
        again |= at_end
    return list(moving & again)


def _longest_run(flags: Flags) -> int:
    """Length of the longest run of true flags."""
    ends = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    return int(np.max(ends[1::2] - ends[::2], initial=0))


def _of_mark(points: Array) -> tuple[Flags, Flags, Flags]:
    """Frames around which a mark moves, frames that repeat it, and standstills at the end of the recording."""
    n = len(points)
    moving, shown, ending = np.zeros(n, bool), np.zeros(n, bool), np.zeros(n, bool)
    step = np.concatenate([[np.nan], np.hypot(*np.diff(points, axis=0).T)])
    if n <= 2 * AROUND or np.isfinite(step).sum() <= AROUND:
        return moving, shown, ending
    pace = np.hypot(*(points[PACED:] - points[:-PACED]).T) / PACED
    padded = np.pad(pace, AROUND + PACED // 2, constant_values=np.nan)
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * AROUND + 1)
    count = np.isfinite(around).sum(axis=1)
    # The median of those that are known: NaN is sorted to the end.
    rows, ranked = np.arange(n), np.sort(around, axis=1)
    usual = np.where(count > AROUND, (ranked[rows, (count - 1) // 2] + ranked[rows, count // 2]) / 2, 0.0)
    known = np.flatnonzero(count > AROUND)
    if len(known):  # there are no later frames around the last ones
        usual[known[-1] + 1 :] = usual[known[-1]]
    moving = usual > MOVING_PX
    still = moving & (step < STILL * usual)
    for first in np.flatnonzero(still & ~np.roll(still, 1)):
        last = first
        while last + 1 < n and still[last + 1]:
            last += 1
        count = last - first + 1
        if count > LONGEST or not _pace_before(points, int(first)) > STILL * usual[first]:
            continue
        if last + 1 < n:
            due = (count + 1) * usual[first]
            shown[first : last + 1] = abs(step[last + 1] - due) < AGAIN * due
        else:  # before the mark could catch up
            ending[first:] = True
    return moving, shown, ending


def _pace_before(points: Array, first: int) -> float:
    """Mean step before a standstill, which distinguishes a repeated frame from a mark that rests before it starts."""
    end = first - 1
    begin = max(end - PACED, 0)
    return float(np.hypot(*(points[end] - points[begin]))) / (end - begin) if end > begin else 0.0
