"""Runs by their commands, and which of them are held out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.recognised import recording_of

FEWEST_RECORDINGS = 6  # in parts, that are left out one by one


def runs_by_command(data: Sequence[RunData]) -> dict[tuple[float, float], list[int]]:
    """Indices of the runs of every command, in the order of the experiment."""
    groups: dict[tuple[float, float], list[int]] = {}
    for number, run in enumerate(data):
        groups.setdefault(run.command, []).append(number)
    return groups


def left_out_together(data: Sequence[RunData]) -> list[NDArray[np.int64]]:
    """Indices of the runs that cross-validation leaves out at a time: those of a command, or the parts of a recording.

    The parts of a recording share its friction, load and place, so that what fits these would seem to predict its other
    parts: on open ground, where friction that differs by 3 % between recordings is no random effect, forces that depend
    on the place did. Where there are too few recordings, the commands have to do.
    """
    recordings: dict[str, list[int]] = {}
    for number, run in enumerate(data):
        recordings.setdefault(recording_of(run.id), []).append(number)
    in_parts = FEWEST_RECORDINGS <= len(recordings) < len(data)
    groups = recordings.values() if in_parts else runs_by_command(data).values()
    return [np.array(group) for group in groups]


def held_out_runs(data: Sequence[RunData]) -> tuple[int, ...]:
    """Whole runs to hold out: about a sixth, chosen by their commands alone, before anything is fitted.

    First all runs of one command (a speed, a side or a direction that is then not fitted), if other commands have its
    direction; then single repetitions of other commands, spread over the session. Where there is a choice, the fitted
    runs keep every direction and side that is driven, if only in a part of a log: of twelve runs two drove backward,
    and without them no effect that differs between forward and backward was seen.
    """
    wanted = len(data) // 6 if len(data) >= 6 else 0
    if not wanted:
        return ()
    groups = runs_by_command(data)
    chosen: list[int] = []
    driven = [_kinds(run) for run in data]

    def keeps_all(held_out: Sequence[int]) -> bool:
        """Whether the other runs drive in every direction and turn to every side that any run does."""
        kept = (kinds for number, kinds in enumerate(driven) if number not in held_out)
        return set().union(*kept) == set().union(*driven)

    whole = [
        (len(runs), -abs(command[0]) - abs(command[1]), command)
        for command, runs in groups.items()
        if len(runs) <= wanted and len(groups) > 3 and _others_alike(command, groups) and keeps_all(runs)
    ]
    if whole:
        chosen += groups.pop(min(whole)[2])
    spread = sorted(groups.items(), key=lambda item: (-len(item[1]), item[0]))
    for _, runs in spread:
        if len(chosen) >= wanted:
            break
        if len(runs) > 1:
            middle = len(runs) // 2
            chosen.append(next((k for k in [*runs[middle:], *runs[:middle]] if keeps_all([*chosen, k])), runs[middle]))
    # without repetitions, single runs from the middle on
    for number in sorted(range(len(data) // 3, len(data)), key=lambda k: not keeps_all([*chosen, k])):
        if len(chosen) >= wanted:
            break
        if number not in chosen:
            chosen.append(number)
    return tuple(sorted(chosen))


def _others_alike(command: tuple[float, float], groups: Mapping[tuple[float, float], Sequence[int]]) -> bool:
    """Whether another command drives in the same direction and turns to the same side."""
    return any(other != command and _kind(other) == _kind(command) for other in groups)


def _kind(command: tuple[float, float]) -> tuple[bool, int]:
    """Direction and side of a command."""
    return command[0] + command[1] > 0, int(np.sign(command[0] - command[1]))


def _kinds(run: RunData) -> set[tuple[bool, int]]:
    """Directions and sides in which a run drives, each for a part of it at least."""
    return {_kind((item.left_rpm, item.right_rpm)) for item in run.run_command.driven}
