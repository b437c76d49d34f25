"""Frames in which a hand moves the robot: it is laid down or nudged before it starts, or taken away after its stop.

That is no mistake, and no motion of the robot's own: the run is what lies between.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.jump import jump
from evaluator.diagnosis.mistakes.motion import CARRIED_SHARE, arm_mm
from evaluator.diagnosis.mistakes.outrun import taken_away_s
from evaluator.robust import sigma_of_bends
from evaluator.turning.motion.rest import MOVING_FRAMES, ONSET_LEAST_MM, ONSET_SIGMAS, RESTS_S

# Starts are known more accurately than the first (late_start.LATE_S), and motors run down within the second.
BEFORE_START_S, AFTER_STOP_S = 0.1, 0.5
# Of the way before start_s: what that in as much time after it may differ by. A turn of the paper's robot by 20 deg/s
# bends the way of half a second by a fifth, and the way of a robot that starts from rest there differs by all of it.
DRIVES_ON = 0.5


def between_hands(run: RunData) -> slice:
    """Frames of a run from the rest after the robot was laid down until it is removed after its stop."""
    time, (on_s, off_s) = run.time_s, (run.run_command.start_s, run.run_command.stop_s)
    begin, end = 0, len(time)
    if run.run_command.starts_at_rest and on_s is not None:
        # a rest until start_s itself shows as well that what was before it is not the robot's own motion
        for rest_s in (on_s - BEFORE_START_S - RESTS_S, on_s - RESTS_S):
            # however little it is moved: frames in which it stood elsewhere do not show where it starts
            carried = _carried(run, rest_s, time < rest_s, 0.0)
            if len(carried):
                laid_down_s = float(time[carried[-1] + MOVING_FRAMES - 1])
                begin = int(np.searchsorted(time, min(laid_down_s + RESTS_S, rest_s)))
                break
        # a nudge too small to be a hand's carrying, and a knock at the camera, do not matter before the start; nor does
        # how many frames around it have no marks, as the robot rests
        nudge = jump(run.first(int(np.searchsorted(time, on_s + RESTS_S))), np.inf)
        if nudge is not None and nudge[0] < on_s - BEFORE_START_S and _seen_from_s(run, nudge[0]) <= on_s:
            begin = max(begin, int(np.searchsorted(time, nudge[0])))
    if off_s is not None:
        far_mm = CARRIED_SHARE * 2 * arm_mm(run)
        carried = _carried(run, off_s + AFTER_STOP_S, time > off_s + AFTER_STOP_S + RESTS_S, far_mm)
        # without a rest in between, a hand is faster than the robot was
        end = int(carried[0]) if len(carried) else int(np.searchsorted(time, taken_away_s(run, off_s)))
    return slice(begin, end)


def _seen_from_s(run: RunData, time_s: float) -> float:
    """The first time from this one on at which both marks are seen."""
    seen = np.isfinite(run.marks_mm).all(axis=1) & (run.time_s >= time_s)
    return float(run.time_s[seen][0]) if seen.any() else np.inf


def moved_before_start_mm(run: RunData) -> float:
    """How far, mm, a mark goes from the first frames to the last that are surely before start_s.

    0 if this is within noise and the settling of a camera, or if there are too few frames. Beyond noise, less than a
    hand moves it counts if it goes on as far in as much time after start_s, the same way: it drives already.
    """
    on_s = run.run_command.start_s
    if not run.run_command.starts_at_rest or on_s is None:
        return 0.0
    seen = np.isfinite(run.marks_mm).all(axis=1)
    time, marks = run.time_s[seen], run.marks_mm[seen]
    before = time < on_s - BEFORE_START_S
    if before.sum() >= 2 * MOVING_FRAMES:
        places = [
            np.median(marks[before][part], axis=0) for part in (slice(MOVING_FRAMES), slice(-MOVING_FRAMES, None))
        ]
        way = _farther(places[1] - places[0])
        if way > CARRIED_SHARE * 2 * arm_mm(run):
            return way
    windows = time < on_s, (time >= on_s) & (time < 2 * on_s - time[0])
    if min(window.sum() for window in windows) < 2 * MOVING_FRAMES:
        return 0.0
    halves = [[np.median(half, axis=0) for half in np.array_split(marks[window], 2)] for window in windows]
    first, then = (later - earlier for earlier, later in halves)
    least = ONSET_SIGMAS * float(np.median(sigma_of_bends(marks))) + ONSET_LEAST_MM
    return 2 * _farther(first) if _farther(first) > max(least, _farther(then - first) / DRIVES_ON) else 0.0


def _farther(shift: NDArray[np.float64]) -> float:
    """The larger of the ways of both marks, mm, of a shift (4,)."""
    return max(float(np.hypot(shift[0], shift[1])), float(np.hypot(shift[2], shift[3])))


def _carried(run: RunData, rest_s: float, outside: NDArray[np.bool_], far_mm: float) -> NDArray[np.int64]:
    """Frames at which some in a row outside begin that are off the place where the robot rests for RESTS_S.

    Empty if it does not rest there, or never deviates by far_mm.
    """
    seen = np.isfinite(run.marks_mm).all(axis=1)
    nowhere = np.zeros(0, dtype=np.int64)
    for lasting_s in (RESTS_S, 2 * RESTS_S):  # the first frames after a sudden stop may count as wrong marks
        resting = (run.time_s >= rest_s) & (run.time_s <= rest_s + lasting_s)
        if (resting & seen).sum() >= MOVING_FRAMES:
            break
    if (resting & seen).sum() < MOVING_FRAMES or not (outside & seen).any():
        return nowhere
    off = run.marks_mm - np.median(run.marks_mm[resting & seen], axis=0)
    scatter = float(np.median(sigma_of_bends(run.marks_mm[seen])))
    away = np.nan_to_num(np.maximum(np.hypot(off[:, 0], off[:, 1]), np.hypot(off[:, 2], off[:, 3])))
    moved = away > ONSET_SIGMAS * scatter + ONSET_LEAST_MM
    in_a_row = np.lib.stride_tricks.sliding_window_view(moved & outside, MOVING_FRAMES).all(axis=1)
    far = np.lib.stride_tricks.sliding_window_view(away, MOVING_FRAMES).min(axis=1) > far_mm
    if moved[resting & seen].sum() > 1 or not (in_a_row & far).any():  # one alone is a wrong mark
        return nowhere
    return np.flatnonzero(in_a_row)
