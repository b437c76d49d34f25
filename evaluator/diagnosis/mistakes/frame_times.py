"""What is wrong with the times of frames: another unit, frame numbers, and frames that were lost without a gap.

Where a recorder lost frames while the times of the file count on, the robot advances by whole frames of its motion at
once, along its path and in heading alike. No force moves a robot so, and a camera or robot that is displaced does not
move it by exactly what it drives in a whole frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.disturbances import SETTLED_S, way_over_rolled
from evaluator.diagnosis.mistakes.motion import arm_mm, midpoint_and_heading
from evaluator.diagnosis.mistakes.recognised import Correction, Found, Kind
from evaluator.robust import PER_MEDIAN
from simulator.robot import Robot

Floats = NDArray[np.float64]

# Longest time between two frames of a video that is read as seconds; and of true seconds, for other units.
LONGEST_FRAME_S, USUAL_FRAME_S = 0.9, (5e-4, 0.25)
SLOW_SHARE = 0.2  # of the path that the wheels would roll: at five frames a second or more, frame numbers are slower
UNITS_S = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}
AROUND_S = 0.3  # on either side of a place; a cubic follows the ripple of a wheel that turns once a second
FEWEST = 8  # frames on either side
# Standard errors of an advance by whole frames. Without lost frames, the largest of 1394 untidy runs of 600 places each
# was 4.6, and so was the largest delay. If another run lost frames, a loss is a thousand times as likely as otherwise.
SIGMAS, SIGMAS_IF_ANOTHER = 5.5, 4.0
LEAST_MM = 0.02  # of an advance: pixel phase and codec move both marks of a rendered video by up to 0.01 mm
WHOLE = 0.3  # largest difference from a whole number of frames
MOST_AT_ONCE = 8  # frames; more at once are a jump
REGULAR = 0.1  # largest deviation, in frames, of times that count frames; stamps of a driver scatter more
OUTLIER = 6.0  # scatters of a frame about the middle of its neighbours, beyond which it is omitted
ALONE = 1.5  # times the deviation of a neighbour from its own neighbours: 2 for an outlier, 1 for a step
UNSTEADY = 0.5  # largest change of the speed within half a window, as a share; a ripple of 20 % changes it by less
# Times the median speed of a command, from which something else moves the robot: lost frames do not change the speed
# beside them, a ripple of the wheels by less than half, and a push of 1 mm in 0.1 s multiplies it.
PUSHED = 2.0


@dataclass(frozen=True)
class Loss:
    """Lost frames: time of the first frame after them, s, as the file counts, their number and their duration, s."""

    time_s: float
    frames: int
    missing_s: float


def wrong_seconds(data: Sequence[RunData], robots: Sequence[Robot]) -> list[Found]:
    """Runs whose times are in another unit than seconds, or are the numbers of the frames.

    Their frames are seconds apart, and the robot hardly gets anywhere in that time.
    """
    found, (low, high) = [], USUAL_FRAME_S
    for run, robot in zip(data, robots, strict=True):
        step = float(np.median(np.diff(run.time_s))) if len(run.time_s) > FEWEST else 0.0
        if step < LONGEST_FRAME_S:
            continue
        whole = replace(run, start_s=float(run.time_s[0]), stop_s=None)  # start and stop may be in seconds
        if way_over_rolled(whole, robot) > SLOW_SHARE:
            continue
        seen = f"its frames are {step:.4g} s apart, in which its wheels would roll far"
        if step < 1 + REGULAR and np.abs(run.time_s - np.rint(run.time_s)).max() < REGULAR:
            remedy = "its times seem to be frame numbers: divide them by the frame rate"
            found.append(Found(run.id, "wrong-unit", seen, remedy))
            continue
        for unit, factor in [item for item in UNITS_S.items() if low < step * item[1] < high][:1]:
            remedy = f"its times seem to be in {unit}: convert them to seconds"
            found.append(Found(run.id, "wrong-unit", seen, remedy, correction=Correction(seconds_times=factor)))
    return found


def runs_with_lost_frames(data: Sequence[RunData], robots: Sequence[Robot]) -> list[Found]:
    """Runs whose recorder lost frames while its times count on."""
    del robots
    if not any(lost_frames(run) for run in data):
        return []
    losing = {run.id: losses for run in data if (losses := lost_frames(run, SIGMAS_IF_ANOTHER))}
    together = tuple(losing) if len(losing) > 2 else ()
    filmed = {run.id for run in data if run.filmed}
    found = []
    for run, losses in losing.items():
        of = f"of {run} " * bool(together)
        seen = f"frames are missing ({of}{_words(losses)}), but the times count on, so that the motion is ahead of them"
        pushed = len(losses) == 1 and not together
        seen += ", or it was pushed along its path there" * pushed
        remedy = "record with time stamps; `turnscope track` reads those of the original video"
        if run in filmed:
            remedy = "look at the video there, and record with time stamps"
        correction = Correction(lost_s=tuple((loss.time_s, loss.missing_s) for loss in losses))
        equivalent: tuple[Kind, ...] = ("pushed",) if pushed else ()
        found.append(Found(run, "wrong-rate", seen, remedy, equivalent, correction, together))
    return found


def _words(losses: Sequence[Loss]) -> str:
    """Number and first places of lost frames."""
    places = ", ".join(f"{loss.time_s:.2f}" for loss in losses[:3]) + (", …" if len(losses) > 3 else "")
    return f"{sum(loss.frames for loss in losses)} at {places} s"


def lost_frames(run: RunData, sigmas: float = SIGMAS) -> list[Loss]:
    """Places at which frames of a run were lost without a gap in its times, in the order of time.

    sigmas: least standard errors of an advance. None if the times do not count frames, as those of poses and drivers;
    if the robot is too slow for its noise; or if it is behind at once as well, as a robot that sticks and slips.
    """
    time, middle, heading = midpoint_and_heading(run)
    numbers, frame_s = frame_numbers(run.time_s)
    if len(time) < 4 * FEWEST or not len(numbers) or run.from_poses:
        return []
    seen = np.isfinite(run.marks_mm).all(axis=1)
    count, marks, around = numbers[seen], run.marks_mm[seen], max(FEWEST, round(AROUND_S / frame_s))
    course = np.column_stack([middle, heading * arm_mm(run)])
    wrong = _is_outlier(course)
    course[wrong] = marks[wrong] = np.nan
    parts = _steady_parts(run, time)
    losses: dict[int, int] = {}
    while len(losses) < len(time) // (2 * FEWEST):
        advance, sigma, speed = advances(count, course, around)
        advance[~_is_usual(speed, parts)] = np.nan
        whole = np.rint(advance)
        clear = (np.abs(advance) > sigmas * sigma) & (np.abs(advance - whole) < WHOLE)
        clear &= (np.abs(whole) <= MOST_AT_ONCE) & (np.abs(whole) * speed > LEAST_MM)
        if clear.any():
            clear &= _of_both_marks(count, marks, around, whole)
        if not np.any(clear & (whole > 0)):
            if clear.any():
                return []
            break
        best = int(np.argmax(np.where(clear, advance / sigma, 0.0)))
        losses[best] = losses.get(best, 0) + int(whole[best])
        count = count + (np.arange(len(time)) >= best) * int(whole[best])
    return [Loss(float(time[at]), frames, frames * frame_s) for at, frames in sorted(losses.items())]


def frame_numbers(time_s: Floats) -> tuple[NDArray[np.int64], float]:
    """Number (n,) of each frame, from 0, and the time between two, s; no numbers if the times do not count frames."""
    steps = np.diff(time_s)
    usual = float(np.median(steps)) if len(steps) else 0.0
    none = np.zeros(0, dtype=np.int64), usual
    if usual <= 0 or not np.isfinite(steps).all():
        return none
    numbers = np.concatenate([[0], np.cumsum(np.rint(steps / usual).astype(np.int64))])
    off = numbers - numbers.mean()
    frame_s = float(off @ (time_s - time_s.mean()) / (off @ off))  # slope of a line
    begin = time_s.mean() - frame_s * numbers.mean()
    counts = np.diff(numbers).min() > 0 and np.abs((time_s - begin) / frame_s - numbers).max() < REGULAR
    return (numbers, frame_s) if counts else none


def advances(count: NDArray[np.int64], course: Floats, around: int) -> tuple[Floats, Floats, Floats]:
    """How far the motion is ahead from each frame on, in frames, NaN where not known; standard error; mm a frame; (n,).

    count: number (n,) of each frame. course: (n, k) places, or place and heading times a lever, mm. around: frames on
    either side, to which a cubic in time and a step are fitted; the step along the velocity is the advance.
    """
    first, last = int(count[0]), int(count[-1])
    columns = course.shape[1]
    grid, beyond = np.full((last - first + 1, columns), np.nan), np.full((around, columns), np.nan)
    grid[count - first] = course
    padded = np.concatenate([beyond, grid, beyond])
    seen = np.isfinite(padded).all(axis=1)
    at = count - first  # frame `at` is the first after the step
    windows = sliding_window_view(padded, 2 * around, axis=0)[at]  # (n, k, 2 around)
    used = sliding_window_view(seen, 2 * around)[at].astype(float)
    since = (np.arange(2 * around) - around + 0.5) / around
    design = np.column_stack([np.ones_like(since), since, since**2, since**3, since > 0])
    normal = (used @ np.einsum("ki,kj->kij", design, design).reshape(2 * around, -1)).reshape(-1, 5, 5)
    enough = (used[:, :around].sum(axis=1) >= FEWEST) & (used[:, around:].sum(axis=1) >= FEWEST)
    normal[~enough] = np.eye(5)
    values = np.where(used[:, None, :] > 0, windows, 0.0)
    inverse = np.linalg.inv(normal)
    fit = (values @ design) @ inverse  # (n, k, 5); the inverse is symmetric
    left = values - (fit @ design.T) * used[:, None, :]
    degrees = np.maximum(used.sum(axis=1) - 5, 1.0)
    scatter = np.sqrt(np.einsum("nck,nck->n", left, left) / (columns * degrees))
    speed, step = fit[:, :, 1] / around, fit[:, :, 4]
    square = np.maximum(np.einsum("nc,nc->n", speed, speed), 1e-300)
    for at_share in (-0.5, 0.5):  # a robot that starts or stops there is not ahead
        beside = (fit[:, :, 1] + 2 * at_share * fit[:, :, 2] + 3 * at_share**2 * fit[:, :, 3]) / around
        enough &= np.abs(np.einsum("nc,nc->n", beside, speed) / square - 1) < UNSTEADY
    advance = np.einsum("nc,nc->n", step, speed) / square
    sigma = scatter * np.sqrt(inverse[:, 4, 4] / square)
    advance[~enough] = np.nan
    usual = np.isfinite(advance)
    if usual.any():  # correlated noise, or a motion that a cubic does not follow, scatters more
        sigma = sigma * max(1.0, PER_MEDIAN * float(np.median(np.abs(advance[usual] / sigma[usual]))))
    return advance, sigma, np.sqrt(square)


def _of_both_marks(count: NDArray[np.int64], marks: Floats, around: int, whole: Floats) -> NDArray[np.bool_]:
    """Whether both marks (n, 4) alone are ahead by more than half of so many frames (n,).

    One alone that is, was interpolated over frames in which it was not seen, or confused with something else.
    """
    own = [advances(count, marks[:, part], around)[0] for part in (slice(2), slice(2, 4))]
    return np.asarray(np.all([each / np.where(whole, whole, 1.0) > 0.5 for each in own], axis=0))


def _is_outlier(course: Floats) -> NDArray[np.bool_]:
    """Frames (n,) that alone are far from the middle of their two neighbours, in any of the columns (n, 3).

    An outlier moves its neighbours' middle by half; a step moves it on both sides alike, and is none.
    """
    off = np.zeros_like(course)
    off[1:-1] = np.abs(course[1:-1] - (course[:-2] + course[2:]) / 2)
    far = off > OUTLIER * PER_MEDIAN * np.median(off, axis=0)
    far[1:-1] &= off[1:-1] > ALONE * np.maximum(off[:-2], off[2:])
    return np.asarray(far.any(axis=1))


def _steady_parts(run: RunData, time: Floats) -> list[NDArray[np.bool_]]:
    """For every command, the frames (n,) at least SETTLED_S from its beginning and its end."""
    return [(time > item.begin_s + SETTLED_S) & (time < item.end_s - SETTLED_S) for item in run.run_command.driven]


def _is_usual(speed: Floats, parts: Sequence[NDArray[np.bool_]]) -> NDArray[np.bool_]:
    """Frames (n,) of these parts at which the robot is not pushed."""
    usual = np.zeros(len(speed), dtype=np.bool_)
    for part in parts:
        if part.any():
            usual |= part & (speed < PUSHED * np.median(speed[part]))
    return usual
