"""Derivatives where a finite difference to one side misleads: near a discontinuity, and where motion bends.

On open ground a tiny change of a parameter may give another motion: a robot that turns on the spot continues along one
of two branches. Close to the bifurcation, the finite difference for a derivative contains the jump between both
branches; divided by a small step, it dominates all information of the runs about the parameter. Such a difference is
replaced by that to the other side, where the motion is on the same branch; if both sides jump, the derivative of the
run is set to 0. Where a measurement is so precise that a smooth step moves the features as far as a jump, both
differences agree, which those over a jump do not. At the bound of a parameter, the first half of the step takes the
place of the other side.

On a plate some runs diverge exponentially from their neighbours, such as a backward turn whose sense the friction along
and across the wheels decides. There a step changes the slope itself by half, and the difference to one side is wrong by
as much; the mean of the differences to both sides is exact to second order. A turn on the spot may jump there as well.
Source: one-sided differences at shocks, van Leer (1979), J. Comput. Phys. 32, 101.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized

Floats = NDArray[np.float64]

# Of the features of one run, in sigmas. On ground a step of a derivative, a fifth of a visible change or less, moves
# them by hundredths (of 24 runs of a Husky by 0.00 to 0.05), jumps by five to sixteen.
JUMP = 1.0
# Change of the features of a run by one step of all parameters that the slopes do not explain: in sigmas, and as a
# share of the change. Over the five steps of a visible change it grows to a sigma. Of 16 runs of one experiment eleven
# remain below 0.14, and five turns are at 0.3 to 6; the slopes of the worst were wrong by a third.
BENT, BENT_SHARE = 0.2, 0.05
# Ratio of the differences to both sides on a plate, from which the larger one contains a jump. Motion that bends has at
# most 3 (DIVERGES); the jump of a turn on the spot into its other branch had 300, at which a fit ended 40 below its
# optimum, and the effect that was missing seemed to gain nothing.
OVER_JUMP = 10.0


def jumps(slopes: Floats, steps: Floats) -> list[int]:
    """Columns of the derivatives (k, p) of a run's features that contain a jump over their steps (p,)."""
    return [int(i) for i in np.flatnonzero(np.linalg.norm(slopes * steps, axis=0) > JUMP)]


def smooth_slope(ahead: Floats, here: Floats, beside: Floats, step: float, amount: float) -> Floats:
    """Slope (k,) of a run's features by their difference to a point beside, 0 if it contains a jump or is not known.

    ahead: slope over a whole step, which may contain a jump; amount: distance of the point beside, negative behind.
    """
    slope = (here - beside) / amount
    if not np.isfinite(slope).all():
        return np.zeros_like(here)
    apart, size = (float(np.linalg.norm(part * step)) for part in (ahead - slope, ahead))
    smooth = apart <= max(JUMP, BENT_SHARE * size)
    return np.asarray(slope) if smooth or not jumps(slope[:, None], np.array([amount])) else np.zeros_like(here)


def bends(view: Linearized, columns: Sequence[int], steps: Floats, change: Floats) -> bool:
    """Whether the slopes of a run miss the change (k,) of its features by one step back of all these columns.

    Start poses are fitted, so that a change that they explain does not count.
    """
    basis = np.linalg.qr(view.start)[0]
    expected = view.common[:, columns] @ steps[columns]
    missed, expected = (part - basis @ (basis.T @ part) for part in (change - expected, expected))
    size = float(np.linalg.norm(missed))
    return size > BENT and size > BENT_SHARE * float(np.linalg.norm(expected))


def central_slope(slope: Floats, here: Floats, behind: Floats, step: float) -> Floats:
    """The mean (k,) of a forward slope and the backward difference of features; one of them if the other jumps."""
    back = (behind - here) / step
    small, large = sorted((slope, back), key=lambda part: float(np.linalg.norm(part)))
    size = float(np.linalg.norm(large)) * abs(step)
    if size > JUMP and size > OVER_JUMP * float(np.linalg.norm(small)) * abs(step):
        return np.asarray(small)
    return (slope + back) / 2


def with_slopes(
    views: Sequence[Linearized | None], slopes: Mapping[tuple[int, int], Floats], theta: Floats
) -> list[Linearized | None]:
    """Linearizations of runs with some derivatives (k,) replaced, by run and common parameter, at theta (p,)."""
    found = list(views)
    for (number, i), slope in slopes.items():
        view = found[number]
        assert view is not None
        common = view.common.copy()
        common[:, i] = slope
        found[number] = replace(view, common=common, response=view.response + (common - view.common) @ theta)
    return found
