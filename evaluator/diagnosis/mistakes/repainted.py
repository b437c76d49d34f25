"""Two groups of runs with different distances of the marks: repainted marks, another robot, or another calibration."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.recognised import Found
from evaluator.diagnosis.mistakes.spacing import PASSES, spacing
from evaluator.robot_geometry import stated_distances_mm
from simulator.robot import Robot

Floats = NDArray[np.float64]

FEWEST_OF_GROUP = 2  # a single run is found by wrong_scale, at a larger deviation
# Largest change of the distance of the marks if the camera is calibrated again: errors of its scale of 1e-3, and of the
# lens of 8 µm per mark, which is 3e-3 of their 3.66 mm, in both calibrations; three standard deviations.
CHANGED_SHARE = 0.0135
# The same for runs that follow one another: errors of a lens differ with the place on the plate, and a change that is
# the same for all runs before and after it is one of the scale; three standard deviations of two calibrations.
RESCALED_SHARE = 0.0042
APART = 2.0  # least ratio of the gap between two groups to their ranges; runs of one robot scatter evenly
# Runs from which on groups and a keystone are told apart: four unknowns, and as many more for the scatter about them.
# Four runs always form two groups of no range with some keystone; fewer must form them without any, too.
TELLING_RUNS = 8


def repainted_runs(data: Sequence[RunData], robots: Sequence[Robot]) -> list[Found]:
    """The runs whose distance of the marks differs more from the robot file, if all runs form two groups; else none.

    A change of the scale between two days moves the speeds as well: a step of 1.2 % was called a drift of the speed.
    """
    lines_mm = stated_distances_mm(robots)
    spacings = [spacing(run.marks_mm, line) for run, line in zip(data, lines_mm, strict=True)]
    if len(data) < 2 * FEWEST_OF_GROUP or any(run.from_poses for run in data):
        return []
    keystone = np.zeros(2)
    for _ in range(PASSES):  # keystone and both groups together, because groups may have been driven at other places
        straight = [item.without(keystone) for item in spacings]
        share = np.log([float(np.median(item.ratio)) for item in straight])
        larger = _split(share)
        group = np.where(larger, 0.5, -0.5)
        design = np.column_stack([np.ones(len(data)), group, [np.median(item.stretch_mm, axis=0) for item in straight]])
        if not np.isfinite(design).all() or not np.isfinite(share).all():
            return []
        step = np.linalg.lstsq(design, share, rcond=None)[0][2:]
        keystone, share = keystone + step, share - design[:, 2:] @ step
    low, high = share[~larger], share[larger]
    order = np.argsort([run.order for run in data])
    at_once = np.count_nonzero(np.diff(larger[order])) == 1
    least = RESCALED_SHARE if at_once else CHANGED_SHARE
    between = _between(share, larger)
    raw = np.log([float(np.median(item.ratio)) for item in spacings])
    if between < least or (len(data) < TELLING_RUNS and _between(raw, larger) < least):
        return []
    far = larger if abs(np.median(high)) > abs(np.median(low)) else ~larger
    if far.sum() > len(data) / 2 + 1e-9:
        far = ~far
    mine, others = (np.exp(np.median(share[part])) * np.median(np.array(lines_mm)[part]) for part in (far, ~far))
    runs = tuple(run.id for run, is_far in zip(data, far, strict=True) if is_far)
    words = f"their marks are {mine:.4g} mm apart, in the other runs {others:.4g} mm"
    if between < CHANGED_SHARE:
        remedy = "was the camera moved or calibrated again, or were the marks repainted? Diagnose both groups apart"
        return [Found(run, "camera-moved", words, remedy, ("wrong-robot",), group=runs) for run in runs]
    remedy = "were they repainted? Give these runs a robot file of their own (robot, below the run)"
    return [Found(run, "wrong-robot", words, remedy, group=runs) for run in runs]


def _between(values: Floats, larger: NDArray[np.bool_]) -> float:
    """The gap between two groups; 0 if it is small beside the range of one of them."""
    low, high = values[~larger], values[larger]
    gap = float(high.min() - low.max())
    return gap if gap >= APART * max(float(np.ptp(low)), float(np.ptp(high))) else 0.0


def _split(values: Floats) -> NDArray[np.bool_]:
    """Which values lie above the widest gap that leaves a group on either side."""
    order = np.argsort(values)
    gaps = np.diff(values[order])[FEWEST_OF_GROUP - 1 : len(values) - FEWEST_OF_GROUP]
    above = np.zeros(len(values), dtype=np.bool_)
    above[order[FEWEST_OF_GROUP + int(np.argmax(gaps)) :]] = True
    return above
