"""Marks tracked for another robot, or on another plane, have another distance than its file says: told at once."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest

from evaluator.workflow.runs.job import spacing_note
from evaluator.workflow.tracking import _distance_ratio
from simulator.mark_layout import Mark

LAYOUT = (
    Mark(name="green", x_mm=-1.0, y_mm=1.5),
    Mark(name="yellow", x_mm=2.0, y_mm=-2.5),
    Mark(name="red", x_mm=0, y_mm=9),
)


def tracked(times: float) -> pd.DataFrame:
    """Marks 5 mm apart, times a factor, of a robot that turns; one frame is lost, and one is wrong."""
    angle = np.linspace(0.0, 3.0, 9)
    half = 2.5 * times * np.column_stack([np.cos(angle), np.sin(angle)])
    half[2], half[5] = np.nan, 40.0
    return pd.DataFrame({f"{name}_{axis}_mm": 7 + sign * half[:, k] for name, sign in (("green", 1), ("yellow", -1))
                         for k, axis in enumerate("xy")})  # fmt: skip


@pytest.mark.parametrize("times", [0.5, 1.0, 1.25])
def test_the_distance_is_that_of_the_first_two_marks_over_that_of_the_file(times: float) -> None:
    assert _distance_ratio(tracked(times), LAYOUT) == pytest.approx(times)


def test_without_two_marks_on_the_plate_there_is_no_distance() -> None:
    assert math.isnan(_distance_ratio(tracked(1.0), LAYOUT[:1]))
    assert math.isnan(_distance_ratio(tracked(1.0), LAYOUT[1:]))
    assert math.isnan(_distance_ratio(tracked(1.0), (LAYOUT[0], LAYOUT[0])))


@pytest.mark.parametrize(
    ("ratio", "said"),
    [(1.029, None), (0.971, None), (math.nan, None), (1.25, "25 % farther apart"), (0.9, "10 % nearer")],
)
def test_a_distance_that_is_off_by_more_than_three_percent_is_told(ratio: float, said: str | None) -> None:
    notes = list(spacing_note(ratio))
    assert len(notes) == (said is not None)
    assert said is None or notes[0].startswith(f"the marks are {said} than robot.toml says: either")
