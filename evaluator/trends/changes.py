"""Where a series of uncertain values changes its level.

Windows of many lengths (seeded intervals: Kovács, Bühlmann, Li and Munk 2023, doi:10.1093/biomet/asac052) are split
where their two sides differ most. The narrowest window with a significant split contains one change; the parts to its
left and right are searched in the same way (Baranowski, Chen and Fryzlewicz 2019, doi:10.1111/rssb.12322). The sides
are pooled with a scatter from value to value (random effects) and compared by Welch's test, so that a series that
merely scatters has no change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtrit

from evaluator.turning.pooling import Pooled, difference, p_of_difference, pooled

SIGNIFICANCE = 0.05  # probability of a reported change in a series that has none; divided among its splits


@dataclass(frozen=True)
class Level:
    """A value of one session: standard error with its degrees of freedom.

    systematic: standard uncertainty common to all sessions with the same source, for example one calibration.
    """

    value: float
    error: float
    freedom: float
    systematic: float = 0.0
    source: str = ""

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
    sides = [_pool(before, shared=shared), _pool(after, shared=shared)]
    first, second = (_with_scatter(one, other) for one, other in zip(sides, sides[::-1], strict=True))
    return Change(at, first, second, *difference(first, second), p_of_difference(first, second))


def _pool(levels: Sequence[Level], *, shared: bool) -> Pooled:
    """Mean of a stretch. A single value has the degrees of freedom of its error."""
    systematic = 0.0 if shared else max(level.systematic for level in levels)
    found = pooled(np.array([level.value for level in levels]), np.array([level.error for level in levels]))
    freedom = levels[0].freedom if len(levels) == 1 else found.freedom
    return replace(found, error=float(np.hypot(found.error, systematic)), freedom=freedom)


def _with_scatter(side: Pooled, other: Pooled) -> Pooled:
    """A single session does not determine the scatter between sessions, which is taken from the other stretch."""
    if side.runs > 1 or other.runs < 2:
        return side
    error = float(np.hypot(side.error, other.between))
    return replace(side, error=error, freedom=min(side.freedom, other.runs - 1.0))
