"""Constant distance of the two marks of a robot, which limits the positions of a lost one.

Used only to find marks; every measurement uses the pixels of one mark alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeVar

Point = tuple[float, float]
Place = TypeVar("Place", bound=Sequence[float])

# Largest relative change of the distance of two marks in the frame by perspective and slant: with a camera tilted by 20
# degrees, 6 % with direction and as much across the plate. At a larger slant it changes by more, but slowly.
TOLERANCE = 0.15
HALFWAY = 0.5  # of the shortest distance: two marks that appear nearer would be too slanted to be visible as discs
ENOUGH = 6  # frames with both marks after which their distance is used
SHARE = 0.05  # weight of a new distance in the running mean


class Body:
    """The marks' distance in the frame, px; every position is accepted until it is known."""

    def __init__(self) -> None:
        """Start without knowledge."""
        self._count, self.distance_px = 0, 0.0
        self._shortest, self._longest = math.inf, 0.0
        self.confirmed = False  # whether both marks were seen at their distance since one of them was found again

    @property
    def known(self) -> bool:
        """Whether enough frames showed both marks."""
        return self._count >= ENOUGH

    def note(self, one: Point, other: Point) -> None:
        """Update with a frame that shows both marks."""
        apart = math.hypot(one[0] - other[0], one[1] - other[1])
        if self.known and not self._near(apart):
            return
        self._count += 1
        self.confirmed = True
        self._shortest, self._longest = min(self._shortest, apart), max(self._longest, apart)
        self.distance_px += max(SHARE, 1.0 / self._count) * (apart - self.distance_px)

    def fits(self, one: Sequence[float], other: Sequence[float]) -> bool:
        """Whether two places can be those of the two marks."""
        return not self.known or self._near(math.hypot(one[0] - other[0], one[1] - other[1]))

    def at_one_place(self, one: Point, other: Point) -> bool:
        """Whether both names are at one mark; positions are NaN if absent."""
        return self.known and math.dist(one, other) < HALFWAY * self._shortest

    def paired(self, mine: Sequence[Place], others: Sequence[Sequence[float]]) -> list[Place]:
        """Those of my positions that are at the right distance from a position of the other mark."""
        return [one for one in mine if any(self.fits(one, other) for other in others)]

    def _near(self, apart: float) -> bool:
        return (1 - TOLERANCE) * self._shortest - 1.0 < apart < (1 + TOLERANCE) * self._longest + 1.0
