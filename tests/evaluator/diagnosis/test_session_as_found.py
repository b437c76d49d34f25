"""What is found of a whole session does to a prediction from the start pose what it does in the fit."""

from __future__ import annotations

import numpy as np
import pytest

from evaluator.diagnosis.assessment.session_as_found import later_started, with_session
from evaluator.diagnosis.likelihood.known_to import quantities, simulated_sigmas, with_shifts
from evaluator.diagnosis.likelihood.problem import Point
from evaluator.diagnosis.likelihood.run_data import OWN_NUMBERS, RunData, Task
from evaluator.diagnosis.likelihood.simulation import Simulated
from evaluator.settings import KnownTo
from simulator.robot import load_robot

ROBOT = load_robot("barrel")
TIME = np.arange(240) / 60
START = (3.0, -2.0, 0.7, 0.0, 0.0, 0.0, 0.0)


def turn() -> RunData:
    """Four seconds of a turn as the robot file says, without noise."""
    blank = RunData("r0", 33.3, 14.4, 0.5, None, TIME, np.zeros((len(TIME), 4)), 0)
    (marks,) = Simulated([ROBOT], [blank], {}).marks([Task(0, START)])
    return RunData("r0", 33.3, 14.4, 0.5, None, TIME, marks, 0)


RUN = turn()
KNOWN = quantities(KnownTo(), ROBOT, [RUN])
SHARED = [item.key for item in KNOWN if "." not in item.key]


@pytest.mark.parametrize("key", SHARED)
def test_a_quantity_of_the_session_moves_predicted_marks_as_in_the_fit(key: str) -> None:
    item = next(item for item in KNOWN if item.key == key)
    nominal = {key: 2 * item.tolerance}
    (shifted,) = with_shifts([RUN], [ROBOT], KNOWN)
    fitted = Simulated([ROBOT], [shifted], {}, simulated_sigmas(KNOWN)).marks([Task(0, START, nominal)])[0]
    point = Point(np.zeros((1, OWN_NUMBERS)), nominal)
    robot = with_session(ROBOT, KNOWN, point)
    predicted = Simulated([robot], later_started([RUN], KNOWN, point), {}).marks([Task(0, START)])[0]
    moved = float(np.abs(fitted - RUN.marks_mm).max())
    assert moved > 1e-4
    if key.startswith(("green", "yellow")):  # as one rigid shift: the distance of the marks stays
        fitted, predicted = (np.column_stack([m[:, :2] + m[:, 2:], _line(m)]) for m in (fitted, predicted))
    assert np.abs(predicted - fitted).max() < max(0.02 * moved, 2e-5)


def _line(marks: np.ndarray) -> np.ndarray:
    """Direction of the line through the marks, rad."""
    return np.unwrap(np.arctan2(marks[:, 1] - marks[:, 3], marks[:, 0] - marks[:, 2]))


def test_a_session_as_its_files_say_changes_nothing() -> None:
    point = Point(np.zeros((1, OWN_NUMBERS)))
    assert with_session(ROBOT, KNOWN, point) == ROBOT
    assert later_started([RUN], KNOWN, point) == (RUN,)
