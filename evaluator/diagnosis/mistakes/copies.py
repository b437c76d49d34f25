"""Runs with the same recording, which counts once, with the command that its motion agrees with."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.recognised import Found

FEWEST = 10  # frames with both marks: rounded values of fewer frames could agree by chance


def copies(data: Sequence[RunData]) -> list[Found]:
    """Runs whose marks are those of an earlier run of the same command, frame for frame.

    A copy under another command is left to the comparison with the simulation, which shows which command is wrong.
    Two recordings never agree to the last digit: noise differs. Times may be shifted: a copy may count from elsewhere.
    """
    first: dict[tuple[bytes, tuple[tuple[float, float], ...]], str] = {}
    found = []
    for run in data:
        seen = run.marks_mm[np.isfinite(run.marks_mm).all(axis=1)]
        if len(seen) < FEWEST or not np.ptp(seen, axis=0).any():
            continue
        key = seen.tobytes(), tuple((stretch.left_rpm, stretch.right_rpm) for stretch in run.run_command.driven)
        if key in first:
            words = f"has the same marks as {first[key]}, frame for frame, and counts once"
            found.append(Found(run.id, "duplicate", words, "is it the right recording?"))
        first.setdefault(key, run.id)
    return found
