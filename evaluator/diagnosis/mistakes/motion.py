"""Measured motion without a model: start, velocity and displacements of a run. Plate frame, mm, s, rad."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.robust import PER_MEDIAN, robust_sigma
from evaluator.turning.motion.rest import MOVING_FRAMES, ONSET_LEAST_MM, ONSET_SIGMAS, RESTS_S

Floats = NDArray[np.float64]

WINDOW_S = 0.15  # of a velocity: nine frames at 60/s, shorter than any push by hand
ONSET_SPAN_S = 0.4  # motion from which the onset is extrapolated, at most; over so short a path, it is a steady arc
ONSET_TURN_RAD = np.pi  # largest turn in it: a fast pivot has turned by more in ONSET_SPAN_S, and comes back
STAYS_AWAY = 0.8  # of the frames in ONSET_SPAN_S: noise that a tracker smoothed over nine frames returns within five
FEWEST_AT_REST = 3  # one wrong frame does not move their median
SHORTEST_GAP_S, LONGEST_GAP_S = 0.1, 1.0  # shorter gaps are too short for a hand; after longer ones nothing is known
LACKS_A_FRAME = 1.5  # usual times between frames: of ten frames a second none is missing, though each is 0.1 s apart
AROUND_GAP = 15  # frames on either side: a quarter of a second
FEWEST_AROUND = 8  # a line through eight errs by 1.3 times their scatter half a window later: GAP_SIGMAS is beyond
GAP_SIGMAS = 8.0  # scatter of a frame: a velocity from 15 frames is extrapolated over a gap of a few times as many
LEAST_LEAP_MM = 0.2  # three times the largest of 24 errors of tracking over a gap; hands move a robot farther
# The largest of about ten values along a rippled run is nearly the largest that occurs: twice as much is no ripple.
UNSTEADY_TIMES = 2.0
REST_S = 0.08  # beginning of a recording in which the robot is assumed at rest, unless it moves
CARRIED_SHARE = 0.1  # of the distance of the marks, a third of a millimetre: hands carry a robot farther
# A start is soft if a parabola fits its way better than a line by so many sigmas: of 2,400 starts at once, 19 were
# taken for soft ones by chance, all at 0.2 mm/s.
SOFT_SIGMAS, CLIPPED_SIGMAS = 3.0, 3.0  # a wrong mark counts no more than the latter


@dataclass(frozen=True)
class Motion:
    """Smoothed motion of the midpoint of the marks at some moments.

    time_s (m,); along, across: velocity (m,) in the frame of the marks (their left is to the left), mm/s; yaw (m,)
    rad/s.
    """

    time_s: Floats
    along: Floats
    across: Floats
    yaw: Floats


def midpoint_and_heading(run: RunData) -> tuple[Floats, Floats, Floats]:
    """Times (n,), midpoints (n, 2) and headings (n,), rad, unwrapped, of the frames in which both marks were seen."""
    seen = np.isfinite(run.marks_mm).all(axis=1)
    marks = run.marks_mm[seen]
    across = marks[:, :2] - marks[:, 2:]
    heading = np.unwrap(np.arctan2(across[:, 1], across[:, 0])) - run.line_rad
    return run.time_s[seen], (marks[:, :2] + marks[:, 2:]) / 2, heading


def motion_of(run: RunData, between: tuple[float, float] | None = None) -> Motion | None:
    """Velocities as slopes over WINDOW_S, at moments half a window apart; None for too few frames."""
    time, middle, heading = midpoint_and_heading(run)
    low, high = between or (time[0], time[-1])
    centers = np.arange(low + WINDOW_S / 2, high - WINDOW_S / 2, WINDOW_S / 2)
    rows = []
    for center in centers:
        inside = np.abs(time - center) <= WINDOW_S / 2
        if inside.sum() < 3:
            continue
        since = time[inside] - time[inside].mean()
        if not (square := float(since @ since)):
            continue
        vx, vy = since @ middle[inside] / square
        angle = float(np.median(heading[inside]))
        rows.append(
            (
                center,
                vx * np.cos(angle) + vy * np.sin(angle),
                -vx * np.sin(angle) + vy * np.cos(angle),
                float(since @ heading[inside]) / square,
            )
        )
    if len(rows) < 4:
        return None
    return Motion(*np.array(rows).T)


@dataclass(frozen=True)
class Onset:
    """Time at which motion begins, s, and its standard error, s: tenths of a second for slow marks in noise.

    time_s: where the line through the way of the faster mark between two times, span_s, is 0.
    softly_s: earlier time at which it began if the speed rises evenly in the whole span; None if a line fits the way.
    rests_until_s: later time until which the robot rests because it sets out faster than it goes on; None if the marks
    follow the line from its beginning on.
    """

    time_s: float
    sigma_s: float
    span_s: tuple[float, float]
    softly_s: float | None = None
    rests_until_s: float | None = None


def onset(run: RunData) -> Onset | None:
    """Time at which motion begins: the way of the faster mark from its rest position, extrapolated back to 0.

    The way is the arc over its distance, according to the turn of the robot: by its chords, a pivot would seem to slow
    down, and to have begun earlier. None without visible rest before it, or without motion. A lag of the motors delays
    it by its time constant.

    What comes to rest again before start_s within less than a hand carries a robot was no start: the coarse first image
    of a strongly compressed recording becomes finer, or something touches the robot.
    """
    found = _onset(run)
    before = (run.time_s >= run.start_s - RESTS_S) & (run.time_s < run.start_s)
    began_s = float(run.time_s[0]) if found is None else found.time_s
    if began_s >= run.start_s - RESTS_S or not _rests_near_its_first_place(run, before, began_s):
        return found
    later = slice(int(np.argmax(before)), len(run.time_s))
    return _onset(replace(run, time_s=run.time_s[later], marks_mm=run.marks_mm[later]))


def _rests_near_its_first_place(run: RunData, frames: NDArray[np.bool_], began_s: float) -> bool:
    """Whether a run is at rest in some frames (n,), and no farther from its first ones than by a touch.

    began_s: time at which it seems to leave its first place; at rest it is slower than half its mean speed since then.
    """
    seen = np.isfinite(run.marks_mm).all(axis=1)
    marks, first = run.marks_mm[frames & seen], np.median(run.marks_mm[seen][:FEWEST_AT_REST], axis=0)
    if len(marks) < 2 * FEWEST_AT_REST:
        return False
    half = len(marks) // 2
    place, early, late = (np.median(some, axis=0) for some in (marks, marks[:half], marks[half:]))
    time_s = run.time_s[frames & seen]
    lapse_s = float(time_s[half:].mean() - time_s[:half].mean())
    off, moved, further = (
        np.hypot(x[..., ::2], x[..., 1::2]).max() for x in (marks - place, place - first, late - early)
    )
    slower = further / lapse_s < moved / (run.start_s - began_s) / 2
    return bool(off < ONSET_LEAST_MM and moved < CARRIED_SHARE * 2 * arm_mm(run) and slower)


def _onset(run: RunData) -> Onset | None:
    """Time at which motion begins after the rest of the first frames."""
    seen = np.isfinite(run.marks_mm).all(axis=1)
    time, marks = run.time_s[seen], run.marks_mm[seen]
    rest = max(FEWEST_AT_REST, int(np.searchsorted(time, time[0] + REST_S)))
    if len(time) < 3 * rest:
        return None
    off = marks - np.median(marks[:rest], axis=0)
    bends = np.diff(marks, n=2, axis=0)  # nearly only noise, also of a moving robot: √6 times that of a frame
    # both are robust: a wrong mark in one of the first frames is not motion
    scatter = PER_MEDIAN * max(float(np.median(np.abs(bends))) / 6**0.5, float(np.median(np.abs(off[:rest]))))
    away = np.maximum(np.hypot(off[:, 0], off[:, 1]), np.hypot(off[:, 2], off[:, 3]))
    least = ONSET_SIGMAS * scatter + ONSET_LEAST_MM
    beyond = away > least
    moving = np.flatnonzero(np.lib.stride_tricks.sliding_window_view(beyond, MOVING_FRAMES).all(axis=1))
    ends = np.searchsorted(time, time[moving] + ONSET_SPAN_S)
    moving = moving[[beyond[at:end].mean() >= STAYS_AWAY for at, end in zip(moving, ends, strict=True)]]
    if not len(moving) or moving[0] < rest:
        return None
    first = int(moving[0])
    heading = midpoint_and_heading(run)[2]
    turned = np.abs(heading - np.median(heading[:rest]))
    last = int(np.searchsorted(time, time[first] + ONSET_SPAN_S))
    part = slice(first, first + int(np.argmax(np.append(turned[first:last] >= ONSET_TURN_RAD, True))))
    if len(time[part]) < FEWEST_AT_REST:
        return None
    since = time[part] - time[first]
    way = away[part] / np.sinc(turned[part] / (2 * np.pi))  # arc per chord
    slope, level = robust_line(way, since)
    if slope <= 0:
        return None
    begins = float(-level / slope)
    # of a line extrapolated from its middle, and of the rest position, a median of this number of frames
    line = 1 / len(since) + (since.mean() - begins) ** 2 / max(float(np.sum((since - since.mean()) ** 2)), 1e-300)
    sigma = scatter / slope * float(np.sqrt(line + np.pi / 2 / rest))
    # a robot that moves already would appear to start in the middle of the assumed rest
    onset_s, span_s = time[first] + begins, (float(time[first]), float(time[part][-1]))
    softly = _of_a_soft_start(way, since, scatter)
    softly_s = None if softly is None else float(time[first]) + softly
    begun = Onset(onset_s, sigma, span_s, softly_s, _rests_until(time, off, part, slope, onset_s, scatter))
    return begun if onset_s > max(time[0] + REST_S, time[rest - 1]) else None


def _rests_until(
    time: Floats, off: Floats, moving: slice, slope: float, onset_s: float, scatter_mm: float
) -> float | None:
    """Time until which the marks rest although the line of their way has begun; None if they do not rest significantly.

    time (n,); off (n, 4): marks from their places at rest. moving: the frames of the line, slope its speed, mm/s. The
    most probable end of rest, by the ratio of the likelihoods of rest and of the line.
    """
    way = off[moving][:FEWEST_AROUND]
    faster = (
        slice(2, 4) if np.hypot(*np.median(way[:, 2:], axis=0)) > np.hypot(*np.median(way[:, :2], axis=0)) else slice(2)
    )
    ahead = np.median(way[:, faster], axis=0)
    between = slice(int(np.searchsorted(time, onset_s)), moving.start)
    seen, line = off[between, faster] @ (ahead / np.hypot(*ahead)), slope * (time[between] - onset_s)
    rests = np.cumsum(line * (line / 2 - seen))
    if not len(rests) or rests.max() <= (SOFT_SIGMAS * scatter_mm) ** 2 / 2:
        return None
    return float(time[between][int(np.argmax(rests))])


def _of_a_soft_start(way: Floats, since: Floats, scatter_mm: float) -> float | None:
    """Time at which a way (n,), mm, at times since (n,), s, begins as a parabola; None if a line fits it about as well.

    The root of the way of an even acceleration from rest is a line.
    """
    slope, level = robust_line(way, since)
    root_slope, root_level = robust_line(np.sqrt(way), since)
    if root_slope <= 0:
        return None
    by_line, by_parabola = way - slope * since - level, way - (root_slope * since + root_level) ** 2
    most = CLIPPED_SIGMAS * max(scatter_mm, robust_sigma(by_line))
    line, parabola = (float(np.sum(np.clip(left, -most, most) ** 2)) for left in (by_line, by_parabola))
    return -root_level / root_slope if line - parabola > (SOFT_SIGMAS * scatter_mm) ** 2 else None


def displacement_in_gap(run: RunData, between: tuple[float, float]) -> tuple[float, float, float] | None:
    """Begin and end, s, of an interval without frames in which a run is displaced, and by how much, mm; else None.

    between: interval, s, of constant command, because a start or a stop is not a push.
    """
    time, _, _ = midpoint_and_heading(run)
    steps = np.diff(time)
    shortest_s = max(SHORTEST_GAP_S, LACKS_A_FRAME * float(np.median(steps))) if len(steps) else SHORTEST_GAP_S
    gaps = np.flatnonzero((steps > shortest_s) & (steps < LONGEST_GAP_S))
    displaced = [
        (float(time[k]), float(time[k + 1]), displacement_over(run, (time[k], time[k + 1]), between)) for k in gaps
    ]
    best = max(displaced, key=lambda item: item[2], default=None)
    return best if best is not None and best[2] > 0 else None


def displacement_over(run: RunData, stretch: tuple[float, float], between: tuple[float, float]) -> float:
    """Displacement, mm, of a mark of a run off its path during an interval, s; 0 if chance explains it.

    between: interval, s, of constant command. A rotation by hand displaces a mark by its angle times half the distance
    of the marks.

    The expected motion is an arc with the body-frame velocity before for half of the interval, and with that after for
    the other half, from the last pose before to the first pose after. A displacement from it counts beyond noise, the
    difference of the two velocities, and the variations of this run elsewhere.
    """
    course, arm = midpoint_and_heading(run), arm_mm(run)
    missing, allowed = _missing_over(course, stretch, between, arm)
    if missing <= max(allowed, LEAST_LEAP_MM):
        return 0.0
    return missing if missing > UNSTEADY_TIMES * _missing_elsewhere(course, stretch, between, arm) else 0.0


def _missing_elsewhere(
    course: tuple[Floats, Floats, Floats], stretch: tuple[float, float], between: tuple[float, float], arm_mm: float
) -> float:
    """Largest displacement, mm, in other intervals of this length with frames, from ripple or uneven ground."""
    time, length = course[0], stretch[1] - stretch[0]
    around = AROUND_GAP * float(np.median(np.diff(time)))
    most = 0.0
    for begin in np.arange(between[0] + around, between[1] - around - length, length / 8):  # meets peaks of a ripple
        low, high = begin - around, begin + length + around
        inside = np.concatenate([[low], time[(time >= low) & (time <= high)], [high]])  # no gap at its ends either
        if (high < stretch[0] or low > stretch[1]) and np.diff(inside).max() < SHORTEST_GAP_S:
            most = max(most, _missing_over(course, (begin, begin + length), between, arm_mm)[0])
    return most


def _missing_over(
    course: tuple[Floats, Floats, Floats], stretch: tuple[float, float], between: tuple[float, float], arm_mm: float
) -> tuple[float, float]:
    """Displacement from the expected motion in an interval, and the part that noise and a change of speed explain, mm.

    course: times (n,), midpoints (n, 2) and headings (n,) from `midpoint_and_heading`. Both are 0 for too few frames
    before or after, or a long time without any beside the interval.
    """
    time, middle, heading = course
    before = np.flatnonzero((time >= between[0]) & (time <= stretch[0]))[-AROUND_GAP:]
    after = np.flatnonzero((time >= stretch[1]) & (time <= between[1]))[:AROUND_GAP]
    if min(len(before), len(after)) < FEWEST_AROUND:
        return 0.0, 0.0
    ends = time[before[-1]], time[after[0]]
    if ends[1] - ends[0] > stretch[1] - stretch[0] + LONGEST_GAP_S:  # the robot left the view beside the stretch
        return 0.0, 0.0
    views = [_moving_at(time[p], middle[p], heading[p], at) for p, at in zip((before, after), ends, strict=True)]
    half = float(ends[1] - ends[0]) / 2
    met = [_carried(pose, velocity, way) for (pose, velocity, _), way in zip(views, (half, -half), strict=True)]
    unlike = _carried_mark(views[1][1] - views[0][1], arm_mm) * half  # speeds that differ, held for half the stretch
    spans = [float(np.ptp(time[part])) for part in (before, after)]
    chance = GAP_SIGMAS * max(view[2] for view in views) * (1 + 2 * half / max(*spans, 1e-9))
    return _carried_mark(met[1] - met[0], arm_mm), chance + unlike


def arm_mm(run: RunData) -> float:
    """Distance from the midpoint of the marks to one of them, mm."""
    return float(np.nanmedian(np.hypot(*(run.marks_mm[:, :2] - run.marks_mm[:, 2:]).T))) / 2


def _carried_mark(change: Floats, arm_mm: float) -> float:
    """Largest displacement of a mark by a change of pose or velocity (3,), mm (or mm/s), from shift and rotation."""
    return float(np.hypot(*change[:2]) + arm_mm * abs(change[2]))


def robust_line(values: Floats, at: Floats) -> tuple[float, float]:
    """Slope and value at 0 by Theil and Sen: the median slope of all pairs, and the line through both medians."""
    rise, run = np.subtract.outer(values, values), np.subtract.outer(at, at)
    slope = float(np.median(rise[run > 0] / run[run > 0]))
    return slope, float(np.median(values) - slope * np.median(at))


def _moving_at(time_s: Floats, middle: Floats, heading: Floats, at_s: float) -> tuple[Floats, Floats, float]:
    """Pose (3,) at a time, velocity (3,) along, across (mm/s), in yaw (rad/s), and scatter, mm, from a few frames."""
    since = time_s - at_s
    yaw, angle = robust_line(heading, since)
    # in the robot's frame a steady turn is straight: the path is rotated back frame by frame
    fits = [robust_line(middle[:, axis], since) for axis in (0, 1)]
    center = time_s.mean() - at_s
    rate = np.array([fit[0] for fit in fits])
    mid = np.array([fit[1] + fit[0] * center for fit in fits])
    c, s = np.cos(angle + yaw * center), np.sin(angle + yaw * center)
    velocity = np.array([c * rate[0] + s * rate[1], -s * rate[0] + c * rate[1], yaw])
    pose = _carried(np.array([*mid, angle + yaw * center]), velocity, -center)
    left = middle - (mid + np.outer(since - center, rate))
    return pose, velocity, float(PER_MEDIAN * np.median(np.abs(left - np.median(left, axis=0))))


def _carried(pose: Floats, velocity: Floats, time_s: float) -> Floats:
    """The pose (3,) after a time at a constant velocity (3,) in the body frame: an arc."""
    turn = velocity[2] * time_s
    mean = pose[2] + turn / 2
    chord = np.sinc(turn / 2 / np.pi) * time_s
    along, across = velocity[0] * chord, velocity[1] * chord
    step = [np.cos(mean) * along - np.sin(mean) * across, np.sin(mean) * along + np.cos(mean) * across, turn]
    return np.asarray(pose + np.array(step))
