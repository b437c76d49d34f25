"""Lookalike pairs at the first detection; motion shows which of them is the robot.

Until then the marks are reported as ambiguous instead of guessed. A region or a mask in the settings decides at once.
Positions of rejected blobs are remembered, so that a lost mark is not searched there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from evaluator.tracking.detection.selection import Candidate, alike
from evaluator.tracking.settings import TrackingSettings

Point = tuple[float, float]
Pair = dict[str, Candidate]

# A pair has moved if one of its blobs is farther than this from its first position, in radii; it has moved as one body
# if its distance changed by less than this share of the motion: two independent objects seldom keep their distance.
MOVED, RIGID = 1.5, 0.1
STEP = 2.0  # radii: largest motion between frames with which a blob is recognised
# Share of the strongest chroma below which colour is noise; apparent motion of objects at rest, px; ratios of the sizes
# and of the chroma of one object in two frames.
FAINT, RESTING_PX, ALIKE_WITHIN = 0.4, 1.5, 1.4
APART_PX = 3.0  # change of a pair's distance, beyond the jitter of blobs, from which they are not on one body


@dataclass
class _Rival:
    """A candidate pair with its first and its last position."""

    first: Pair
    last: Pair

    def follow(self, pairs: list[Pair]) -> None:
        """Update with the pair found at the position of this one."""
        for pair in pairs:
            if all(_apart(pair[name], self.last[name]) < STEP * pair[name].radius_px for name in pair):
                self.last = pair
                return

    @property
    def change_px(self) -> float:
        """Change of the distance of its blobs since the first frame."""
        return abs(_apart(*self.last.values()) - _apart(*self.first.values()))

    @property
    def moved(self) -> bool:
        """Whether it has moved as one body."""
        way = max(_apart(self.last[name], self.first[name]) for name in self.first)
        return way > MOVED * next(iter(self.first.values())).radius_px and self.change_px < RIGID * way


class Rivals:
    """Similar pairs, from the first frame that shows them until one of them moves."""

    def __init__(self) -> None:
        """Start with none."""
        self._rivals: list[_Rival] = []
        self._others: list[Candidate] = []

    @property
    def undecided(self) -> bool:
        """Whether pairs were found that only motion can distinguish."""
        return bool(self._rivals)

    def decide(self, found: list[Candidate], settings: TrackingSettings, chosen: Pair) -> Pair:
        """The pair that is the robot's marks; empty while several pairs are possible.

        found: all blobs of the frame. chosen: its most probable pair.
        """
        pairs = alike([one for one in found if one.mark in chosen], settings)
        if not self._rivals and len(pairs) < 2:
            return chosen
        for rival in self._rivals:
            rival.follow(pairs)
        known = [rival.last for rival in self._rivals]
        self._rivals += [_Rival(pair, pair) for pair in pairs if not any(_same(pair, one) for one in known)]
        self._rivals = [rival for rival in self._rivals if rival.change_px < APART_PX]
        moved = [rival for rival in self._rivals if rival.moved]
        if len(moved) != 1 or moved[0].last not in pairs:
            return {}
        self._others = [one for rival in self._rivals if rival is not moved[0] for one in rival.last.values()]
        self._rivals = []
        return moved[0].last

    def exclude(self, blobs: list[Candidate]) -> None:
        """Remember blobs that are not marks of the robot."""
        self._others += blobs

    def there(self, place: Point, radius_px: float) -> bool:
        """Whether a blob at this position was excluded."""
        return any(math.dist(place, one.center_px) < radius_px for one in self._others)


def mover(before: list[Candidate], after: list[Candidate]) -> tuple[Candidate | None, list[Candidate]]:
    """The blob, as it was before, that has moved, and those at rest; None if none or several have moved.

    before, after: all blobs of a mark's colour in two frames.
    """
    strongest = max((one.chroma for one in before), default=0.0)
    gone = [
        one for one in before if one.chroma > FAINT * strongest and not any(_resting(one, other) for other in after)
    ]
    come = [one for one in after if not any(_resting(one, other) for other in before)]
    found = [one for one in gone if any(_alike(one, other) for other in come)]
    # One object gives a blob at several levels of chroma.
    found.sort(key=lambda one: -one.radius_px)
    alone = all(_apart(one, found[0]) < found[0].radius_px for one in found)
    resting = [one for one in before if any(_resting(one, other) for other in after)]
    return found[0] if found and alone else None, resting


def _resting(one: Candidate, other: Candidate) -> bool:
    return _apart(one, other) < max(0.25 * one.radius_px, RESTING_PX)


def _alike(one: Candidate, other: Candidate) -> bool:
    sizes, chromas = one.radius_px / other.radius_px, one.chroma / other.chroma
    return all(1.0 / ALIKE_WITHIN < ratio < ALIKE_WITHIN for ratio in (sizes, chromas))


def _apart(one: Candidate, other: Candidate) -> float:
    return math.dist(one.center_px, other.center_px)


def _same(pair: Pair, other: Pair) -> bool:
    """Whether two pairs share a blob."""
    return any(_apart(pair[name], other[name]) < other[name].radius_px for name in pair)
