"""Batch integration: the kernel of single runs, batches and fits, parallel over runs."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numba import get_num_threads
from numpy.typing import NDArray

from simulator.command import Command
from simulator.compilation import compiled
from simulator.errors import SimulationError
from simulator.integrator.run_kernel import DONE, MOST_STEPS, integrate_run

Array = NDArray[np.float64]
Index = NDArray[np.int64]
TOLERANCE_MM = 1e-7  # local error of a step, as displacement; the global error of a 10 s run is about ten times that
MOST_PLANNED = 1000
SHARES_OF_A_THREAD = 8  # chunks of work per thread, because runs differ in length


@dataclass(frozen=True)
class Plan:
    """Steps that a set of runs took; with these steps, results are smooth functions of models and starts.

    steps: (n, m, 3) segment, length and method of each step; count: (n,) number of steps of each run; tolerance_mm: the
    local error that they were chosen for.
    """

    steps: Array
    count: Index
    tolerance_mm: float


class Trials:
    """Runs to be simulated repeatedly with changing models and starts, as in a fit.

    commands: one per run; times_s: one increasing array per run, whose first time is that of the start. Results are
    stacked over runs: rows edges[k]:edges[k + 1] belong to run k.
    """

    def __init__(self, commands: Sequence[Command], times_s: Sequence[Array]) -> None:
        """Pack commands and times for the kernel. Raises SimulationError where they differ in number."""
        if len(commands) != len(times_s) or not commands:
            raise SimulationError(f"{len(commands)} commands for {len(times_s)} runs")
        self.edges: Index = np.cumsum([0, *(len(times) for times in times_s)])
        self._times = np.concatenate([np.asarray(times, dtype=float) for times in times_s])
        self._knots = np.concatenate([command.knots for command in commands])
        self._knot_edges: Index = np.cumsum([0, *(len(command.time_s) for command in commands)])

    def __len__(self) -> int:
        """Number of runs."""
        return len(self.edges) - 1

    def plan(self, models: NDArray[np.void], starts: Array, tolerance_mm: float = TOLERANCE_MM) -> Plan:
        """Plan the steps of runs from starts (n, 6); models: (n,), or (1,) for all runs."""
        steps = np.zeros((len(self), MOST_PLANNED, 3))
        _, count = self._run(models, starts, tolerance_mm, steps, np.zeros(len(self), dtype=np.int64), replay=False)
        return Plan(steps, np.minimum(count, MOST_PLANNED), tolerance_mm)

    def states(
        self, models: NDArray[np.void], starts: Array, plan: Plan | None = None, tolerance_mm: float = TOLERANCE_MM
    ) -> Array:
        """States (edges[-1], 6) of all runs: x, y, heading in the plate frame, u, v, yaw rate; mm, rad, s.

        starts: (n, 6) or (6,). With a plan, its steps are taken and results vary smoothly. A run that fails is NaN.
        """
        if plan is None:
            steps, count = np.zeros((len(self), 0, 3)), np.zeros(len(self), dtype=np.int64)
            return self._run(models, starts, tolerance_mm, steps, count, replay=False)[0]
        return self._run(models, starts, plan.tolerance_mm, plan.steps, plan.count, replay=True)[0]

    def _run(
        self, models: NDArray[np.void], starts: Array, tolerance: float, steps: Array, count: Index, *, replay: bool
    ) -> tuple[Array, Index]:
        runs = len(self)
        out = np.empty((len(self._times), 6))
        state = np.array(np.broadcast_to(starts, (runs, 6)), dtype=float, order="C")
        model_of = np.arange(runs) if len(models) == runs else np.zeros(runs, dtype=np.int64)
        used = integrate_many(
            models,
            model_of,
            self._knots,
            self._knot_edges,
            np.arange(runs),
            state,
            self._times,
            self.edges,
            out,
            tolerance,
            steps,
            count,
            replay,
            MOST_STEPS,
        )
        return out, used


def integrate_many(
    models: Any,
    model_of: Any,
    knots: Any,
    knot_edges: Any,
    command_of: Any,
    states: Any,
    times: Any,
    edges: Any,
    out: Any,
    tolerance: float,
    steps: Any,
    count: Any,
    replay: bool,
    most_steps: int,
) -> Index:
    """Integrate runs: run k has models[model_of[k]], command command_of[k] and start states[k].

    Its times and outputs are rows edges[k]:edges[k + 1]. steps, count: the plan to replay or to fill; steps (n, 0, 3)
    for none. Returns the number of steps taken. Runs that fail or need more than most_steps are NaN in out and states.
    Uses as many threads as numba may use (numba.set_num_threads); a parallel numba kernel would take three times as
    long to compile.
    """
    runs = len(states)
    used: Index = np.zeros(runs, dtype=np.int64)
    task = (models, model_of, knots, knot_edges, command_of, states, times, edges, out, tolerance, steps, count)
    threads = min(get_num_threads(), runs)
    if threads <= 1:
        integrate_some(0, runs, task, replay, most_steps, used)
        return used
    shares = np.linspace(0, runs, min(runs, SHARES_OF_A_THREAD * threads) + 1).astype(int).tolist()
    with ThreadPoolExecutor(threads) as pool:
        done = [
            pool.submit(integrate_some, begin, end, task, replay, most_steps, used) for begin, end in pairwise(shares)
        ]
        for share in done:
            share.result()
    return used


@compiled(nogil=True)
def integrate_some(begin: int, end: int, task: Any, replay: bool, most_steps: int, used: Any) -> None:
    """Integrate runs begin to end (excluded); task: arguments of integrate_many; used (n,) receives the step counts."""
    models, model_of, knots, knot_edges, command_of, states, times, edges, out, tolerance, steps, count = task
    for run in range(begin, end):
        command = command_of[run]
        own = out[edges[run] : edges[run + 1]]
        plan = steps[run, : count[run]] if replay else steps[run]
        done, taken, _ = integrate_run(
            models[model_of[run]],
            knots[knot_edges[command] : knot_edges[command + 1]],
            states[run],
            times[edges[run] : edges[run + 1]],
            own,
            tolerance,
            plan,
            replay,
            most_steps,
        )
        used[run] = taken
        if done != DONE:
            own[:] = np.nan
            states[run] = np.nan
