"""Cache of simulated features and motions, because a search returns to the same points.

A fit ends with a linearization, a screening at the same point adds candidates, and the next fit begins there; one of
five simulations was made before. If no term depends on position, or on position and direction, runs that differ only in
their start pose have the same motion. A fit needs many of these, for derivatives by the start pose and for new start
poses at each step.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Hashable, Sequence
from itertools import count, islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.run_data import Task

Floats = NDArray[np.float64]

# Features per run: the last ten linearizations with all candidates, some 2 MB.
MOST_OF_A_RUN = 1000
MOST_PATHS = 8  # motions per run: those of the latest points of a fit, at which only start poses change
MOST_POINTS = 5000  # sets of common parameters, 2 kB each: far more than the points of these linearizations

Parameters = tuple[tuple[str, Any], ...]


class FeatureCache:
    """Features (k,) of the latest simulations of every run. Threads may share it as long as they do not share a run."""

    def __init__(self) -> None:
        """Nothing has been simulated yet."""
        self._of_run: dict[int, dict[Hashable, Floats]] = defaultdict(dict)
        self._points: dict[tuple[Parameters, Parameters], int] = {}
        self._number = count()

    def of(self, tasks: Sequence[Task], simulated: Callable[[Sequence[Task]], Sequence[Floats]]) -> list[Floats]:
        """Features (k,) of every task; simulated: computes those of unknown tasks, each once."""
        keys = self._keys(tasks)
        found = [self._of_run[task.run].get(key) for task, key in zip(tasks, keys, strict=True)]
        missing: dict[tuple[int, Hashable], list[int]] = {}
        for number, known in enumerate(found):
            if known is None:
                missing.setdefault((tasks[number].run, keys[number]), []).append(number)
        made = simulated([tasks[numbers[0]] for numbers in missing.values()]) if missing else ()
        for ((run, key), numbers), features in zip(missing.items(), made, strict=True):
            self._of_run[run][key] = features
            for number in numbers:
                found[number] = features
        for run in {run for run, _ in missing}:
            known_of_run = self._of_run[run]
            for key in list(islice(known_of_run, max(len(known_of_run) - MOST_OF_A_RUN, 0))):
                del known_of_run[key]
        return [item for item in found if item is not None]

    def _keys(self, tasks: Sequence[Task]) -> list[Hashable]:
        """Keys of tasks: a number for the common parameters, which many tasks share, and the parameters of the run."""
        if len(self._points) > MOST_POINTS:
            self._points.clear()  # numbers are not reused
        met: dict[tuple[int, int], int] = {}
        keys: list[Hashable] = []
        for task in tasks:
            shared = id(task.nominal), id(task.terms)  # mappings live as long as their tasks
            if shared not in met:
                point = tuple(task.nominal.items()), tuple(task.terms.items())
                met[shared] = self._points.setdefault(point, next(self._number))
            keys.append((met[shared], task.per_run))
        return keys


class Paths:
    """The latest motions of every run, independent of its start pose; threads may share it if they share no run."""

    def __init__(self) -> None:
        """Nothing has been simulated yet."""
        self._of_run: dict[int, dict[Hashable, tuple[Floats, Any]]] = defaultdict(dict)

    def of(
        self,
        runs: Sequence[int],
        keys: Sequence[Hashable],
        lasting: Sequence[Any],
        simulated: Callable[[Sequence[int]], Sequence[Floats]],
    ) -> list[Floats]:
        """States (n, 6) of every item; simulated: computes those of unknown items, given their indices.

        runs, keys: run and key of each item; equal ones are simulated once. lasting: objects that are kept as long as
        the states, so that keys may contain their identities.
        """
        missing: dict[tuple[int, Hashable], int] = {}
        for number, (run, key) in enumerate(zip(runs, keys, strict=True)):
            if key not in self._of_run[run]:
                missing.setdefault((run, key), number)
        made = simulated(list(missing.values())) if missing else ()
        for ((run, key), number), states in zip(missing.items(), made, strict=True):
            self._of_run[run][key] = states, lasting[number]
        found = [self._of_run[run][key][0] for run, key in zip(runs, keys, strict=True)]
        for run in {run for run, _ in missing}:
            known = self._of_run[run]
            for key in list(islice(known, max(len(known) - MOST_PATHS, 0))):
                del known[key]
        return found
