"""Observed distance of the marks, and the part of its variation that a tilted camera explains."""

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


@dataclass(frozen=True)
class Spacing:
    """Distance of the marks over the stated one in some frames of a run, and its derivative by a keystone.

    ratio: (n,). stretch_mm: (n, 2), the change of the ratio for 1 per mm of keystone along x and y of the plate.
    """

    ratio: Floats
    stretch_mm: Floats


def spacing(marks_mm: Floats, stated_mm: float) -> Spacing:
    """The spacing in frames with both marks (n, 4), of which there must be at least one.

    A scale 1 + k·p stretches the line through the marks, of direction u and middle p, by k·p + (k·u)(p·u).
    """
    seen = np.flatnonzero(np.isfinite(marks_mm).all(axis=1))
    marks = marks_mm[seen[np.unique(np.linspace(0, len(seen) - 1, min(len(seen), FRAMES)).astype(int))]]
    across = marks[:, :2] - marks[:, 2:]
    apart = np.hypot(across[:, 0], across[:, 1])
    line = across / np.maximum(apart, 1e-12)[:, None]
    middle = (marks[:, :2] + marks[:, 2:]) / 2
    return Spacing(apart / stated_mm, middle + line * np.sum(middle * line, axis=1)[:, None])


def by_keystone(run: Spacing, others: Sequence[Spacing]) -> float:
    """Contribution to the median ratio of a run by the keystone that the other runs show; 0 if they are too few.

    By median regression, because one of the others may be another robot itself.
    """
    if len(others) < FEWEST_OTHERS:
        return 0.0
    ratio = np.concatenate([item.ratio for item in others])
    stretch = np.concatenate([item.stretch_mm for item in others])
    design = np.column_stack([np.ones(len(ratio)), stretch])
    weight = np.ones(len(ratio))
    for _ in range(ROUNDS):
        root = np.sqrt(weight)
        found = np.linalg.lstsq(design * root[:, None], ratio * root, rcond=None)[0]
        weight = 1 / np.maximum(np.abs(ratio - design @ found), LEAST_RESIDUAL)
    return float(np.median(run.stretch_mm @ found[1:]))
