"""Errors that a single frame cannot show: those of the video codec, from how smoothly marks move.

A codec moves a mark as a whole by a fraction of its motion vector's step (a quarter of a pixel in H.264) and leaves no
trace in the residuals of the fit. Between frames the error shows: marks move smoothly, so what a frame's centre
differs from the course of its neighbours is error.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

OFFSETS = np.array([-5, -4, -3, -2, -1, 1, 2, 3, 4, 5])
REACH = 5
# The course is the quartic through the neighbours by least squares: on a circle of 100 px radius at 0.05 rad a step it
# leaves 1e-3 px. Two more neighbours than it has unknowns, two of them on either side, tell a frame's error.
ORDER, NEIGHBORS, EITHER_SIDE = 5, 7, 2
EVEN = 1e-3  # of the span: neighbours that are as evenly timed as this share one set of weights
BEYOND = 4.0  # times the usual reach: a neighbour farther away, beyond a gap in time, tells nothing of the course
LEAST = 24  # differences that a variance is estimated from: its own relative uncertainty is then below 0.3
ROUNDS = 3  # of weighing: sigmas are then those of any number of rounds to 3 %
EXACT_PX2 = 1e-12  # variance below which all frames tell alike: drawn paths may be known exactly
FEW = 8  # enough to tell that there is an error, where a recording moves no longer than that
MOVING_PX = 0.1  # a step that codecs still take for rest, give or take their own error
STRIDES = (1, 2, 4, 8)
# What a course may leave of a path. On turns of 20 px radius it leaves less over the path STRAIGHT_PX; on wider ones,
# where their radius is seen by the directions over some frames, over more.
LEAVES_PX, STRAIGHT_PX, DIRECTION = 0.01, 6.0, 5
# Errors of codecs have long tails, those of Student's t with about as many degrees of freedom: 0.5 to 1.5 % of frames
# lie beyond 4 sigma on H.264, HEVC and VP9 alike.
FREEDOM = 4.0
# A robot starts, stops or turns back seldom in a recording; what recurs is the codec's. Sigmas that chance reaches once
# in 3e5 frames, and those of each mark of a body, which one in eight reaches.
CHANGES, ABRUPT, SEEN = 3, 5.0, 2.0
TAIL = 3.0  # sigmas off the course from which a frame's own error counts as a large one: nearer ones tell nothing


CLOCK = 0.06  # of an interval: what rounding to a clock of 1 ms moves frames by at up to 120 a second


def steady_times(time_s: Array) -> Array:
    """Times of a recording of constant rate without the rounding of its container's clock; others as they are; (n,).

    A mark moves a tenth of a pixel in the half millisecond that some containers round by: more than its centre errs.
    """
    steps = np.diff(time_s)
    if len(steps) < LEAST:
        return time_s
    count = np.concatenate([[0.0], np.cumsum(np.rint(steps / np.median(steps)))])
    middle = count - count.mean()
    interval = float(middle @ time_s / (middle @ middle))
    steady = time_s.mean() + interval * middle
    return steady if np.abs(steady - time_s).max() < CLOCK * interval else time_s


class Course:
    """What each centre differs from the course of its neighbours.

    error: (n, 2), NaN where too few neighbours are seen. around: rows of the neighbours, weights: theirs, 0 where
    absent, squares: of these; all (10, n).
    """

    def __init__(self, time_s: Array, centers_px: Array, stride: int = 1) -> None:
        """time_s: (n,). centers_px: (n, 2), NaN where absent. stride: frames between neighbours."""
        n = len(time_s)
        around = np.arange(n) + stride * OFFSETS[:, None]
        self.around = np.clip(around, 0, max(n - 1, 0))
        seen: NDArray[np.bool_] = np.asarray(np.isfinite(centers_px).all(axis=1))
        usable = (around == self.around) & seen[self.around]
        lapse = time_s[self.around] - time_s
        usual = stride * OFFSETS * float(np.median(np.diff(time_s))) if n > 1 else OFFSETS.astype(float)
        usable &= np.abs(lapse) < BEYOND * abs(usual[0])
        before, after = usable[:REACH].sum(axis=0), usable[REACH:].sum(axis=0)
        enough = (before + after >= NEIGHBORS) & (before >= EITHER_SIDE) & (after >= EITHER_SIDE)
        self.known: NDArray[np.bool_] = seen & enough
        even = self.known & (np.where(usable, np.abs(lapse - usual[:, None]), 0.0).max(axis=0) < EVEN * abs(usual[0]))
        self.weights = np.zeros((len(OFFSETS), n))
        # Evenly timed frames with the same neighbours seen share their weights; nearly all do.
        pattern = (1 << np.arange(len(OFFSETS))) @ usable[:, even]
        _, first, which = np.unique(pattern, return_index=True, return_inverse=True)
        seen_alike = usable[:, even][:, first].T
        self.weights[:, even] = _to_the_middle(np.broadcast_to(usual, seen_alike.shape), seen_alike)[which].T
        odd = self.known & ~even
        self.weights[:, odd] = _to_the_middle(lapse[:, odd].T, usable[:, odd].T).T
        self.squares = self.weights**2
        course = [(self.weights * axis[self.around]).sum(axis=0) for axis in np.nan_to_num(centers_px).T]
        self.error = np.where(self.known[:, None], centers_px - np.stack(course, axis=1), np.nan)

    def variance(self, variances: Array) -> Array:
        """Variance of the errors, from that of the centres (n,), NaN where absent."""
        return np.asarray(variances + (self.squares * np.nan_to_num(variances)[self.around]).sum(axis=0))


def _to_the_middle(lapse_s: Array, usable: NDArray[np.bool_]) -> Array:
    """Weights of neighbours that give the value of their polynomial at lapse 0; (m, 10) all."""
    farthest = np.where(usable, np.abs(lapse_s), 0.0).max(axis=-1, initial=1e-9, keepdims=True)
    powers = (np.where(usable, lapse_s, 0.0) / farthest)[..., None] ** np.arange(ORDER) * usable[..., None]
    # The value at lapse 0 is the first coefficient. Oddly timed neighbours may not tell all coefficients: the
    # pseudoinverse then takes the smallest.
    return np.asarray(np.linalg.pinv(powers)[..., 0, :])


def hidden_variance(
    time_s: Array, centers_px: Array, variances: Array, kinds: NDArray[np.str_], abrupt: NDArray[np.bool_] | None = None
) -> Array:
    """Variance per axis, px², to add to every frame's own, from all that the course of a mark tells; (n,).

    A slow mark rests in the codec's memory for some frames, so that neighbours share their error: neighbours farther
    away tell more. variances: mean of the axes (n,), NaN where absent. kinds: of `codec_variance`. abrupt: of
    `changes_of_motion`, where other marks of the same body tell of them too.
    """
    # Frames where something was in the way have an uncertainty of their own, and tell nothing of the codec.
    calm = variances < 3.0 * np.nanmedian(variances) if np.isfinite(variances).any() else np.zeros(len(variances), bool)
    centers_px, quiet = np.where(calm[:, None], centers_px, np.nan), np.where(calm, variances, np.nan)
    course = Course(time_s, centers_px)
    moving, known = _moving(centers_px), course.variance(quiet)
    telling = course.known & ~(changes_of_motion([course]) if abrupt is None else abrupt)
    extra = codec_variance(course, telling & moving, known, kinds)
    # At rest a codec keeps one error for long, which nothing shows: it is smaller than in motion, by a third at most.
    rest = codec_variance(course, telling & ~moving, known, kinds)
    extra = np.where(moving, extra, np.maximum(rest, extra / 3))
    straight = _straight_frames(centers_px)
    own = float(np.nanmean(quiet)) if np.isfinite(quiet).any() else 0.0
    most = typical = float(extra.mean())
    for stride in STRIDES[1:]:
        if REACH * stride > straight:
            break
        wide = Course(time_s, centers_px, stride)
        abrupt = np.append(course.known & ~telling, False)  # what lies beyond the ends is no change
        told = wide.known & ~(abrupt[wide.around] & (wide.weights != 0.0)).any(axis=0)
        if told.sum() >= LEAST:
            share = 1 + float(wide.squares[:, told].sum(axis=0).mean())
            square = robust_square(wide.error[told]) / share
            # More than by its own standard error: the largest of some estimates is too large by about that.
            if square * (1.0 - float(told.sum()) ** -0.5) > own + typical:
                most = max(most, square - own)
    extra = extra + (most - typical)
    return extra + _tail(course, quiet + extra)


def _straight_frames(centers_px: Array) -> float:
    """Frames on either side over which the course follows the path of a mark.

    On a circle of radius r a quartic through a path of s to either side leaves at most s⁵/(120 r⁴), Taylor's next term;
    of k frames at a speed v that turn by φ each, s = vk and r = v/φ, that is vφ⁴k⁵/120.
    """
    step = np.diff(centers_px[::DIRECTION], axis=0) / DIRECTION
    step = step[np.isfinite(step).all(axis=1)]
    if len(step) < EITHER_SIDE:
        return np.inf
    speed = float(np.median(np.hypot(*step.T))) + 1e-9
    turn = np.diff(np.unwrap(np.arctan2(step[:, 1], step[:, 0])))
    angle = float(np.median(np.abs(turn))) / DIRECTION + 1e-9
    return float(max(STRAIGHT_PX / speed, (120.0 * LEAVES_PX / (speed * angle**4)) ** 0.2))


def changes_of_motion(courses: Sequence[Course]) -> NDArray[np.bool_]:
    """Frames whose course runs across an abrupt change of speed, which is no error of a centre; (n,).

    Such a change leaves its own pattern in the frames around; one frame's large error leaves another. courses: of marks
    on one body, which all change together; what one of them shows alone is an error of its own.
    """
    wrong = np.zeros(len(courses[0].known), bool)
    if min(course.known.sum() for course in courses) < LEAST:
        return wrong
    changes, singles, around = np.zeros_like(wrong, float), np.zeros_like(wrong, float), 2 * REACH + 1
    together = ~wrong
    for course in courses:
        change, single = (_likeness(course.error, pattern) for pattern in _patterns())
        # Of chance errors it follows the square of a Rayleigh distribution, whose median is ln 4 variances.
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
    """How much of the squares of errors (n, 2) a pattern around each frame explains, px²; (n,)."""
    alike = [np.convolve(axis, pattern, "same") for axis in np.nan_to_num(error).T]
    return np.asarray(np.square(alike).sum(axis=0) / (pattern @ pattern))


@cache
def _patterns() -> tuple[Array, Array]:
    """Errors of the courses of a path that bends at frame 0, and of one that is off in frame 0 alone; (11,) each."""
    frames = np.arange(-REACH, REACH + 1.0)
    weights = _to_the_middle(OFFSETS.astype(float), np.ones(len(OFFSETS), bool))
    bent = np.maximum(frames, 0.0) - np.maximum(frames[:, None] + OFFSETS, 0.0) @ weights
    single = (frames == 0.0) - (frames[:, None] + OFFSETS == 0.0) @ weights
    return bent, single


def _tail(course: Course, variances: Array) -> Array:
    """Variance to add where a frame lies so far off its course that its own error is a large one; (n,).

    The mean of the variance of an error that follows Student's t, once the error is seen.
    """
    square = (course.error**2).sum(axis=1) / course.variance(variances)
    factor = (FREEDOM + np.nan_to_num(square)) / (FREEDOM + course.error.shape[1])
    return np.asarray(np.nan_to_num(variances) * np.where(np.nan_to_num(square) > TAIL**2, factor - 1.0, 0.0))


def _moving(centers_px: Array) -> NDArray[np.bool_]:
    """Frames in which the mark moves by more than MOVING_PX a frame, over three frames to either side."""
    if len(centers_px) < 7:
        return np.ones(len(centers_px), bool)
    step = np.hypot(*(centers_px[6:] - centers_px[:-6]).T) / 6
    return np.pad(np.nan_to_num(step, nan=np.inf) > MOVING_PX, 3, mode="edge")


def codec_variance(course: Course, chosen: NDArray[np.bool_], known: Array, kinds: NDArray[np.str_]) -> Array:
    """Variance to add to every frame, one value for each kind of frame (I, P, B); (n,).

    chosen: frames to learn it from (n,). known: variance that the course's errors have already (n,), NaN where
    absent. kinds: (n,).
    """
    rows = np.flatnonzero(chosen)
    extra = np.zeros(len(kinds))
    if len(rows) < FEW:
        return extra
    _, kind = np.unique(kinds, return_inverse=True)
    usable = np.flatnonzero(np.bincount(kind[rows]) >= LEAST)
    if len(usable) == 0:
        kind, usable = np.zeros_like(kind), np.array([0])
    mine = kind[rows] == usable[:, None]
    alike = kind[course.around[:, rows]] == usable[:, None, None]
    shares = (course.squares[:, rows] * alike).sum(axis=1)  # of the neighbours' variances in that of an error
    known, square = known[rows], np.zeros(len(rows))
    for one in mine:
        square[one] = _clipped_squares(course.error[rows[one]])
    # A frame of large known variance (a smear, something in the way) tells little of what is added, and if its
    # variance is stated too large it hides the rest: squares scatter by their variance, and weigh by that.
    total = known + square.mean() + EXACT_PX2
    for _ in range(ROUNDS):
        weights = mine / total**2
        solution = _shared_out(weights, shares + mine, square - known)
        total = known + solution @ (shares + mine) + EXACT_PX2
    # Kinds too rare to tell (the few I frames) get the mean of the others: never less than is known of them.
    of_kind = np.full(kind.max() + 1, solution.mean())
    of_kind[usable] = solution
    return np.asarray(of_kind[kind])


def _shared_out(weights: Array, shares: Array, excess: Array) -> Array:
    """Variance of each of k kinds of frames from the squares of n errors beyond what is known; (k,).

    weights: of the errors in what their own kind is told by, 0 for those of others (k, n). shares: of the kinds'
    variances in each error's (k, n). excess: px² (n,).
    """
    weights = weights / weights.sum(axis=1, keepdims=True)
    matrix, right = weights @ shares.T, weights @ excess
    # What all kinds have in common is well known, what tells them apart is not: no kind gets less than a third of it.
    share = np.count_nonzero(weights, axis=1) / weights.shape[1]
    least = np.full(len(right), max(float(share @ right / (share @ matrix.sum(axis=1))), 0.0) / 3)
    return np.asarray(least + _non_negative(matrix, right - matrix @ least))


def robust_square(errors: Array) -> float:
    """Mean square per axis, with what lies beyond 4 robust sigmas (starts, bumps) brought back to there."""
    return float(np.mean(_clipped_squares(errors)))


def _clipped_squares(errors: Array) -> Array:
    """Mean square of the axes of each error, as `robust_square` takes it; (n,)."""
    sigma = 1.4826 * np.median(np.abs(errors)) + 1e-12
    return np.asarray(np.minimum(errors**2, (4 * sigma) ** 2).mean(axis=1))


def _non_negative(matrix: Array, right: Array) -> Array:
    """Least squares with all unknowns at or above zero: the best of all choices of which are zero (there are few)."""
    best, cost = np.zeros(len(right)), float(right @ right)
    for choice in product([False, True], repeat=len(right)):
        free = np.array(choice)
        if not free.any():
            continue
        trial = np.zeros(len(right))
        trial[free] = np.linalg.lstsq(matrix[:, free], right, rcond=None)[0]
        misfit = float(np.sum((matrix @ trial - right) ** 2))
        if (trial >= 0).all() and misfit < cost * (1 - 1e-9):
            best, cost = trial, misfit
    return best
