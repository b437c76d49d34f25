"""Runs with the same recording, which counts once, with the command that its motion agrees with."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.recognised import Found

FEWEST = 10  # frames with both marks: rounded values of fewer frames could agree by chance


def copies(data: Sequence[RunData]) -> list[Found]:
    """Runs whose marks are those of an earlier run of the same command, frame for frame.

    A copy under another command is left to `contradicting_copies`: a simulation may show which command is wrong.
    Two recordings never agree to the last digit: noise differs. Times may be shifted: a copy may count from elsewhere.
    """
    found = []
    for runs in _same_marks(data):
        first: dict[object, str] = {}
        for run in runs:
            original = first.setdefault(_command(run), run.id)
            if original != run.id:
                words = f"has the same marks as {original}, frame for frame, and counts once"
                found.append(Found(run.id, "duplicate", words, "is it the right recording?"))
    return found


def contradicting_copies(data: Sequence[RunData], known: Sequence[Found]) -> list[Found]:
    """Runs with the same marks under several commands: those whose command the marks contradict, otherwise all.

    known: mistakes of runs. A run that contradicts its command is a copy of one that does not, and has no command of
    its own to be corrected. If all contradict theirs, they are not copies of a run in its place.
    """
    kinds = {item.run: item.kind for item in known}
    found = []
    for runs in _same_marks(data):
        once = [run for run in runs if kinds.get(run.id) != "duplicate"]
        if len({_command(run) for run in once}) < 2:
            continue
        right, wrong = ([run.id for run in once if (run.id in kinds) == bad] for bad in (False, True))
        if right and wrong:
            words = f"has the same marks as {right[0]}, frame for frame, but another command, which they contradict"
            remedy = "is it the right recording?"
            found += [Found(run, "duplicate", words, remedy, equivalent=(kinds[run],)) for run in wrong]
        elif right:
            words = "have the same marks, frame for frame, but different commands"
            remedy = "find out which command belongs to this recording, and remove the other run"
            found += [Found(run, "duplicate", words, remedy, group=tuple(right)) for run in right]
    return found


def _same_marks(data: Sequence[RunData]) -> list[list[RunData]]:
    """Runs with the same marks, where several have them."""
    alike: dict[bytes, list[RunData]] = {}
    for run in data:
        seen = run.marks_mm[np.isfinite(run.marks_mm).all(axis=1)]
        if len(seen) >= FEWEST and np.ptp(seen, axis=0).any():
            alike.setdefault(seen.tobytes(), []).append(run)
    return [runs for runs in alike.values() if len(runs) > 1]


def _command(run: RunData) -> object:
    return tuple((stretch.left_rpm, stretch.right_rpm) for stretch in run.run_command.driven)
