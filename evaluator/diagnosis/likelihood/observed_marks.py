"""Observed marks from simulated poses, with the view of each robot and errors common to runs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from calibration.compilation import compiled
from evaluator.diagnosis.likelihood.known_to import SCALE, amount_of
from evaluator.diagnosis.likelihood.run_data import SHARED_UNIT, Floats, RunData
from simulator.effects.view import View

Pose = tuple[float, float, float]  # x, y, mm; heading


@dataclass(frozen=True)
class Sight:
    """Observation of a run: scale of the plate, shifts (n, 4) of its marks or none (0, 4), deviations on the robot.

    moved_mm: deviation of each mark from its stated position on the robot, x, y, x, y.
    """

    scale: float
    shift_mm: Floats
    moved_mm: tuple[float, ...]

    def marks(self, path: Floats, times_s: Floats, begin: Pose, start: Pose, view: View) -> Floats:
        """Marks (n, 4) at times of a path (n, 6) that was simulated from begin, transformed to another start."""
        (x, y), (other_x, other_y) = view.places_mm
        right, up, other_right, other_up = self.moved_mm or (0.0, 0.0, 0.0, 0.0)
        places = x + right, y + up, other_x + other_right, other_y + other_up
        marks = np.empty((len(path), 4))
        if view.is_plain:
            _plain_marks_into(path, begin, start, self.scale * view.scale, self.shift_mm, places, marks)
            return marks
        states = laid(path, begin, start)
        seen = replace(view, places_mm=(places[:2], places[2:]))
        np.concatenate(seen.marks_of_path(states, times_s), axis=1, out=marks)
        marks *= self.scale
        return marks + self.shift_mm if len(self.shift_mm) else marks


def laid(path: Floats, begin: Pose, start: Pose) -> Floats:
    """States (n, 6) of a run that was simulated from the pose begin, transformed to another start."""
    turn = start[2] - begin[2]
    turned = np.exp(1j * turn) * (path[:, 0] - begin[0] + 1j * (path[:, 1] - begin[1]))
    return np.column_stack([start[0] + turned.real, start[1] + turned.imag, path[:, 2] + turn, path[:, 3:]])


@compiled(nogil=True)
def _plain_marks_into(
    path: Floats,
    begin: Pose,
    start: Pose,
    scale: float,
    shift_mm: Floats,
    places_mm: tuple[float, float, float, float],
    marks: Floats,
) -> None:
    """Sight.marks in one pass, if the view has only a scale."""
    ahead, left, other_ahead, other_left = places_mm
    turn = start[2] - begin[2]
    turn_cos, turn_sin = math.cos(turn), math.sin(turn)
    for row in range(len(path)):
        way_x, way_y, angle = path[row, 0] - begin[0], path[row, 1] - begin[1], path[row, 2] + turn
        here_x = start[0] + turn_cos * way_x - turn_sin * way_y
        here_y = start[1] + turn_sin * way_x + turn_cos * way_y
        cos, sin = math.cos(angle), math.sin(angle)
        marks[row, 0] = scale * (here_x + ahead * cos - left * sin)
        marks[row, 1] = scale * (here_y + ahead * sin + left * cos)
        marks[row, 2] = scale * (here_x + other_ahead * cos - other_left * sin)
        marks[row, 3] = scale * (here_y + other_ahead * sin + other_left * cos)
    for row in range(len(shift_mm)):
        for k in range(4):
            marks[row, k] += shift_mm[row, k]


class SharedErrors:
    """Combined effect on the marks of a run of measurement errors that it shares with others."""

    def __init__(self, run: RunData, known: Mapping[str, float]) -> None:
        """known: known_to.predicted_sigmas."""
        self._keys = tuple(run.systematic)
        self._shifts = np.array([run.systematic[key].ravel() / SHARED_UNIT for key in self._keys])
        self._known = known

    def of(self, nominal: Mapping[str, float]) -> tuple[float, Floats]:
        """Scale of the plate, and shifts (n, 4) of the marks, (0, 4) if there are none; nominal: of a Task.

        The scale applies to the predicted marks. A scale of the measured marks would also scale their noise, and would
        thereby be distinguishable from a scale of the prediction (plane-scale).
        """
        amounts = [nominal.get(key, 0.0) for key in self._keys]
        shift = (np.array(amounts) @ self._shifts).reshape(-1, 4) if any(amounts) else np.zeros((0, 4))
        return 1 + amount_of(nominal, SCALE, self._known), shift
