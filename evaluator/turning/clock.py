"""Delay between the command log of a run and its motion, estimated from the changes of command.

A robot has one steady velocity (forward, sideways, yaw) before a change of command and another one after it. Near every
change this motion is fitted to the poses: the velocity changes either suddenly, or steadily within a rise time (a heavy
robot that slides, a drive that limits acceleration) if that fits significantly better. The estimated delay is the time
from the command to the beginning of the change and is common to all changes. So is either the rise time (motors that
lag) or the acceleration, whichever fits better.

The delay includes the dead time of the motors, which a recording cannot distinguish from an offset of the clocks. A
rise time that is too short to be detected delays the motion by half of it, as a sudden change that comes later does;
the interval of the delay therefore begins where the longest rise time would begin that the recording and the friction
of the wheels allow.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import special
from scipy.optimize import minimize_scalar

from evaluator.turning.motion.velocity_change import left_over

Array = NDArray[np.float64]
NAN = float("nan")

COARSE_S = 3.0  # motion on either side of a change with which the delay is searched
FINE_S = 1.0  # motion on either side of a change with which it is estimated: short enough for a steady velocity
MOST_LATE_S = 2.0  # larger offsets of the clocks are to be corrected by start_s
FEWEST_FRAMES = 6  # on either side of a change
CHI2_95 = 3.841  # one parameter
# Least gain in -2 log likelihood of a rise time: chance reaches it once in a thousand. Without a rise time, the delay
# is as precise as sudden changes allow.
WORTH = 10.8
# Chance that noise alone is taken for the changes of velocity. Each change adds three velocities (forward, sideways,
# yaw); the gain of noise in -2 log likelihood is chi-squared, at each of the delays that are tried.
CHANCE = 1e-3
# Rise times that are tried, s. Shorter ones are not visible at usual frame rates; after longer ones no velocity is
# steady within FINE_S.
RISES_S = np.geomspace(0.02, 1.0, 8)
ROUGH = 1e-3  # tolerance of intermediate delays (s) and logarithms of rise times
# Share of a detected rise time by which the change may have begun earlier or later, beyond the limits by the noise: no
# real change is uniform. Moments of the velocity: a first-order lag seems to begin (sqrt(3) - 1)/sqrt(12) = 0.21 too
# early. Of 40 simulated runs with robots of 2.5 and 50 kg, whose wheels slide, the largest deviation was 0.26.
UNEVEN = 0.25
# Tolerance of delays (s) with which rise times are limited: a tenth of the narrowest intervals; and halvings between
# two of RISES_S, which leave 2 % of a rise time.
FINELY, HALVINGS = 1e-5, 5
# Acceleration that wheels give a robot on ice if half of them are driven: a tenth of gravity, mm/s². A robot of some
# millimetres per second then has its speed within milliseconds, one of a metre per second within a second.
LEAST_ACCELERATION = 980.0
Windows = list[tuple[float, NDArray[np.bool_]]]  # times of changes in the log, and the frames (n,) around each


@dataclass(frozen=True)
class CommandDelay:
    """Delay of the motion after the command, s, with its 95 % interval; NaN if no change can be used.

    rise_s: time within which the velocity then changes, the longest one; 0 if none is detected. hidden_rise_s: then the
    longest one that recording (95 %) and friction allow. The delay includes half of a rise time that is not detected,
    and the interval holds the delay with this half and without it.
    """

    value_s: float = NAN
    low_s: float = NAN
    high_s: float = NAN
    rise_s: float = 0.0
    hidden_rise_s: float = 0.0

    @property
    def is_known(self) -> bool:
        """Whether the delay was determined precisely enough to be used."""
        return bool(np.isfinite(self.value_s) and self.high_s - self.low_s < FINE_S)

    @property
    def settled_s(self) -> float:
        """Longest time after a command at which the velocity still changes."""
        return self.high_s + self.rise_s + self.hidden_rise_s / 2


def command_delay(
    time_s: Array, pose: Array, changes_s: Sequence[float], reach_mm: float = float("inf")
) -> CommandDelay:
    """Estimate the delay of the motion after the command log.

    time_s: (n,). pose: (n, 3) x, y in mm and heading in rad, unwrapped, without NaN. changes_s: times of the log at
    which the command changes, in order. A change too close to another one, or to an end of the recording, is not used.
    reach_mm: distance of the farthest wheel from the centre; infinite if it is not known.
    """
    step = float(np.median(np.diff(time_s))) / 2
    windows, room = _windows(time_s, changes_s, 2 * step * FEWEST_FRAMES)
    if not (room > 0).any():
        return CommandDelay()
    # Misfits are comparable only if they are of the same frames: the search extends as far as half of the changes
    # allow, and uses these.
    most = _most(room)
    reach = int(most / step)
    grid = step * np.arange(-reach, reach + 1)
    roomy = [window for window, most_late in zip(windows, room, strict=True) if most_late >= most]
    best = int(np.argmin([_misfit(time_s, pose, roomy, float(late))[0] for late in grid]))
    if best in (0, len(grid) - 1):  # the delay is larger
        return CommandDelay()
    coarse = float(grid[best])
    near = [(change, frames & (np.abs(time_s - change - coarse) <= FINE_S)) for change, frames in windows]
    fine = [(change, frames) for change, frames in near if _fewest(time_s[frames] - change - coarse) >= FEWEST_FRAMES]
    if not fine or not _changes(time_s, pose, fine, coarse, len(grid)):
        return CommandDelay()
    changes = _changes_mm_s(time_s, pose, changes_s, [change for change, _ in fine], reach_mm)
    return _refined(time_s, pose, fine, coarse, step, changes)


def _changes(time_s: Array, pose: Array, windows: Windows, late: float, tried: int) -> bool:
    """Whether the velocity changes at a delay by more than the best of some tried delays shows in noise alone."""
    if not np.ptp(pose, axis=0).any():  # repeated poses leave rounding errors alone
        return False
    never = 3 * COARSE_S  # beyond the frames of every window
    steady, changed = (_misfit(time_s, pose, windows, each)[0] for each in (never, late))
    independent = _independent(time_s, pose, windows, late, np.zeros(len(windows)))
    return bool(independent * np.log(steady / changed) > special.chdtri(3 * len(windows), CHANCE / tried))


def most_late_s(time_s: Array, changes_s: Sequence[float]) -> float:
    """Largest delay that command_delay finds, time_s: (n,); 0 if the changes follow one another too fast for any."""
    return _most(_windows(time_s, changes_s, float(np.median(np.diff(time_s))) * FEWEST_FRAMES)[1])


def _changes_mm_s(
    time_s: Array, pose: Array, changes_s: Sequence[float], asked_s: Sequence[float], reach_mm: float
) -> Array:
    """Change of the velocity of a wheel at every asked one of the changes; infinite without the places of wheels."""
    if not np.isfinite(reach_mm):
        return np.full(len(asked_s), np.inf)
    steps = np.diff(pose, axis=0) / np.diff(time_s)[:, None]
    ahead = (steps[:, 0] + 1j * steps[:, 1]) * np.exp(-1j * (pose[1:, 2] + pose[:-1, 2]) / 2)
    twists = np.column_stack([ahead.real, ahead.imag, reach_mm * steps[:, 2]])
    number = np.searchsorted(np.asarray(changes_s), time_s[1:])
    after = np.searchsorted(np.asarray(changes_s), asked_s) + 1
    usual = [[np.median(twists[number == each], axis=0) for each in (item - 1, item)] for item in after]
    return np.array([np.abs(later - former).sum() for former, later in usual])


def _most(room: Array) -> float:
    return min(MOST_LATE_S, float(np.median(room[room > 0]))) if (room > 0).any() else 0.0


def _windows(time_s: Array, changes_s: Sequence[float], margin_s: float) -> tuple[Windows, Array]:
    """Frames around every change, and the largest delay that they can show if a margin is left on either side, s.

    The frames between two changes are divided in the middle. Changes with too few frames on one side, also by a gap in
    the recording, are left out.
    """
    seen = [change for change in changes_s if time_s[0] < change < time_s[-1]]
    edges = [float(time_s[0]), *seen, float(time_s[-1])]
    halves = [(after - before) / 2 for before, after in pairwise(edges)]
    windows, room = [], []
    for change, before, after in zip(seen, halves[:-1], halves[1:], strict=True):
        frames = _between(time_s, change - min(before, COARSE_S), change + min(after, COARSE_S))
        if _fewest(time_s[frames] - change) >= FEWEST_FRAMES:
            windows.append((change, frames))
            room.append(min(before, after) - margin_s)
    return windows, np.array(room)


def _fewest(since: Array) -> int:
    """Number of frames (n,) before or after time 0, whichever is smaller."""
    return int(min((since < 0).sum(), (since > 0).sum()))


def _between(time_s: Array, low: float, high: float) -> NDArray[np.bool_]:
    return np.asarray((time_s >= low) & (time_s <= high))


def _refined(
    time_s: Array, pose: Array, windows: Windows, coarse: float, step: float, changes_mm_s: Array
) -> CommandDelay:
    """The delay of smallest misfit near a coarse one, and its 95 % limits, by the growth of the misfit.

    changes_mm_s: (k,) of the velocity of a wheel in each window; infinite if they are not known.
    """
    largest = float(changes_mm_s.max())
    alike = np.ones(len(windows))
    patterns = (alike, changes_mm_s / largest) if 0 < largest < np.inf else (alike,)

    def misfit(late: float, rise: float = 0.0, shares: Array = alike) -> float:
        return _misfit(time_s, pose, windows, late, rise * shares)[0]

    def ended(of: Callable[[float], float], best: float, least: float, rises: Array, rise: float = 0.0) -> CommandDelay:
        limit = least * (1 + CHI2_95 / _independent(time_s, pose, windows, best, rises))
        low, high = (best + way * (_reach(of, best, way, limit, step) + UNEVEN * rise) for way in (-1, 1))
        return CommandDelay(best, low, high, rise)

    best, least = _least(misfit, coarse, 2 * step)
    independent = _independent(time_s, pose, windows, best, 0 * alike)
    if independent <= 0:
        return CommandDelay()

    def begun(rise: float, shares: Array, to: float = ROUGH) -> tuple[float, float]:  # earlier than a sudden change
        return _least(lambda late: misfit(late, rise, shares), best - rise / 2, rise / 2, to)

    def undetected(shares: Array, limit: float) -> tuple[float, float]:  # rise time, and where it begins
        longest = _longest(lambda size: begun(size, shares, FINELY)[1] <= limit, [0.0, *RISES_S.tolist()])
        hidden = min(longest, largest / LEAST_ACCELERATION)
        return hidden, begun(hidden, shares, FINELY)[0]

    tried = [(*begun(rise, shares), rise, shares) for shares in patterns for rise in RISES_S.tolist()]
    late, risen, rise, shares = min(tried, key=lambda each: each[1])
    if _independent(time_s, pose, windows, late, rise * shares) * np.log(least / risen) < WORTH:
        limit = min(least, risen) * (1 + CHI2_95 / independent)
        found = ended(misfit, best, least, 0 * alike)
        sizes, begins = zip(*(undetected(shares, limit) for shares in patterns), strict=True)
        return replace(found, low_s=min(found.low_s, *begins), hidden_rise_s=max(sizes))
    width = float(np.log(RISES_S[1] / RISES_S[0]))

    def took(late: float) -> tuple[float, float]:  # best rise time for a delay: the two are correlated
        return _least(lambda size: misfit(late, float(np.exp(size)), shares), float(np.log(rise)), width, ROUGH)

    best, least = _least(lambda late: took(late)[1], late, rise / 4, ROUGH)
    rise_s = float(np.exp(took(best)[0]))
    return ended(lambda late: took(late)[1], best, least, rise_s * shares, rise_s)


def _longest(is_allowed: Callable[[float], bool], rises: Sequence[float]) -> float:
    """The longest allowed rise time, s, from the longest of some in ascending order; the first is allowed."""
    number = max([0, *(number for number, rise in enumerate(rises) if number and is_allowed(rise))])
    inner, outer = rises[number], rises[min(number + 1, len(rises) - 1)]
    for _ in range(HALVINGS):
        middle = (inner + outer) / 2
        inner, outer = (middle, outer) if is_allowed(middle) else (inner, middle)
    return inner


def _least(of: Callable[[float], float], middle: float, width: float, to: float = 1e-6) -> tuple[float, float]:
    """Argument within a width of a middle at which a function is least, to a tolerance, and its value there."""
    found = minimize_scalar(of, bounds=(middle - width, middle + width), method="bounded", options={"xatol": to})
    return float(found.x), float(found.fun)


def _independent(time_s: Array, pose: Array, windows: Windows, late: float, rises: Array) -> float:
    """Degrees of freedom, reduced by the correlation of the noise between successive frames."""
    _, freedom, correlation = _misfit(time_s, pose, windows, late, rises)
    return freedom * (1 - correlation) / (1 + correlation)


def _reach(misfit: Callable[[float], float], best: float, way: int, limit: float, step: float) -> float:
    """Distance from the best delay, in one direction, at which the misfit reaches a limit."""
    inner, outer = 0.0, step / 64
    while misfit(best + way * outer) < limit and outer < MOST_LATE_S:
        inner, outer = outer, 2 * outer
    for _ in range(20):
        middle = (inner + outer) / 2
        inner, outer = (middle, outer) if misfit(best + way * middle) < limit else (inner, middle)
    return outer


def _misfit(
    time_s: Array, pose: Array, windows: Windows, late: float, rises: Sequence[float] | Array = ()
) -> tuple[float, int, float]:
    """Misfit over all changes, its degrees of freedom, and the correlation of residuals between successive frames.

    rises: rise time of each change, s; without them the velocity changes suddenly.

    The noise of positions and headings is estimated from their residuals: the misfit is the product of their sums of
    squares, each to the power of its share of the degrees of freedom.
    """
    place, turn, counts = 0.0, 0.0, [0, 0]
    products, squares = 0.0, 0.0
    for (change, frames), rise in zip(windows, rises if len(rises) else [0.0] * len(windows), strict=True):
        since = time_s[frames] - change - late
        headings, places = left_over(since, pose[frames], float(rise))
        turn, place = turn + float(headings @ headings), place + float((places**2).sum())
        counts[0], counts[1] = counts[0] + len(since) - 3, counts[1] + 2 * len(since) - 6
        products += float((places[1:] * places[:-1]).sum())
        squares += float((places**2).sum())
    freedom = sum(counts)
    tiny = 1e-300
    total = np.exp((counts[0] * np.log(turn + tiny) + counts[1] * np.log(place + tiny)) / freedom)
    return float(total), freedom, float(np.clip(products / max(squares, tiny), 0.0, 0.95))
