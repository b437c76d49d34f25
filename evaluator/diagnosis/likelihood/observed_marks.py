"""Observed marks from simulated poses, with the view of each robot and errors common to runs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from calibration.compilation import compiled
from evaluator.diagnosis.likelihood.known_to import SCALE, amount_of
from evaluator.diagnosis.likelihood.run_data import SHARED_UNIT, Floats, RunData
from simulator.effects.view import View


def marks_of_states(states: Floats, times_s: Floats, view: View, moved_mm: Sequence[float] = ()) -> Floats:
    """Marks (n, 4) of states (n, 6) at their times; moved_mm: how far either mark is off on the robot, x, y, x, y."""
    places = view.places_mm
    if moved_mm:
        x, y, other_x, other_y = moved_mm
        places = ((places[0][0] + x, places[0][1] + y), (places[1][0] + other_x, places[1][1] + other_y))
    marks = np.empty((len(states), 4))
    if view.is_plain:
        _plain_marks_into(states, view.scale, (*places[0], *places[1]), marks)
    else:
        x_mm, y_mm, heading = states[:, :3].T
        np.concatenate(replace(view, places_mm=places).marks(x_mm, y_mm, heading, times_s), axis=1, out=marks)
    return marks


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


class SharedErrors:
    """Errors of the measurement that a run shares with others, together what they do to its marks."""

    def __init__(self, run: RunData, known: Mapping[str, float]) -> None:
        """known: known_to.predicted_sigmas."""
        self._keys = tuple(run.systematic)
        self._shifts = np.array([run.systematic[key].ravel() / SHARED_UNIT for key in self._keys])
        self._known = known

    def of(self, nominal: Mapping[str, float]) -> tuple[float, Floats | None]:
        """Scale of the plate, and shifts (n, 4) of the marks, where there are any; nominal: of a Task.

        The scale is one of the marks as predicted. Those measured hold their noise: a scale of theirs explains it to
        the last frame against a scale of the prediction (plane-scale).
        """
        amounts = np.array([nominal.get(key, 0.0) for key in self._keys])
        shift = (amounts @ self._shifts).reshape(-1, 4) if amounts.any() else None
        return 1 + amount_of(nominal, SCALE, self._known), shift
