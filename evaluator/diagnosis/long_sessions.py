"""Long sessions of full-size robots: division of recordings into pieces, and selection of sufficient runs.

Deviations by the ground accumulate, so that after a minute no model is near the path. A recording of twenty minutes is
a single run. It is divided at changes of command, or after some seconds if there are none; each piece includes the
commands before it.

The duration of a diagnosis is proportional to the number of runs, and more than some dozens of commands hardly change
its result. Deciding runs are selected by their commands alone, before any fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from evaluator.diagnosis.held_out import held_out_runs, runs_by_command
from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.motion import midpoint_and_heading
from evaluator.interchange.commands import RunCommand
from evaluator.turning.motion.velocity import velocity_at
from simulator.simulation import RUN_IN_S

LONGEST_S = 10.0  # of a run that is not divided: one or two commands of a few seconds
PIECE_S, NEAR_S = 3.0, 1.0  # length of pieces, and its variation so that a piece begins with a command
# Least number of commands and of runs in a search, and among deciding runs: a search over 24 commands takes minutes.
# Eight commands of a Husky are not sufficient to show that its drive mixes the sides, 24 are.
SEARCHED, DECIDING = (12, 36), (24, 36)
NOT_NEEDED = "not needed: other runs, chosen for commands far apart, decide, and as many more are held out"
HISTORY_S = 6.0  # of commands before a piece: several time constants of motors that lag by seconds


def pieces_of(run: RunData, fewest: int) -> tuple[RunData, ...]:
    """The pieces of a run, named after it and the time at which they begin; the run itself if it is not long.

    fewest: least number of frames of a piece with all marks; pieces with fewer are omitted.
    """
    begin, end = float(run.time_s[0]), float(run.time_s[-1])
    if end - begin <= LONGEST_S:
        return (run if run.run_command.starts_at_rest else replace(run, run_in=_moving(run, begin)),)
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
    """Indices of the runs of a search for effects: some of the deciding ones."""
    return apart(data, *SEARCHED)


def deciding_runs(data: Sequence[RunData]) -> tuple[int, ...]:
    """Indices of the deciding runs; all, if too few others would be held out."""
    found = apart(data, *DECIDING)
    return found if len(data) - len(found) >= len(held_out_runs(data)) else tuple(range(len(data)))


def needed_runs(data: Sequence[RunData]) -> tuple[int, ...]:
    """Indices of the deciding runs, and of as many others, spread over the session, to be held out."""
    deciding = deciding_runs(data)
    others = np.setdiff1d(np.arange(len(data)), deciding)
    held = others[np.linspace(0, len(others) - 1, min(len(deciding), len(others))).astype(int)] if len(others) else []
    return tuple(sorted({*deciding, *map(int, held)}))


def apart(data: Sequence[RunData], fewest_commands: int, fewest_runs: int) -> tuple[int, ...]:
    """Indices of all runs of at least these numbers of commands and runs, with commands as far apart as possible.

    The first command is the fastest; each further one is the farthest from all before. All runs if there are fewer.
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
    at_rest = whole.starts_at_rest and frames.start == 0
    run_command = RunCommand(command, starts_at_rest=at_rest, logged=True, zero_s=whole.zero_s)
    left, right = run_command.main(first, last)
    return replace(
        run,
        id=f"{run.id}@{first:.1f}s",
        left_rpm=left,
        right_rpm=right,
        start_s=run_command.start_s if run_command.starts_at_rest and run_command.start_s is not None else first,
        stop_s=run_command.stop_s,
        time_s=time_s,
        marks_mm=run.marks_mm[frames],
        systematic={key: shift[frames] for key, shift in run.systematic.items()},
        log=run_command,
        run_in=None if at_rest else _moving(run, max(first - RUN_IN_S, float(run.time_s[0]))),
    )


def _moving(run: RunData, at_s: float) -> tuple[float, float, float] | None:
    """The velocity of a run near a time, as in RunData.run_in."""
    time_s, middle, heading = midpoint_and_heading(run)
    return velocity_at(time_s, np.column_stack([middle, heading]), at_s)
