"""Two groups of runs with different distances of the marks: repainted marks, another robot, or another calibration.

Marks glued on anew between two runs are no mistake: a diagnosis gives the later runs marks of their own
(changes.stepped_values). A camera set up anew changes the speeds of the robot as well as the distance of its marks.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.misread.command_unit import speeds_over_simulated
from evaluator.diagnosis.mistakes.recognised import Found
from evaluator.diagnosis.mistakes.spacing import CHANGED_SHARE, PASSES, spacing
from evaluator.robot_geometry import stated_distances_mm
from evaluator.robust import PER_MEDIAN
from simulator.robot import Robot

Floats = NDArray[np.float64]

FEWEST_OF_GROUP = 2  # a single run is found by wrong_scale, at a larger deviation
# Largest change as spacing.CHANGED_SHARE for runs that follow one another: errors of a lens differ with the place on
# the plate, and a change that is the same for all runs before and after it is one of the scale; three standard
# deviations of two calibrations.
RESCALED_SHARE = 0.0042
APART = 2.0  # least ratio of the gap between two groups to their ranges; runs of one robot scatter evenly
FEWEST_OF_PART = 3  # runs before and after a change within the session: the scatter of fewer is not known
SIGMAS = 3.0  # standard deviations from which speeds have changed, and to which gluing changes a distance
MEDIAN_ERROR = float(np.sqrt(np.pi / 2))  # of a median of normal numbers, in errors of their mean
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
    moved = at_once and _seen_otherwise(data, robots, larger, between)
    if at_once and not moved and _glued_anew(robots, larger, between):
        return []
    far = larger if abs(np.median(high)) > abs(np.median(low)) else ~larger
    if far.sum() > len(data) / 2 + 1e-9:
        far = ~far
    mine, others = (np.exp(np.median(share[part])) * np.median(np.array(lines_mm)[part]) for part in (far, ~far))
    runs = tuple(run.id for run, is_far in zip(data, far, strict=True) if is_far)
    words = f"their marks are {mine:.4g} mm apart, in the other runs {others:.4g} mm"
    if moved or between < CHANGED_SHARE:
        remedy = "was the camera moved or calibrated again, or were the marks repainted? Diagnose both groups apart"
        return [Found(run, "camera-moved", words, remedy, ("wrong-robot",), group=runs) for run in runs]
    remedy = "were they repainted? Give these runs a robot file of their own (robot, below the run)"
    return [Found(run, "wrong-robot", words, remedy, group=runs) for run in runs]


def _glued_anew(robots: Sequence[Robot], larger: NDArray[np.bool_], change: float) -> bool:
    """Whether a relative change of the distance, with enough runs before and after, is one that gluing makes.

    Two marks have errors along their line before and after, each as large as their positions are known to.
    """
    lines_mm = zip(robots, stated_distances_mm(robots), strict=True)
    sigma = max(2 * robot.known_to.mark_position_mm / line for robot, line in lines_mm)
    return bool(min(larger.sum(), (~larger).sum()) >= FEWEST_OF_PART and change < SIGMAS * sigma)


def _seen_otherwise(data: Sequence[RunData], robots: Sequence[Robot], larger: NDArray[np.bool_], change: float) -> bool:
    """Whether the speeds of both groups differ significantly, and rather as the distances of their marks than not."""
    ratio = speeds_over_simulated(data, robots)
    groups = [np.log(ratio[part & (ratio > 0)]) for part in (larger, ~larger)]  # a reversed run says nothing
    if min(map(len, groups)) < FEWEST_OF_GROUP:
        return False
    of_speed = float(np.median(groups[0]) - np.median(groups[1]))
    off = np.concatenate([np.abs(part - np.median(part)) for part in groups])
    error = MEDIAN_ERROR * PER_MEDIAN * float(np.median(off)) * np.sqrt(sum(1 / len(part) for part in groups))
    return bool(of_speed > max(change / 2, SIGMAS * error))


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
