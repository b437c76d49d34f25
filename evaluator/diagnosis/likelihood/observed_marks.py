"""Marks as a camera would observe them, from simulated poses: the view of each robot, and errors that runs share."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from calibration.compilation import compiled
from evaluator.diagnosis.likelihood.known_to import SeenMarks, seen_shift
from evaluator.diagnosis.likelihood.run_data import SHARED_UNIT, Floats, RunData, Task
from simulator.effects.view import View


def marks_of_states(states: Floats, times_s: Floats, views: Sequence[View], edges: NDArray[np.int64]) -> list[Floats]:
    """Marks (n, 4) of every task from stacked states (edges[-1], 6), the first of each, its start, left out."""
    marks = np.empty((len(states), 4))
    parts = [slice(begin + 1, end) for begin, end in pairwise(edges.tolist())]
    for view, part in zip(views, parts, strict=True):
        if view.is_plain:
            (ahead, left), (other_ahead, other_left) = view.places_mm
            _plain_marks_into(states[part], view.scale, (ahead, left, other_ahead, other_left), marks[part])
        else:
            x, y, heading = states[part, :3].T
            marks[part] = np.concatenate(view.marks(x, y, heading, times_s[part]), axis=1)
    return [marks[part] for part in parts]


@compiled(nogil=True)
def _plain_marks_into(
    states: Floats, scale: float, places_mm: tuple[float, float, float, float], marks: Floats
) -> None:
    """Marks (n, 4) of states (n, 6) as View.marks has them where only a scale acts on what is seen."""
    ahead, left, other_ahead, other_left = places_mm
    for row in range(len(states)):
        x, y, cos, sin = states[row, 0], states[row, 1], math.cos(states[row, 2]), math.sin(states[row, 2])
        marks[row, 0] = scale * (x + ahead * cos - left * sin)
        marks[row, 1] = scale * (y + ahead * sin + left * cos)
        marks[row, 2] = scale * (x + other_ahead * cos - other_left * sin)
        marks[row, 3] = scale * (y + other_ahead * sin + other_left * cos)


def with_shared_errors(marks: Floats, task: Task, run: RunData, robot: SeenMarks, known: Mapping[str, float]) -> Floats:
    """Marks (n, 4) as seen with the errors that runs share; known: known_to.predicted_sigmas."""
    amounts = {key: amount for key, amount in task.nominal.items() if amount}
    seen = {key: amounts[key] * known[key] for key in robot.keys if key in amounts and key in known}
    shared = [amount / SHARED_UNIT * run.systematic[key] for key, amount in amounts.items() if key in run.systematic]
    if seen:
        shared.append(seen_shift(seen, marks, robot))
    return marks + sum(shared) if shared else marks
