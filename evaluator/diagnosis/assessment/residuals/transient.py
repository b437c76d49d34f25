"""A transient that all changes of the command share: a course of the residuals, as of motors that overshoot or ring.

After every jump of the command the residual way is that of one shape, times the jump, beside a slow course of its own.
Runs that lack other physics differ from change to change, as heading, place and side do, and share no such shape.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.assessment.residuals.disagreement import QUANTITIES, UNITS, Dependence
from evaluator.diagnosis.assessment.residuals.ways import Ways, residual_ways

if TYPE_CHECKING:
    from evaluator.diagnosis.likelihood.point import Point
    from evaluator.diagnosis.likelihood.problem import Problem

Floats = NDArray[np.float64]

# Share of the squares after all changes that one shape must explain. Of sessions without a transient see
# tests/benchmarks/diagnosis.md: 0.18 at most; motors that ring had 0.98.
EXPLAINS = 0.5
LASTS_S = (0.4, 0.8, 1.6)  # windows after a change, of which the one that is explained best is told
PARTS = 16  # pieces of the shape
SLOW = 2  # degree of the slow course beside it: a start, a speed and a drift of its own
# Until then a lag of some milliseconds acts, which every motor has, and half a frame that a start is late.
SKIPPED_S = 0.05
FEWEST_FRAMES, FEWEST_CHANGES, FEWEST_KINDS = 10, 8, 3  # of a window; windows; different jumps among them
LEAST_JUMP = 0.1  # of the largest: smaller ones tell nothing
BY = "change of the command"


def transient(problem: Problem, point: Point) -> Dependence | None:
    """The course of speed or yaw rate that all changes of the command share at a point of a model; None without one.

    Its size is the largest deviation of the velocity, for a jump as large as the RMS of all, and its rms that of an
    oscillation as large. Its sigmas count every frame as independent, and are the most that they can be.
    """
    ways, found = residual_ways(problem, point), []
    for quantity in ("along_mm_s", "yaw_deg_s"):
        for lasts_s in LASTS_S:
            windows = [window for way in ways for window in _windows(way, quantity, lasts_s)]
            jumps = [window.jump for window in windows]
            if len(jumps) >= FEWEST_CHANGES and len({round(abs(jump), 3) for jump in jumps}) >= FEWEST_KINDS:
                found.append((*_explained(windows, lasts_s), quantity, lasts_s, windows))
    if not found:
        return None
    share, speed, quantity, lasts_s, windows = max(found, key=lambda item: item[0])
    if share < EXPLAINS:
        return None
    sentence = (
        f"measured {QUANTITIES[quantity]} deviates alike after every change of the command, by up to {speed:.2g} "
        f"{UNITS[quantity]} within {lasts_s:g} s, as motors do that overshoot or ring (that explains "
        f"{100 * share:.0f} % of what is left there)"
    )
    sigmas = float(np.sqrt(sum(len(window.time_s) for window in windows) * share))
    return Dependence(quantity, BY, "", sigmas, sentence, ((speed, speed, speed),), speed / np.sqrt(2))


@dataclass(frozen=True)
class _Window:
    """Residual way (n,) after a change of the command, at times (n,) since it; the jump, rpm, that drives it."""

    time_s: Floats
    way: Floats
    jump: float


def _windows(ways: Ways, quantity: str, lasts_s: float) -> list[_Window]:
    """The windows of this length of a run in which the command is constant after a jump, less small jumps."""
    windows = []
    for before, held in pairwise(ways.run.run_command.command.stretches()):
        left, right = held.left_rpm - before.left_rpm, held.right_rpm - before.right_rpm
        jump = (left + right) / 2 if quantity == "along_mm_s" else (right - left) / 2
        if before.end_s != held.begin_s or held.end_s - held.begin_s < lasts_s:  # a ramp, or changed again
            continue
        since = ways.time_s - held.begin_s
        inside = (since > SKIPPED_S) & (since < lasts_s)
        if inside.sum() >= FEWEST_FRAMES and np.ptp(since[inside]) > (lasts_s - SKIPPED_S) / 2:
            way = ways.along_mm if quantity == "along_mm_s" else ways.turned_deg
            windows.append(_Window(since[inside], way[inside], jump))
    largest = max((abs(window.jump) for window in windows), default=0.0)
    return [window for window in windows if abs(window.jump) > LEAST_JUMP * largest]


def _explained(windows: list[_Window], lasts_s: float) -> tuple[float, float]:
    """Share of the squares of windows that a common shape explains, and its largest velocity for an RMS jump."""
    knots = np.linspace(SKIPPED_S, lasts_s, PARTS + 1)
    shapes, rests = [], []
    for window in windows:
        parts = np.array([np.interp(window.time_s, knots, unit) for unit in np.eye(PARTS + 1)]).T * window.jump
        slow = np.linalg.qr(np.vander(window.time_s / lasts_s, SLOW + 1))[0]
        shapes.append(parts - slow @ (slow.T @ parts))
        rests.append(window.way - slow @ (slow.T @ window.way))
    shape, rest = np.concatenate(shapes), np.concatenate(rests)
    size = np.linalg.lstsq(shape, rest, rcond=1e-6)[0]
    squares = float(rest @ rest)
    share = 1.0 - float(np.sum((rest - shape @ size) ** 2)) / squares if squares > 0 else 0.0
    # no window tells a shape from the slow courses: it has settled in the second half
    late = knots >= lasts_s / 2
    settled = size - np.polyval(np.polyfit(knots[late], size[late], SLOW), knots)
    speed = np.diff(settled) / np.diff(knots)
    return share, float(np.abs(speed).max()) * float(np.sqrt(np.mean([window.jump**2 for window in windows])))
