"""Runs by their commands, and which of them are held out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from evaluator.diagnosis.likelihood.run_data import RunData


def runs_by_command(data: Sequence[RunData]) -> dict[tuple[float, float], list[int]]:
    """Indices of the runs of every command, in the order of the experiment."""
    groups: dict[tuple[float, float], list[int]] = {}
    for number, run in enumerate(data):
        groups.setdefault(run.command, []).append(number)
    return groups


def held_out_runs(data: Sequence[RunData]) -> tuple[int, ...]:
    """Whole runs to hold out: about a sixth, chosen by their commands alone, before anything is fitted.

    First all runs of one command (a speed, a side or a direction that is then not fitted), if other commands have its
    direction; then single repetitions of other commands, spread over the session.
    """
    wanted = len(data) // 6 if len(data) >= 6 else 0
    if not wanted:
        return ()
    groups = runs_by_command(data)
    chosen: list[int] = []
    whole = [
        (len(runs), -abs(command[0]) - abs(command[1]), command)
        for command, runs in groups.items()
        if len(runs) <= wanted and len(groups) > 3 and _others_alike(command, groups)
    ]
    if whole:
        chosen += groups.pop(min(whole)[2])
    spread = sorted(groups.items(), key=lambda item: (-len(item[1]), item[0]))
    for _, runs in spread:
        if len(chosen) >= wanted:
            break
        if len(runs) > 1:
            chosen.append(runs[len(runs) // 2])
    for number in range(len(data) // 3, len(data)):  # without repetitions, single runs from the middle on
        if len(chosen) >= wanted:
            break
        if number not in chosen:
            chosen.append(number)
    return tuple(sorted(chosen))


def _others_alike(command: tuple[float, float], groups: Mapping[tuple[float, float], Sequence[int]]) -> bool:
    """Whether another command drives in the same direction and turns to the same side."""

    def kind(item: tuple[float, float]) -> tuple[bool, int]:
        return item[0] + item[1] > 0, int(np.sign(item[0] - item[1]))

    return any(other != command and kind(other) == kind(command) for other in groups)
