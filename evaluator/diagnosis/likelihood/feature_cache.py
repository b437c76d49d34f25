"""Cache of simulated features and motions, because a search returns to the same points.

A fit ends with a linear view of where it is, a screening begins with that view and adds candidates, the next fit begins
there. One simulation in five was made before. And a robot drives alike everywhere on even ground: where nothing depends
on the place, or on place and direction, runs that differ only in their start pose have one motion. A fit asks for such
runs most of all: slopes by the start pose, and start poses fitted anew at each step.
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

# Of one run: the last ten linear views with all candidates, some 2 MB.
MOST_OF_A_RUN = 1000
MOST_PATHS = 8  # motions of one run: the latest points of a fit, at which only start poses change, are asked for again
MOST_POINTS = 5000  # common parameters that are told apart at a time, 2 kB each: far more than those views have

Parameters = tuple[tuple[str, Any], ...]


class FeatureCache:
    """Features (k,) of the latest simulations of every run. Threads may share it as long as they do not share a run."""

    def __init__(self) -> None:
        """Nothing has been simulated yet."""
        self._of_run: dict[int, dict[Hashable, Floats]] = defaultdict(dict)
        self._points: dict[tuple[Parameters, Parameters], int] = {}
        self._number = count()

    def of(self, tasks: Sequence[Task], simulated: Callable[[Sequence[Task]], Sequence[Floats]]) -> list[Floats]:
        """Features of every task; simulated: gives those of tasks that are not known, each asked for once."""
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
        """What tells tasks of a run apart: a number for common parameters, which many tasks share, and their own."""
        if len(self._points) > MOST_POINTS:
            self._points.clear()  # numbers are not given twice
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
    """The latest motions of every run that do not depend on where it starts; threads that share it share no run."""

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
        """States (n, 6) of every item; simulated: gives those of items, by number, that are not known.

        runs, keys: what an item is of; equal ones are simulated once. lasting: kept as long as their states, so that
        keys may hold their identity.
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
