"""Where a series of uncertain values changes its level.

Windows of many lengths (seeded intervals: Kovács, Bühlmann, Li and Munk 2023, doi:10.1093/biomet/asac052) are split
where their two sides differ most. The narrowest window with a significant split contains one change; the parts to its
left and right are searched in the same way (Baranowski, Chen and Fryzlewicz 2019, doi:10.1111/rssb.12322). The sides
are pooled with one scatter from session to session for both (random effects) and compared by Student's test, so that a
series that merely scatters has no change. Of two sessions it is not known; they are compared by Welch's test with the
scatter of their own runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr, stdtrit

from evaluator.turning.pooling import Pooled, common_scatter, difference, p_of_difference

Array = NDArray[np.float64]

SIGNIFICANCE = 0.05  # probability of a reported change in a series that has none; divided among its splits


@dataclass(frozen=True)
class Level:
    """A value of one session: standard error with its degrees of freedom.

    systematic: standard uncertainty common to all sessions with the same source, for example one calibration.
    repeated: whether error and freedom contain a scatter from run to run.
    """

    value: float
    error: float
    freedom: float
    systematic: float = 0.0
    source: str = ""
    repeated: bool = True

    @property
    def reach(self) -> float:
        """Half the width of the 95 % interval by the error alone."""
        return float(stdtrit(self.freedom, 0.975)) * self.error


@dataclass(frozen=True)
class Change:
    """A change of level before the value of index `at`: from one pooled value to another, `difference` with bounds."""

    at: int
    before: Pooled
    after: Pooled
    difference: float
    low: float
    high: float
    p: float


def changes(levels: Sequence[Level], series: int) -> tuple[Change, ...]:
    """Changes of a series, in order of time; levels that are not finite are ignored.

    series: number of series that are searched together, by which the significance is divided (Bonferroni).
    """
    there = [at for at, level in enumerate(levels) if np.isfinite(level.value) and np.isfinite(level.error)]
    known = [levels[at] for at in there]
    windows = _windows(len(known))
    if not windows:
        return ()
    tried = sum(stop - start - 1 for start, stop in windows)
    edges = [0, *sorted(_search(known, windows, SIGNIFICANCE / (tried * series))), len(known)]
    found = [
        _change(known[start:at], known[at:stop], at)
        for start, at, stop in zip(edges, edges[1:], edges[2:], strict=False)
    ]
    return tuple(replace(change, at=there[change.at]) for change in found)


def _windows(count: int) -> list[tuple[int, int]]:
    """Intervals [start, stop) of lengths that shrink by √2, each length shifted by half of itself; narrowest first.

    At least three sessions long, since two single values show no scatter; two if there are no more.
    """
    found = set()
    length = float(count)
    while length > max(min(count, 3) - 1, 1):
        size = int(np.ceil(length))
        shifts = max(int(np.ceil(2 * (count - size) / size)), 1)
        found |= {
            (start, start + size) for start in np.linspace(0, count - size, shifts + 1).round().astype(int).tolist()
        }
        length /= np.sqrt(2)
    return sorted(found, key=lambda window: (window[1] - window[0], window))


def _search(levels: Sequence[Level], windows: Sequence[tuple[int, int]], threshold: float) -> list[int]:
    """Indices at which the level changes: in the narrowest significant window, then in the windows on either side."""
    for start, stop in windows:
        best = _best(levels, start, stop)
        if best.p < threshold:
            left = [window for window in windows if window[1] <= best.at]
            right = [window for window in windows if window[0] >= best.at]
            return [*_search(levels, left, threshold), best.at, *_search(levels, right, threshold)]
    return []


def _best(levels: Sequence[Level], start: int, stop: int) -> Change:
    """The split of a window whose sides differ most significantly."""
    return min(
        (_change(levels[start:at], levels[at:stop], at) for at in range(start + 1, stop)), key=lambda change: change.p
    )


def _change(before: Sequence[Level], after: Sequence[Level], at: int) -> Change:
    """Compare two neighbouring stretches; their common systematic error cancels unless their sources differ."""
    shared = len({level.source for level in (*before, *after)}) == 1
    if len(before) + len(after) == 2:
        first, second = (_alone(*side, shared=shared) for side in (before, after))
        return Change(at, first, second, *difference(first, second), p_of_difference(first, second))
    freedom = len(before) + len(after) - 2.0
    scatter = common_scatter([_values(before), _values(after)])
    first, second = (_mean(side, scatter, freedom, shared=shared) for side in (before, after))
    value, error = second.mean - first.mean, float(np.hypot(first.error, second.error))
    reach = float(stdtrit(freedom, 0.975)) * error
    p = float(2 * stdtr(freedom, -abs(value) / error)) if error else float(value == 0)
    return Change(at, first, second, value, value - reach, value + reach, p)


def _values(levels: Sequence[Level]) -> tuple[Array, Array]:
    return np.array([level.value for level in levels]), np.array([level.error for level in levels])


def _mean(levels: Sequence[Level], scatter: float, freedom: float, *, shared: bool) -> Pooled:
    """Mean of a stretch whose sessions scatter by as much as those of the other one."""
    values, errors = _values(levels)
    least = 1e-12 * max(float(np.abs(values).max()), 1e-100)  # finite weights for values without uncertainty
    weight = 1 / (errors**2 + scatter**2 + least**2)
    systematic = 0.0 if shared else max(level.systematic for level in levels)
    error = float(np.hypot(np.sqrt(1 / weight.sum()), systematic))
    return Pooled(
        mean=float(weight @ values / weight.sum()), between=scatter, runs=len(levels), error=error, freedom=freedom
    )


def _alone(level: Level, *, shared: bool) -> Pooled:
    """A single session; how it would scatter is known only by the scatter of its own runs, NaN if there is one."""
    error = np.hypot(level.error, 0.0 if shared else level.systematic) if level.repeated else np.nan
    return Pooled(mean=level.value, runs=1, error=float(error), freedom=level.freedom)
