"""Statics: the weight carried by each support of a robot. Units: mm, µN; body frame.

The weight shares balance the weight and its moments. Three supports are statically determinate. More are modelled as
equally stiff supports of a rigid body, whose shares have the smallest sum of squares; four at the corners of a
rectangle, as two axles with equal loads on both ends. Load = weight share + attraction of the wheel's magnet. A support
that would have to pull has lifted off: it carries nothing and has no attraction, and the others carry the weight.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from simulator.errors import SimulationError

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Point = tuple[float, float]
BALANCED = 1e-9  # residual of a balance by rounding, as a share of the weight
MOST_SEARCHED = 10  # supports, of which a thousand sets are tried in some hundredths of a second


@dataclass(frozen=True)
class Rectangle:
    """Four supports at the corners of a rectangle along the axes: its middle and sides, mm; corners: ±1 for each."""

    middle: Point
    sides: Point
    corners: tuple[Point, ...]

    @staticmethod
    def of(places_mm: Array) -> Rectangle | None:
        """The rectangle of supports at (n, 2); None for any other layout."""
        (rear, right), (front, left) = places_mm.min(axis=0).tolist(), places_mm.max(axis=0).tolist()
        middle, sides = ((front + rear) / 2, (left + right) / 2), (front - rear, left - right)
        places = {(x, y) for x, y in places_mm.tolist()}
        if len(places_mm) != 4 or 0.0 in sides or places != {(x, y) for x in (front, rear) for y in (left, right)}:
            return None
        corners = tuple((1.0 if x == front else -1.0, 1.0 if y == left else -1.0) for x, y in places_mm.tolist())
        return Rectangle(middle, sides, corners)

    def shares(self, weight: float, gravity: Point) -> Array:
        """Weight share of each support, (4,); both ends of an axle carry the same."""
        forward = 2 * (gravity[0] - self.middle[0]) / self.sides[0]
        sideways = 2 * (gravity[1] - self.middle[1]) / self.sides[1]
        quarter = weight / 4
        return np.array([quarter * (1 + x * forward) * (1 + y * sideways) for x, y in self.corners])


def wheel_loads(
    name: str,
    places_mm: Array,
    weight_uN: float,
    gravity_mm: Point,
    attraction_uN: Array,
    rectangle: Rectangle | None = None,
) -> tuple[Array, Array]:
    """Weight share and load of each support, (n,) each; both are 0 where a support has lifted off.

    places_mm: (n, 2); gravity_mm: centre of gravity; rectangle: that of the places, where they are one. A weight share
    may be negative where the attraction holds the support down. Raises SimulationError, with the name of the robot,
    where no forces on the supports can balance.
    """
    share = rectangle.shares(weight_uN, gravity_mm) if rectangle else _stiff(places_mm, weight_uN, gravity_mm)[0]
    if share is None:
        _fails(name, gravity_mm)
    load: Array = share + attraction_uN
    if load.min() >= 0:
        return share, load
    return _lifted(name, places_mm, weight_uN, gravity_mm, attraction_uN)


def _stiff(places: Array, weight: float, gravity: Point) -> tuple[Array | None, Array]:
    """Weight shares of equally stiff supports, None if they cannot balance; and their plane (3,).

    A rigid body sinks by a linear function of position, so a share is (1, x, y) · plane. Lengths are relative to the
    size of the layout.
    """
    size = float(np.abs(places - places.mean(axis=0)).max()) or 1.0
    levers = np.column_stack([np.ones(len(places)), (places - gravity) / size])
    wanted = np.array([weight, 0.0, 0.0])
    plane: Array = np.linalg.lstsq(levers.T @ levers, wanted, rcond=None)[0]
    share: Array = levers @ plane
    balanced = bool(np.abs(levers.T @ share - wanted).max() <= BALANCED * weight)
    return (share if balanced else None), plane / np.array([1.0, size, size])


def _lifted(name: str, places: Array, weight: float, gravity: Point, attraction: Array) -> tuple[Array, Array]:
    """Weight shares and loads where supports lift off: they are removed one by one; one that would press returns.

    With magnets this may go round in circles, or end without a balance: then the largest set that balances is searched.
    """
    resting = np.ones(len(places), dtype=np.bool_)
    for _ in range(2 * len(places)):
        found = _on(resting, places, weight, gravity, attraction)
        if found is None:
            break
        share, load, pressing = found
        if load.min() < -BALANCED * weight:
            resting[np.argmin(load)] = False
        elif pressing.any():
            resting |= pressing
        else:
            return share, np.maximum(load, 0.0)
    for resting in _sets(len(places)):
        found = _on(resting, places, weight, gravity, attraction)
        if found is not None and found[1].min() >= -BALANCED * weight and not found[2].any():
            return found[0], np.maximum(found[1], 0.0)
    return _fails(name, gravity)


def _on(
    resting: Flags, places: Array, weight: float, gravity: Point, attraction: Array
) -> tuple[Array, Array, Flags] | None:
    """Shares and loads (n,) on the resting supports, and which of the others would press; None without a balance."""
    found, plane = _stiff(places[resting], weight, gravity) if resting.any() else (None, np.zeros(3))
    if found is None:
        return None
    share, load = np.zeros(len(places)), np.zeros(len(places))
    share[resting] = found
    load[resting] = found + attraction[resting]
    sunk = np.column_stack([np.ones(len(places)), places - gravity]) @ plane
    return share, load, ~resting & (sunk > BALANCED * weight)


def _sets(count: int) -> Iterator[Flags]:
    """Every set of supports on which a robot can stand, as masks (n,), the largest first; none of too many supports."""
    if count <= MOST_SEARCHED:
        for size in range(count - 1, 2, -1):
            for chosen in combinations(range(count), size):
                yield np.isin(np.arange(count), chosen)


def _fails(name: str, gravity: Point) -> NoReturn:
    raise SimulationError(
        f"{name}: the centre of gravity at ({gravity[0]:g}, {gravity[1]:g}) mm is outside the wheels, "
        "and no attraction holds the robot; move it, or add a support"
    )
