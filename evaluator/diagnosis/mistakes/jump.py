"""Jumps of both marks between two frames, as of a camera that is hit or of a robot that is displaced. Plate, mm, s."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from evaluator.diagnosis.likelihood.run_data import RunData

Floats = NDArray[np.float64]

AROUND_JUMP = 10  # frames on either side of a jump over which the path is nearly straight
MOST_JUMPS = 20  # positions of a run that are examined, those with the largest deviations first
JUMP_WITHIN = 8  # frames: up to six of those next to a jump may have been rejected as outliers
LEAST_JUMP_MM = 0.05  # if one side reverses 10 ms before the other, the position changes by 0.03 mm
# One side may start or stop so much before the other, through play of its gear or stiction: three frames of a camera.
# Until then the robot turns about the wheels that stand, which displaces it by less than the change of its speed in
# this time.
STAGGERED_S = 0.05
OF_ROUNDING = 1.5  # lines on either side of a step are each off by half the unit in x and y: √2 of it together
MOST_LOST = 3  # consecutive frames that recorders drop without notice
FEWEST_AROUND = 5  # frames on either side that determine a line and its scatter
LEAST_SPEED_MM_S = 1e-9  # below it a robot is at rest, and what speed a line has is rounding


def jump(run: RunData, within: float = JUMP_WITHIN) -> tuple[float, float] | None:
    """Time, s, and size, mm, of a jump of both marks between two frames; None if there is none.

    within: most frames between the two, besides the first.

    A robot moves by its speed times the frame interval; a camera that is hit moves at once. Lines through some frames
    before and after are extrapolated to the time between. Not counted are jumps of one mark alone, such as the trace of
    an outlier in smoothed tracks; beside a change of velocity, as of motors that start between two frames or one after
    the other; and along the path, as of lost frames.
    """
    seen = np.isfinite(run.marks_mm).all(axis=1)
    time, marks = run.time_s[seen], run.marks_mm[seen]
    new = np.insert(np.diff(marks, axis=0).any(axis=1), 0, True)[: len(marks)]
    stepping = 2 * np.count_nonzero(new) < len(new)  # poses that are repeated until the next one change in steps
    if not stepping:  # a recorder repeats a frame if there is no new one
        time, marks = time[new], marks[new]
    if len(time) < 24:
        return None
    frame_s = float(np.median(np.diff(time)))
    middle_steps = np.diff(_middle(marks), axis=0)
    steps = np.hypot(*middle_steps.T)
    least_mm = max(LEAST_JUMP_MM, OF_ROUNDING * rounding_mm(marks))
    if stepping and steps.any():
        least_mm = max(least_mm, 4 * float(np.median(steps[steps > 0])))
    spans = np.maximum(np.diff(time), 1e-6)
    places = _largest_deviations(middle_steps, spans)
    sides = np.minimum(places + 1, len(time) - 1 - places)  # frames before and after
    places = places[(sides >= FEWEST_AROUND) & (spans[places] <= within * frame_s)]
    if not len(places):
        return None
    sizes = _sizes(time, marks, places, least_mm, frame_s)
    best = int(np.argmax(sizes))
    at = (time[places[best]] + time[places[best] + 1]) / 2
    return (float(at), float(sizes[best])) if sizes[best] > 0 else None


def frames_ahead(run: RunData, at_s: float) -> int:
    """Frames by which a robot would get as far as it jumps at a time, s; 0 if the jump is not ahead along its path.

    More than MOST_LOST at once are lost now and then: that looks like a jump of the camera along the path.
    """
    seen = np.isfinite(run.marks_mm).all(axis=1)
    time, marks = run.time_s[seen], run.marks_mm[seen]
    place = np.array([int(np.searchsorted(time, at_s)) - 1])
    around, at = np.arange(AROUND_JUMP), np.array([at_s])
    before, slope, spread = _lines_at(time, marks, place[:, None] - around, at)
    after, next_slope, next_spread = _lines_at(time, marks, place[:, None] + 1 + around, at)
    (leap,), (speed,) = _middle(after - before), (_middle(slope) + _middle(next_slope)) / 2
    fast, across = float(np.hypot(*speed)), abs(float(leap[0] * speed[1] - leap[1] * speed[0]))
    least_mm = max(10 * float(max(spread[0], next_spread[0])), LEAST_JUMP_MM)
    if fast < LEAST_SPEED_MM_S or across > least_mm * fast or leap @ speed <= 0:
        return 0
    return round(float(leap @ speed) / fast**2 / float(np.median(np.diff(time))))


def rounding_mm(marks_mm: Floats) -> float:
    """The unit to which coordinates (n, 4) are rounded: the least difference between two of them; nm do not count."""
    values = np.unique(np.round(marks_mm, 6))
    return float(np.diff(values).min()) if len(values) > 1 else 0.0


def _largest_deviations(steps_mm: Floats, spans_s: Floats) -> NDArray[np.int64]:
    """The frames, at most MOST_JUMPS, after which a step (n, 2) deviates most from the usual velocity around it."""
    speeds = steps_mm / spans_s[:, None]
    usual = ndimage.median_filter(speeds, size=(2 * AROUND_JUMP - 1, 1), mode="nearest")
    return np.argsort(-np.hypot(*((speeds - usual) * spans_s[:, None]).T))[:MOST_JUMPS]


def _sizes(time_s: Floats, marks: Floats, places: NDArray[np.int64], least_mm: float, frame_s: float) -> Floats:
    """Sizes (m,), mm, of jumps after some frames (m,); 0 where noise or a motion of the robot explains the step."""
    span = np.maximum(time_s[places + 1] - time_s[places], 1e-6)
    at = (time_s[places] + time_s[places + 1]) / 2
    around = np.arange(AROUND_JUMP)
    before, slope, spread = _lines_at(time_s, marks, places[:, None] - around, at)
    after, next_slope, next_spread = _lines_at(time_s, marks, places[:, None] + 1 + around, at)
    step, slope, next_slope = after - before, _middle(slope), _middle(next_slope)
    first, other, leap = step[:, :2], step[:, 2:], _middle(step)
    size = np.hypot(leap[:, 0], leap[:, 1])
    least = np.maximum(10 * np.maximum(spread, next_spread), least_mm)
    # lost frames; tracks that were smoothed or numbered without regard to a gap are behind by it
    changed, lost = (-2 * span, 2 * span), (frame_s - span - 1e-9, np.full_like(span, MOST_LOST * frame_s))
    refused = np.hypot(*(first - other).T) > size
    refused |= size <= STAGGERED_S * np.hypot(*(next_slope - slope).T)
    for speed, within in ((next_slope - slope, changed), (slope, lost), (next_slope, lost)):
        refused |= _covers(speed, within, leap, least)
    return np.where(refused | (size <= least), 0.0, size)


def _lines_at(time_s: Floats, marks: Floats, frames: NDArray[np.int64], at_s: Floats) -> tuple[Floats, Floats, Floats]:
    """Values and slopes (m, 4) at times (m,) of lines through frames (m, k) of marks (n, 4), and their scatter.

    The scatter (m,), mm, is the RMS distance of the midpoint of the marks. Frames outside of the run do not count.
    """
    used = (frames >= 0) & (frames < len(time_s))
    frames = np.where(used, frames, 0)
    since, seen = time_s[frames] - at_s[:, None], marks[frames]
    count = used.sum(axis=1, keepdims=True)
    center = np.sum(since * used, axis=1, keepdims=True) / count
    mean = np.sum(seen * used[..., None], axis=1) / count
    off, away = (since - center) * used, seen - mean[:, None]
    slope = np.einsum("mk,mkc->mc", off, away) / np.sum(off**2, axis=1, keepdims=True)
    left = _middle(away - off[..., None] * slope[:, None]) * used[..., None]
    scatter = np.sqrt(np.sum(left**2, axis=(1, 2)) / (2 * count[:, 0]))
    return mean - center * slope, slope, scatter


def _middle(marks: Floats) -> Floats:
    """Midpoint (..., 2) of two marks (..., 4)."""
    return (marks[..., :2] + marks[..., 2:]) / 2


def _covers(speed: Floats, within_s: tuple[Floats, Floats], leap: Floats, least_mm: Floats) -> NDArray[np.bool_]:
    """Where velocities (m, 2), mm/s, explain jumps (m, 2), mm, in times between two bounds, up to least_mm across."""
    fast = np.hypot(speed[:, 0], speed[:, 1])
    ahead = speed / np.maximum(fast, LEAST_SPEED_MM_S)[:, None]
    along, across = np.sum(leap * ahead, axis=1), leap[:, 0] * ahead[:, 1] - leap[:, 1] * ahead[:, 0]
    covered = (within_s[0] * fast <= along) & (along <= within_s[1] * fast) & (np.abs(across) <= least_mm)
    return np.asarray(covered & (fast > LEAST_SPEED_MM_S), dtype=np.bool_)
