"""Wheels that stand at the slowest commands of a session: a dead band or a static friction, not motors that are off."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.recognised import Found

SEVERAL = 2  # runs with wheels that stand; of a single one, a motor may be off


def beyond_a_dead_band(found: Sequence[Found], data: Sequence[RunData], standing: Collection[str]) -> list[Found]:
    """The findings without those of wheels that stand below a speed from which all other wheels turn.

    standing: ids of the runs that hardly move. Accidents do not choose the slowest wheels of several commands; an
    effect does, and is left to the diagnosis. Runs with a log are not judged: they pass the threshold.
    """
    of_run = {item.run: item for item in found}
    still: list[float] = []
    turning: list[float] = []
    slow: set[str] = set()
    for run in data:
        if run.log is not None:
            continue
        item = of_run.get(run.id)
        stands = _stands(run, item, run.id in standing)
        if stands is None:
            continue
        for rpm, is_still in zip(run.command, stands, strict=True):
            if not rpm:
                continue
            (still if is_still else turning).append(abs(rpm))
            if is_still and item is not None:
                slow.add(run.id)
    if len(slow) < SEVERAL or max(still) >= min(turning, default=0.0):
        return list(found)
    return [item for item in found if item.run not in slow]


def _stands(run: RunData, item: Found | None, whole: bool) -> tuple[bool, bool] | None:
    """Whether the left and the right wheels of a run stand; None if its finding tells neither."""
    if whole:
        return True, True
    if item is None:
        return False, False
    if item.kind != "wrong-command" or item.correction is None or item.correction.command is None:
        return None
    pairs = list(zip(run.command, item.correction.command, strict=True))
    if not all(right in (stated, 0.0) for stated, right in pairs):
        return None
    left, right = (bool(stated) and not right for stated, right in pairs)
    return left, right
