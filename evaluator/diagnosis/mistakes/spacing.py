"""Observed distance of the marks, and the part of its variation that a tilted camera explains.

A tilted camera shows the point P of the plate at M = P/(1 − k·P), so that P = M/(1 + k·M): corrections by two keystones
add up. With k of 0.003 per mm, as a camera tilted by 30 degrees has, marks at the edges of a plate seem 20 % closer or
farther apart, and the first order in k is wrong by 4 %.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

FRAMES = 40  # per run, which suffice for a smooth path
FEWEST_OTHERS = 4  # runs from which the change of scale over the plate is learned
ROUNDS = 30  # of reweighting; a median regression of some hundred points settles in a dozen
LEAST_RESIDUAL = 1e-4  # residual below which the weight of a point no longer increases
# Largest change of the distance of the marks if the camera is calibrated again: errors of its scale of 1e-3, and of the
# lens of 8 µm per mark, which is 3e-3 of their 3.66 mm, in both calibrations; three standard deviations.
CHANGED_SHARE = 0.0135
PASSES = 4  # of linearization; the error of 4 % becomes 0.2 % with the second


@dataclass(frozen=True)
class Spacing:
    """Distance of the marks over the stated one in some frames of a run, and its derivative by a keystone.

    ratio: (n,). stretch_mm: (n, 2), the change of the ratio for 1 per mm of keystone along x and y of the plate.
    marks_mm: (n, 4), stated_mm: from which both follow.
    """

    ratio: Floats
    stretch_mm: Floats
    marks_mm: Floats
    stated_mm: float

    @property
    def middle_mm(self) -> Floats:
        """Midpoints of the marks (n, 2)."""
        return _middle(self.marks_mm)

    def without(self, keystone: Floats) -> Spacing:
        """The spacing without a keystone (2,), per mm; its own is then NaN beyond the horizon of the camera."""
        points = self.marks_mm.reshape(-1, 2, 2)
        depth = 1 + points @ keystone
        with np.errstate(divide="ignore"):
            points = points / np.where(depth > 0, depth, np.nan)[:, :, None]
        return _spacing(points.reshape(-1, 4), self.stated_mm)


def spacing(marks_mm: Floats, stated_mm: float) -> Spacing:
    """The spacing in frames with both marks (n, 4), of which there must be at least one.

    A scale 1 + k·p stretches the line through the marks, of direction u and middle p, by k·p + (k·u)(p·u).
    """
    seen = np.flatnonzero(np.isfinite(marks_mm).all(axis=1))
    return _spacing(
        marks_mm[seen[np.unique(np.linspace(0, len(seen) - 1, min(len(seen), FRAMES)).astype(int))]], stated_mm
    )


def _spacing(marks: Floats, stated_mm: float) -> Spacing:
    across = marks[:, :2] - marks[:, 2:]
    apart = np.hypot(across[:, 0], across[:, 1])
    line = across / np.maximum(apart, 1e-12)[:, None]
    middle = _middle(marks)
    stretch_mm = middle + line * np.sum(middle * line, axis=1)[:, None]
    return Spacing(apart / stated_mm, stretch_mm, marks, stated_mm)


def _middle(marks: Floats) -> Floats:
    return np.asarray((marks[:, :2] + marks[:, 2:]) / 2)


def by_keystone(run: Spacing, others: Sequence[Spacing]) -> float:
    """Contribution to the median ratio of a run by the keystone that the other runs show; 0 if they are too few."""
    if len(others) < FEWEST_OTHERS:
        return 0.0
    corrected = run.without(keystone_of(others)).ratio
    return float(np.median(run.ratio) - np.median(corrected)) if np.isfinite(corrected).all() else 0.0


def keystone_of(runs: Sequence[Spacing]) -> Floats:
    """The keystone (2,), per mm, that runs show by the distances of their marks; 0 where they show none.

    By median regression, because one of them may be another robot.
    """
    found = np.zeros(2)
    for _ in range(PASSES):
        step = _step([item.without(found) for item in runs])
        if not np.isfinite(step).all():
            return np.zeros(2)
        found = found + step
    return found


def _step(runs: Sequence[Spacing]) -> Floats:
    """Median regression of the ratios of all frames on a keystone (2,), to first order."""
    ratio = np.concatenate([item.ratio for item in runs])
    stretch = np.concatenate([item.stretch_mm for item in runs])
    design = np.column_stack([np.ones(len(ratio)), stretch])
    if not np.isfinite(design).all():
        return np.full(2, np.nan)
    weight = np.ones(len(ratio))
    found = np.zeros(3)
    for _ in range(ROUNDS):
        root = np.sqrt(weight)
        found = np.linalg.lstsq(design * root[:, None], ratio * root, rcond=None)[0]
        weight = 1 / np.maximum(np.abs(ratio - design @ found), LEAST_RESIDUAL)
    return found[1:]
