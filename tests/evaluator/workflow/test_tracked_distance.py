"""Marks tracked for another robot, or on another plane, have another distance than its file says: told at once."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from evaluator.marks import columns_of, write_marks
from evaluator.robot_geometry import read_geometry
from evaluator.workflow.runs.job import spacing_note
from evaluator.workflow.tracking import _distance_ratio
from evaluator.workflow.turning_tables import Request, measure_table
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


@pytest.mark.parametrize(("times", "doubted"), [(1.0, False), (1.19, True), (1.5, False)])
def test_turning_of_a_table_tells_another_distance_than_the_robots_after_its_summary(
    tmp_path: Path, times: float, doubted: bool
) -> None:
    """A distance that is off by half is the summary itself: a wrong scale."""
    angle, half = 0.02 * np.arange(120), 1.83 * times
    out, along = np.column_stack([np.cos(angle), np.sin(angle)]), np.column_stack([-np.sin(angle), np.cos(angle)])
    places = np.hstack([(7.0 - half) * out - 1.55 * along, (7.0 + half) * out - 1.55 * along])
    noise = np.random.default_rng(1).normal(0, 0.003, places.shape)
    table = pd.DataFrame(places + noise, columns=columns_of(["green", "yellow"])).assign(time_s=np.arange(120) / 60)
    write_marks(table, tmp_path / "marks.csv")
    lines = measure_table(tmp_path / "marks.csv", Request(robot=read_geometry(Path("barrel")))).lines
    assert any(line.startswith("the marks are 19 % farther apart") for line in lines[1:2]) is doubted
    assert any("the marks are" in line for line in lines) is (times > 1)
