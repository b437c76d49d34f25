"""Long sessions of full-size robots: recordings cut into pieces, and runs that suffice of hundreds.

What ground does to a robot adds up, so that after a minute no model is near its path, whatever is right in it. A person
who drives a robot about for twenty minutes records one run. It is cut at changes of command, or after some seconds
where none is near; motors are told in each piece what they were told before it.

A diagnosis takes as long as it has runs, and beyond some dozens of commands further ones hardly decide. Which runs
decide is chosen by their commands alone, before anything is fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from evaluator.diagnosis.held_out import held_out_runs, runs_by_command
from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.interchange.commands import RunCommand

LONGEST_S = 10.0  # of a run that stays whole: one or two commands of a few seconds
PIECE_S, NEAR_S = 3.0, 1.0  # length of pieces, by how much it varies so that a piece begins with a command
# Commands and runs, at least so many, that a search sees, and that decide: a search over 24 commands takes minutes. Of
# a Husky eight commands do not establish that its drive mixes the sides, and 24 do.
SEARCHED, DECIDING = (12, 36), (24, 36)
NOT_NEEDED = "not needed: others decide, chosen for commands far apart, and as many others are held out"
HISTORY_S = 6.0  # of commands before a piece: motors that follow within seconds have forgotten what was before


def pieces_of(run: RunData, fewest: int) -> tuple[RunData, ...]:
    """The pieces of a run, named after it and the time at which they begin; the run itself if it is not long.

    fewest: frames of a piece in which the marks are seen; where there are fewer, there is no piece.
    """
    begin, end = float(run.time_s[0]), float(run.time_s[-1])
    if end - begin <= LONGEST_S:
        return (run,)
    changes = np.array([item.begin_s for item in run.run_command.command.stretches()])
    cuts = [begin]
    while end - cuts[-1] >= 2 * PIECE_S:
        aim = cuts[-1] + PIECE_S
        near = changes[np.abs(changes - aim) <= NEAR_S]
        cuts.append(float(near[np.argmin(np.abs(near - aim))]) if len(near) else aim)
    edges = np.searchsorted(run.time_s, [*cuts, np.inf])
    seen = np.flatnonzero(np.isfinite(run.marks_mm).all(axis=1))
    bounds = np.searchsorted(seen, edges)
    parts = [seen[low:high] for low, high in pairwise(bounds) if high - low >= fewest]
    return tuple(_piece(run, slice(int(part[0]), int(part[-1]) + 1)) for part in parts)


def searched_runs(data: Sequence[RunData]) -> tuple[int, ...]:
    """Numbers of the runs in which effects are looked for: some of those that decide."""
    return apart(data, *SEARCHED)


def deciding_runs(data: Sequence[RunData]) -> tuple[int, ...]:
    """Numbers of the runs that decide; all, where too few others would be held out."""
    found = apart(data, *DECIDING)
    return found if len(data) - len(found) >= len(held_out_runs(data)) else tuple(range(len(data)))


def needed_runs(data: Sequence[RunData]) -> tuple[int, ...]:
    """Numbers of the runs that decide, and of as many others, spread over the session, to be held out."""
    deciding = deciding_runs(data)
    others = np.setdiff1d(np.arange(len(data)), deciding)
    held = others[np.linspace(0, len(others) - 1, min(len(deciding), len(others))).astype(int)] if len(others) else []
    return tuple(sorted({*deciding, *map(int, held)}))


def apart(data: Sequence[RunData], fewest_commands: int, fewest_runs: int) -> tuple[int, ...]:
    """Numbers of all runs of at least so many commands, at least so many runs, of commands as far apart as can be.

    Each further command is that farthest from all before, from the fastest on; all runs where there are no more.
    Source: Kennard & Stone (1969), Technometrics 11, 137.
    """
    groups = list(runs_by_command(data).items())
    commands = np.array([command for command, _ in groups])
    nearest = np.full(len(groups), np.inf)
    at, chosen, taken = int(np.argmax(np.hypot(*commands.T))), list[int](), 0
    while True:
        chosen, taken = chosen + groups[at][1], taken + 1
        if len(chosen) >= min(fewest_runs, len(data)) and taken >= min(fewest_commands, len(groups)):
            return tuple(sorted(chosen))
        nearest = np.minimum(nearest, np.hypot(*(commands - commands[at]).T))
        at = int(np.argmax(nearest))


def _piece(run: RunData, frames: slice) -> RunData:
    time_s, whole = run.time_s[frames], run.run_command
    first, last = float(time_s[0]), float(time_s[-1])
    command = whole.command.within(first - HISTORY_S, last + HISTORY_S)
    told = RunCommand(command, starts_at_rest=whole.starts_at_rest and frames.start == 0, logged=True)
    left, right = told.main(first, last)
    return replace(
        run,
        id=f"{run.id}@{first:.1f}s",
        left_rpm=left,
        right_rpm=right,
        start_s=told.start_s if told.starts_at_rest and told.start_s is not None else first,
        stop_s=told.stop_s,
        time_s=time_s,
        marks_mm=run.marks_mm[frames],
        systematic={key: shift[frames] for key, shift in run.systematic.items()},
        log=told,
    )
