"""Batch integration: the kernel of single runs, batches and fits, parallel over runs."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
from numba import get_num_threads

from simulator.compilation import compiled
from simulator.integrator.run_kernel import DONE, integrate_run

TOLERANCE_MM = 1e-7  # local error of a step, as displacement; the global error of a 10 s run is about ten times that
SHARES_OF_A_THREAD = 8  # chunks of work per thread, because runs differ in length


def integrate_one(
    model: Any, knots: Any, state: Any, times: Any, out: Any, tolerance: float, most_steps: int
) -> tuple[int, int, float]:
    """Integrate one run; arguments and results as of run_kernel.integrate_run. NaN in out and state if it fails.

    It is a batch of one, as a kernel of its own would have to be compiled, too.
    """
    first, outcome = np.zeros(1, np.int64), np.empty((1, 3))
    # Copies are writable: kernels are compiled anew for arrays that are not.
    models, edges = np.array([model]), np.array([0, len(times)])
    task = (models, first, np.array(knots), np.array([0, len(knots)]), first, state[None], times, edges, out, tolerance)
    integrate_some(0, 1, task, most_steps, outcome)
    done, used, grown = outcome[0]
    return int(done), int(used), float(grown)


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
    most_steps: int,
) -> None:
    """Integrate runs: run k has models[model_of[k]], command command_of[k] and start states[k].

    Its times and outputs are rows edges[k]:edges[k + 1]. Runs that fail or need more than most_steps are NaN in out and
    states. Uses as many threads as numba may use (numba.set_num_threads); a parallel numba kernel would take three
    times as long to compile.
    """
    runs = len(states)
    task = (models, model_of, knots, knot_edges, command_of, states, times, edges, out, tolerance)
    outcome, threads = np.empty((runs, 3)), min(get_num_threads(), runs)
    if threads <= 1:
        integrate_some(0, runs, task, most_steps, outcome)
        return
    shares = np.linspace(0, runs, min(runs, SHARES_OF_A_THREAD * threads) + 1).astype(int).tolist()
    with ThreadPoolExecutor(threads) as pool:
        done = [pool.submit(integrate_some, begin, end, task, most_steps, outcome) for begin, end in pairwise(shares)]
        for share in done:
            share.result()


@compiled(nogil=True)
def integrate_some(begin: int, end: int, task: Any, most_steps: int, outcome: Any) -> None:
    """Integrate runs begin to end (excluded) of a task, the arguments of integrate_many.

    outcome (n, 3): receives what integrate_run returns for each run.
    """
    models, model_of, knots, knot_edges, command_of, states, times, edges, out, tolerance = task
    for run in range(begin, end):
        command = command_of[run]
        own = out[edges[run] : edges[run + 1]]
        done, used, grown = integrate_run(
            models[model_of[run]],
            knots[knot_edges[command] : knot_edges[command + 1]],
            states[run],
            times[edges[run] : edges[run + 1]],
            own,
            tolerance,
            most_steps,
        )
        outcome[run, 0], outcome[run, 1], outcome[run, 2] = done, used, grown
        if done != DONE:
            own[:] = np.nan
            states[run] = np.nan
