"""Phases of a run with several motions: rest, straight, turn, turn on the spot, transient.

A steady motion has a constant direction of its velocity (forward, sideways, yaw) in the body frame, at any speed. The
run is cut where this direction changes: the piecewise constant direction of least squares, with a price for each piece
(optimal partitioning, Jackson et al. 2005, doi:10.1109/LSP.2001.838216). Pieces are then fitted one by one, and
neighbours that are one motion by their fits are joined.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from evaluator.turning.motion.curvature import Curvature
from evaluator.turning.motion.fit import FEWEST_FRAMES, Scaled, fit_turn, part
from evaluator.turning.phases import MOVING_SHARE, REST_SIGMA, Rates, local_rates
from evaluator.turning.status import straightness

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Kind = Literal["rest", "straight", "turn", "spot", "transient"]
NAN = float("nan")

DIRECTION_SHARE = 0.05  # required precision of a local direction, rad; windows are as short as it allows
SHORTEST_SHARE = 40  # a window extends by at most this part of the run to either side, so that short corners stay sharp
SAME_DIRECTION = 0.02  # rad: variation of the direction within one motion
PRICE = 10.0  # of a piece, times the logarithm of the samples: noise correlated over some samples makes no piece
MOST_SAMPLES = 400  # of a run among which cuts are searched, in a time that grows with their square
JOINED = 1.25  # ratio of curvatures below which neighbours are one motion with a varying radius
SPOT_SHARE = 0.2  # on the spot: the centre's circle is smaller than this share of half the distance of the marks
COUNTS_SHARE, COUNTS_DEG = 0.1, 45.0  # a motion counts from this share of the moving time, or this turn, on


@dataclass(frozen=True)
class Phase:
    """One phase: times in s, kind, radius of the centre with 95 % bounds (turns only), speed, turn (signed, ccw).

    Speed is positive forward; the turn is that of the heading.
    """

    start_s: float
    stop_s: float
    kind: Kind
    radius_mm: float = NAN
    radius_low_mm: float = NAN
    radius_high_mm: float = NAN
    speed_mm_s: float = NAN
    turned_deg: float = NAN

    @property
    def motion(self) -> tuple[str, bool, bool]:
        """Kind of motion; equal for phases that could be one steady motion."""
        return self.kind, self.speed_mm_s > 0, self.kind != "straight" and self.turned_deg > 0

    def within(self, start_s: float | None, stop_s: float | None) -> Phase | None:
        """The part of the phase between two times, None if there is none."""
        first = self.start_s if start_s is None else max(self.start_s, start_s)
        last = self.stop_s if stop_s is None else min(self.stop_s, stop_s)
        if last <= first:
            return None
        share = (last - first) / (self.stop_s - self.start_s)
        return replace(self, start_s=first, stop_s=last, turned_deg=share * self.turned_deg)


@dataclass(frozen=True)
class _Piece:
    first: int
    stop: int
    phase: Phase
    curvature: Curvature | None


def phase_table(time_s: Array, scaled: Scaled, stretched: Array, inside: Flags) -> tuple[Phase, ...]:
    """Find the phases of a run, in order of time.

    stretched: (n, 3) poses in mm; inside: (n,) frames between the commands.
    """
    smooth = median_filter(stretched, size=(5, 1), mode="nearest")
    rates = _local_rates(time_s, smooth, scaled.sigma_mm, inside)
    heading = scaled.pose[:, 2]
    cos, sin, velocity = np.cos(heading), np.sin(heading), rates.value
    twist = np.column_stack(
        [cos * velocity[:, 0] + sin * velocity[:, 1], cos * velocity[:, 1] - sin * velocity[:, 0], velocity[:, 2]]
    )
    speed = np.linalg.norm(twist, axis=1)
    usual = float(np.median(speed[speed >= np.percentile(speed, 95) / 2]))
    moving = speed > max(MOVING_SHARE * usual, REST_SIGMA * rates.sigma)
    direction = np.where(moving[:, None], twist / np.maximum(speed, 1e-300)[:, None], 0.0)
    step = max(rates.half_width, len(time_s) // MOST_SAMPLES, 1)
    samples = direction[step // 2 :: step]
    noise = float(np.hypot(rates.sigma / usual, SAME_DIRECTION)) if usual else 1.0
    bounds = [0, *(min(cut * step, len(time_s)) for cut in _cuts(samples / noise)), len(time_s)]
    pieces = [
        _measured(time_s, scaled, twist, moving, first, stop, rates.half_width)
        for first, stop in pairwise(bounds)
        if stop > first
    ]
    joined: list[_Piece] = []
    for piece in pieces:
        joined.append(piece)
        while len(joined) > 1 and _same(joined[-2], joined[-1]):
            last = joined.pop()
            joined[-1] = _measured(time_s, scaled, twist, moving, joined[-1].first, last.stop, rates.half_width)
    return tuple(piece.phase for piece in joined)


def several_motions(phases: tuple[Phase, ...], start_s: float | None = None, stop_s: float | None = None) -> str:
    """Sentence on a run with several motions between its commands; "" for a single one.

    A robot that is driven back or carried away after stop_s has one motion.
    """
    commanded = (phase.within(start_s, stop_s) for phase in phases)
    driven = [phase for phase in commanded if phase is not None and phase.kind not in ("rest", "transient")]
    total = sum(phase.stop_s - phase.start_s for phase in driven)
    counting = [
        phase
        for phase in driven
        if phase.stop_s - phase.start_s >= COUNTS_SHARE * total or abs(phase.turned_deg) >= COUNTS_DEG
    ]
    if len({phase.motion for phase in counting}) < 2:
        return ""
    names = {"straight": "straight", "turn": "turn", "spot": "turn on the spot"}
    counts = Counter(names[phase.kind] for phase in counting)
    said = ", ".join(f"{count} {name}" for name, count in counts.items())
    return f"several motions ({said}): no single radius or speed; see the phases"


def _local_rates(time_s: Array, smooth: Array, sigma_mm: float, inside: Flags) -> Rates:
    """Velocities over the shortest windows that distinguish directions."""
    longest = max(len(time_s) // SHORTEST_SHARE, 2)
    return local_rates(time_s, smooth, sigma_mm, inside, share=DIRECTION_SHARE, longest=longest)


def _cuts(samples: Array) -> list[int]:
    """Indices at which the mean of (m, 3) samples of unit noise changes."""
    m = len(samples)
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(samples, axis=0)])
    squares = np.concatenate([[0.0], np.cumsum((samples**2).sum(axis=1))])
    best, last = np.zeros(m + 1), np.zeros(m + 1, dtype=int)
    price = PRICE * np.log(max(m, 2))
    for stop in range(1, m + 1):
        first = np.arange(stop)
        mean = total[stop] - total[first]
        cost = squares[stop] - squares[first] - (mean**2).sum(axis=1) / (stop - first)
        values = best[first] + cost + price
        last[stop] = int(np.argmin(values))
        best[stop] = values[last[stop]]
    cuts, place = [], m
    while last[place] > 0:
        place = int(last[place])
        cuts.append(place)
    return cuts[::-1]


def _measured(
    time_s: Array, scaled: Scaled, twist: Array, moving: Flags, first: int, stop: int, half_width: int
) -> _Piece:
    """Fit a piece without half a window at its ends, where the rates include those of its neighbours."""
    start_s, stop_s = float(time_s[first]), float(time_s[stop - 1])
    margin = min(half_width, (stop - first) // 4)
    here = np.zeros(len(time_s), dtype=bool)
    here[first + (margin if first else 0) : stop - (margin if stop < len(time_s) else 0)] = True
    turned = float(np.degrees(scaled.pose[stop - 1, 2] - scaled.pose[first, 2]))
    if moving[first:stop].mean() < 0.5:
        return _Piece(first, stop, Phase(start_s, stop_s, "rest", speed_mm_s=0.0, turned_deg=turned), None)
    here &= moving
    if here.sum() < 2 * FEWEST_FRAMES:
        return _Piece(first, stop, Phase(start_s, stop_s, "transient", turned_deg=turned), None)
    fit = fit_turn(time_s[here], part(scaled, here))
    offset, yaw = scaled.offset_mm, twist[here, 2] / scaled.length_mm  # twist is that of the point between the marks
    velocity = np.column_stack([twist[here, 0] + yaw * offset[1], twist[here, 1] - yaw * offset[0]])
    way = np.sign(np.median(velocity[:, 0])) or 1.0
    phase = Phase(start_s, stop_s, "turn", speed_mm_s=float(way * np.hypot(*velocity.mean(axis=0))), turned_deg=turned)
    curvature = fit.curvature()
    if straightness(fit):
        return _Piece(first, stop, replace(phase, kind="straight"), curvature)
    radius = curvature.with_radius_error(fit.radius_by_places_mm()).radius_mm()
    kind: Kind = "spot" if radius[0] < SPOT_SHARE * scaled.length_mm else "turn"
    phase = replace(phase, kind=kind, radius_mm=radius[0], radius_low_mm=radius[1], radius_high_mm=radius[2])
    return _Piece(first, stop, phase, curvature)


def _same(one: _Piece, other: _Piece) -> bool:
    """Whether neighbours are one motion by their fits."""
    if one.curvature is None or other.curvature is None:
        return one.phase.kind == other.phase.kind
    if (one.phase.speed_mm_s > 0) != (other.phase.speed_mm_s > 0):
        return False
    if one.phase.kind == other.phase.kind != "turn":
        return True
    if "straight" in (one.phase.kind, other.phase.kind):
        bent, flat = (one, other) if other.phase.kind == "straight" else (other, one)
        assert bent.curvature is not None  # both have one
        assert flat.curvature is not None
        half = bent.curvature.value / 2  # half the curvature is not distinguished from a neighbour
        return flat.curvature.low <= half <= flat.curvature.high or half * flat.curvature.value > half**2
    first, second = one.curvature.value, other.curvature.value
    return first * second > 0 and max(first / second, second / first) < JOINED
