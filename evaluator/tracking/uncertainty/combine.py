"""Steps over the whole recording: correction for uneven light and exposure, complete uncertainties."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from evaluator.tracking.following.background import background, strangers, travels
from evaluator.tracking.following.follow import Follower
from evaluator.tracking.following.follow_blob import BlobFollower
from evaluator.tracking.following.jumps import off_course
from evaluator.tracking.following.repeated_frames import repeated_frames
from evaluator.tracking.observation import ALONE, BACKGROUND, OFF_COURSE, REPEATED, STRANGER, UNLIKE, WRONG_DISTANCE
from evaluator.tracking.refinement.shading import bent_shade
from evaluator.tracking.rolling_shutter import RollingShutter, place_at_frame_time
from evaluator.tracking.uncertainty.codec import hidden_variance
from evaluator.tracking.uncertainty.course import Course, steady_times
from evaluator.tracking.uncertainty.exposure import exposed
from evaluator.tracking.uncertainty.motion_changes import around, kinks, smeared
from evaluator.tracking.uncertainty.outline import widen_by_outline
from evaluator.tracking.uncertainty.rigid_pair import Distance, wrong_ends
from evaluator.tracking.uncertainty.tag_shape import widen_by_shape

Array = NDArray[np.float64]

# An occlusion or a glare grows over some frames. Frames beside a disturbed one, as many as a slope is not looked for
# in, may have half of its error before their own residuals show it.
ONSET, BESIDE = 0.25, 3
# Frames whose hidden errors are estimated together, so that they take 60 MB however long the recording is: ten minutes
# at 60 frames/s, which with a key frame in 250 still determine the variance of key frames to 8 %.
BLOCK = 36_000
UNKNOWN_PX = 3.0  # assumed radius of marks that are not coloured blobs


def refine(
    time_s: Array,
    kinds: Sequence[str],
    numbers: dict[str, Array],
    status: dict[str, list[str]],
    followers: dict[str, Follower | BlobFollower],
    body: Sequence[str] = (),
    tags: Mapping[str, Sequence[str]] = MappingProxyType({}),
    *,
    background_px: Array | None = None,
    shutter: RollingShutter | None = None,
) -> None:
    """Correct centres, complete variances and remove marks at a wrong distance, in place.

    kinds: of the frames. numbers: per mark (n, 5) of x, y, their variances and covariance, px and px², NaN if absent.
    status: per mark, of every frame. body: marks on one rigid body. tags: the corners of each. background_px:
    displacement of the background (n, 2) if no pair ever looked like the marks of a robot, so that only motion against
    it can confirm them. shutter: a rolling one, corrected for.
    """
    kind, times, time_s = np.array(list(kinds), dtype=str), time_s, steady_times(time_s)
    again = dict(zip(numbers, repeated_frames([values[:, :2] for values in numbers.values()]), strict=True))
    for name, shown in again.items():
        take_out(numbers[name], status[name], shown, REPEATED)
    place_at_frame_time(times, numbers, shutter)
    _take_out_impossible(time_s, numbers, status, followers, body)
    if background_px is not None and not any(
        travels(numbers[name][:, :2] - background_px, follower.radius_px) for name, follower in followers.items()
    ):
        for name, values in numbers.items():
            take_out(values, status[name], np.isfinite(values[:, 0]), UNLIKE)
    together = [name for name in numbers if name in body]
    new = ~np.any(list(again.values()), axis=0)
    of_body = _kinks(time_s, [numbers[name] for name in together], new)
    for center, corners in tags.items():
        widen_by_shape(numbers, corners, center)
    for name, values in numbers.items():
        follower, bent = followers.get(name), of_body if name in together else None
        apart = _apart(numbers, name, together)
        if not np.isfinite(values[:, 0]).any():
            continue
        if follower is None:  # a tag or a light
            _add_hidden(time_s, values, kind, ~again[name], bent, apart)
            continue
        if isinstance(follower, Follower):
            _allow_for_light(times, values, follower)
        else:
            widen_by_outline(times, values, follower.outline)
        _allow_for_onsets(values)
        shift, variance = exposed(time_s, values[:, :2], values[:, 2:4], follower.shutter)
        values[:, :2] -= shift
        values[:, 2:4] += variance
        _add_hidden(time_s, values, kind, ~again[name], bent, apart)
        if isinstance(follower, Follower):
            values[:, 2:4] += follower.offsets.variance(times)[:, None]
    _hold_together(time_s, numbers, status, together)


def _allow_for_light(times: Array, values: Array, follower: Follower) -> None:
    """Correct the centres of a disc for uneven light; values: (n, 5) as in `refine`, in place."""
    values[:, 2:5] += bent_shade(follower.look.disc)
    shading = follower.light.learnt(follower.look.disc)
    if shading is not None:
        shift, variance = shading.shift(values[:, :2])
        shifted = follower.light.shifted(times)
        values[shifted, :2] -= shift[shifted]
        values[shifted, 2:4] += variance[shifted, None]


def _add_hidden(
    time_s: Array, values: Array, kind: NDArray[np.str_], new: NDArray[np.bool_],
    bent: NDArray[np.bool_] | None, apart: Array | None,
) -> None:  # fmt: skip
    """Increase variances by the smoothness of the course, in place; new: frames (n,) that are not repetitions.

    bent: of `kinks`, None if it is not known from other marks.
    """
    extra = None if bent is None else smeared(values[:, :2], bent, kind)
    abrupt = None if bent is None else around(bent)
    for rows in _blocks(new):
        mean = values[rows, 2:4].mean(axis=1)
        near = None if abrupt is None else abrupt[rows]
        between = None if apart is None else apart[rows]
        values[rows, 2:4] += hidden_variance(time_s[rows], values[rows, :2], mean, kind[rows], near, between)[:, None]
    if extra is not None:
        values[:, 2:5] += extra


def _blocks(chosen: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
    """Rows of chosen frames (n,) in blocks of about equal length, of at most BLOCK."""
    rows = np.flatnonzero(chosen)
    return np.array_split(rows, max(-(-len(rows) // BLOCK), 1))


def _apart(numbers: dict[str, Array], name: str, body: Sequence[str]) -> Array | None:
    """Distance, px, of a mark from the most visible other mark of its body, (n,); None if there is no other."""
    others = [numbers[other] for other in body if other != name]
    if name not in body or not others:
        return None
    other = max(others, key=lambda values: int(np.isfinite(values[:, 0]).sum()))
    return np.asarray(np.hypot(*(numbers[name][:, :2] - other[:, :2]).T))


def _kinks(time_s: Array, marks: Sequence[Array], new: NDArray[np.bool_]) -> NDArray[np.bool_] | None:
    """Starts, stops and reversals of a body, (n,); None for one mark. new: frames without repetitions."""
    if len(marks) < 2:
        return None
    found = np.zeros(len(time_s), bool)
    for rows in _blocks(new):
        found[rows] = kinks([Course(time_s[rows], values[rows, :2]) for values in marks])
    return found


def _hold_together(time_s: Array, numbers: dict[str, Array], status: dict[str, list[str]], body: Sequence[str]) -> None:
    """Increase variances by the scatter of the distances on a body, and remove wrong marks, in place."""
    for first, second in combinations(body, 2):
        one, other = numbers[first], numbers[second]
        distance = Distance(one[:, :2], other[:, :2])
        ratio = distance.ratio(distance.variance(one[:, 2:], other[:, 2:]))
        if ratio > 1.0:
            one[:, 2:5] *= ratio
            other[:, 2:5] *= ratio
        for name, wrong in zip((first, second), wrong_ends(time_s, (one, other), distance), strict=True):
            take_out(numbers[name], status[name], wrong, WRONG_DISTANCE)


def _take_out_impossible(
    time_s: Array,
    numbers: dict[str, Array],
    status: dict[str, list[str]],
    followers: dict[str, Follower | BlobFollower],
    body: Sequence[str],
) -> None:
    """Remove what cannot be a mark of the robot: objects at rest while it moves, and jumps; in place."""
    radii = {name: follower.radius_px for name, follower in followers.items()}
    usual = float(np.median(list(radii.values()))) if radii else UNKNOWN_PX
    if len(body) == len(numbers) == 2:
        first, second = body
        places = {name: values[:, :2].copy() for name, values in numbers.items()}
        for name, other in ((first, second), (second, first)):
            rests = background(places[name], places[other], radii.get(other, usual))
            alone = not np.isfinite(places[other][:, 0]).any()
            take_out(numbers[name], status[name], rests, ALONE if alone else BACKGROUND)
        rarer, other = sorted(body, key=lambda name: int(np.isfinite(numbers[name][:, 0]).sum()))
        if strangers(numbers[rarer][:, :2], numbers[other][:, :2], usual):
            take_out(numbers[rarer], status[rarer], np.isfinite(numbers[rarer][:, 0]), STRANGER)
    for name, values in numbers.items():
        take_out(values, status[name], off_course(time_s, values[:, :2], radii.get(name, usual)), OFF_COURSE)


def take_out(values: Array, status: list[str], rows: NDArray[np.bool_], why: str) -> None:
    """Make a mark absent in some frames (n,), in place; values: (n, 5)."""
    values[rows] = np.nan
    for row in np.flatnonzero(rows):
        status[row] = why


def _allow_for_onsets(values: Array) -> None:
    """Increase the variances of frames beside a disturbed one; values: (n, 5) as in `refine`, in place."""
    around = np.pad(np.nan_to_num(values[:, 2:4]), ((BESIDE, BESIDE), (0, 0)))
    largest = np.max([around[k : k + len(values)] for k in range(2 * BESIDE + 1)], axis=0)
    values[:, 2:4] = np.maximum(values[:, 2:4], ONSET * largest)
