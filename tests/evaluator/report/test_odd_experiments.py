"""Experiments that went wrong in every way still give a report, without a warning and without "nan"."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from evaluator.report.build import report_html
from evaluator.workflow import analyze
from simulator import Command, load_robot, marks_of_run, simulate
from tests.evaluator.synthetic import circling_marks, write_experiment

TURN = circling_marks(6.0)


def resting() -> pd.DataFrame:
    noise = np.random.default_rng(1)
    marks = TURN.copy()
    marks.iloc[:, 1:] = marks.iloc[0, 1:].to_numpy() + noise.normal(0, 0.002, (len(marks), 4))
    return marks


def seen_in(share: float) -> pd.DataFrame:
    marks = TURN.copy()
    marks.loc[np.random.default_rng(1).random(len(marks)) > share, marks.columns[1:]] = np.nan
    return marks


EXPERIMENTS = {
    "one turn": [("a", 14.4, 33.3, TURN)],
    "turns commanded straight": [("a", 33.3, 33.3, TURN), ("b", -20.0, -20.0, TURN)],
    "no motion": [("a", 14.4, 33.3, resting())],
    "no command": [("a", 0.0, 0.0, resting())],
    "one wheel": [("a", 0.0, 33.3, TURN)],
    "wheels opposed": [("a", -30.0, 30.0, TURN)],
    "marks mostly missing": [("a", 14.4, 33.3, seen_in(0.05)), ("b", 14.4, 33.3, TURN)],
    "four frames": [("a", 14.4, 33.3, TURN.iloc[:4])],
    "two frames": [("a", 14.4, 33.3, TURN.iloc[:2])],
    "nearly straight": [("a", 33.0, 33.3, circling_marks(5000.0))],
}


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_odd_experiments_have_a_report(name: str, tmp_path: Path) -> None:
    found = analyze(write_experiment(tmp_path, EXPERIMENTS[name]), tmp_path / "out", simulate=True, workers=1)
    page = report_html(found)
    assert found.faults == {}
    assert not re.search(r">[^<]*\bnan\b[^<]*<", page)


def test_a_run_whose_marks_are_never_seen_together_has_its_reason(tmp_path: Path) -> None:
    runs = [("a", 14.4, 33.3, TURN.assign(green_x_mm=np.nan)), ("b", 14.4, 33.3, TURN)]
    found = analyze(write_experiment(tmp_path, runs), tmp_path / "out", simulate=True, workers=1)
    assert found.faults["a"].endswith("a.csv: no frame has a pose (green: absent); does it show both marks?")


def test_a_run_that_is_not_what_the_file_says_is_named_first_and_in_no_comparison(tmp_path: Path) -> None:
    robot = load_robot("barrel")
    commands = [(33.3, 14.4), (14.4, 33.3), (33.0, 22.0), (30.0, 30.0)]
    times = [frame / 60 for frame in range(240)]
    runs = [
        (f"r{number}", left, right, marks_of_run(robot, simulate(robot, Command.constant(left, right), times)))
        for number, (left, right) in enumerate(commands)
    ]
    identifier, left, right, marks = runs[2]
    runs[2] = (identifier, right, left, marks)  # whoever wrote the file exchanged the sides of one run
    noise = np.random.default_rng(3)
    for *_, table in runs:
        table.iloc[:, 1:5] += noise.normal(0, 0.002, (len(table), 4))
    found = analyze(write_experiment(tmp_path, runs), tmp_path / "out", simulate=True, workers=1)
    assert [(item.runs, item.kind) for item in found.mistakes] == [(("r2",), "sides-swapped")]
    assert found.excluded_runs == {"r2"}
    assert set(found.turning["run"]) == {"r0", "r1", "r2", "r3"}
    assert not (found.pooled[["left_rpm", "right_rpm"]] == [22.0, 33.0]).all(axis=1).any()
    summary = re.search(r'<ul class="summary"><li>(.*?)</li><li>(.*?)</li>', report_html(found), re.DOTALL)
    assert summary is not None
    assert summary[1].startswith("r2: turns as if left and right were exchanged")
    assert summary[2].endswith("Left out of all results below until this is corrected: r2.")


def test_phases_of_a_run_that_is_set_aside_are_in_no_result_and_count_as_one_run(tmp_path: Path) -> None:
    robot, times = load_robot("barrel"), [frame / 60 for frame in range(300)]
    noise = np.random.default_rng(3)

    def marks(command: Command) -> pd.DataFrame:
        table = marks_of_run(robot, simulate(robot, command, times))
        table.iloc[:, 1:5] += noise.normal(0, 0.002, (len(table), 4))
        return table

    commands = [(33.3, 14.4), (14.4, 33.3), (33.0, 22.0), (30.0, 30.0)]
    runs = [(f"r{k}", left, right, marks(Command.constant(left, right))) for k, (left, right) in enumerate(commands)]
    runs[2] = ("r2", 33.0, 5.0, marks(Command.steps([(0.0, 33.0, 5.0), (2.5, 33.0, 8.0)])))
    path = write_experiment(tmp_path, runs)
    swapped = "time_s,left_rpm,right_rpm\n0.0,5.0,33.0\n2.5,8.0,33.0\n"  # whoever wrote the log exchanged its sides
    (tmp_path / "r2_commands.csv").write_text(swapped, encoding="utf-8")
    text = path.read_text(encoding="utf-8").replace("left_rpm = 33.0\nright_rpm = 5.0", 'commands = "r2_commands.csv"')
    path.write_text(text, encoding="utf-8")
    found = analyze(path, tmp_path / "out", simulate=True, workers=1)
    assert (found.excluded_runs, len(found.turning)) == ({"r2"}, 5)
    page = report_html(found)
    summary = re.search(r'<ul class="summary">(.*?)</ul>', page, re.DOTALL)
    assert summary is not None
    assert "r2 (" not in summary[1]  # though it turns tightest by far
    assert "r2 (1) (left out)" in page
    assert re.search(r"\b4 runs, from marks", page)
