"""Experiments that went wrong in every way still give a report, without a warning and without "nan"."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from evaluator.report.build import report_html
from evaluator.workflow import Analysis, analyze
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
    "turns commanded straight, by one wheel, by wheels opposed, mostly without marks": [
        *(("a", 33.3, 33.3, TURN), ("b", -20.0, -20.0, TURN), ("c", 0.0, 33.3, TURN), ("d", -30.0, 30.0, TURN)),
        ("e", 14.4, 33.3, seen_in(0.05)),
    ],
    "no motion": [("a", 14.4, 33.3, resting())],
    "no command": [("a", 0.0, 0.0, resting())],
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


@pytest.fixture(scope="module")
def with_excluded_run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Analysis, str]:
    """Of five runs, whoever wrote the files exchanged the sides of r2 and of the log of r4, and its page."""
    robot, times = load_robot("barrel"), [frame / 60 for frame in range(300)]
    noise = np.random.default_rng(3)

    def marks(command: Command) -> pd.DataFrame:
        table = marks_of_run(robot, simulate(robot, command, times))
        table.iloc[:, 1:5] += noise.normal(0, 0.002, (len(table), 4))
        return table

    commands = [(33.3, 14.4), (14.4, 33.3), (33.0, 22.0), (30.0, 30.0)]
    runs = [(f"r{k}", left, right, marks(Command.constant(left, right))) for k, (left, right) in enumerate(commands)]
    runs[2] = ("r2", 22.0, 33.0, runs[2][3])
    runs.append(("r4", 33.0, 5.0, marks(Command.steps([(0.0, 33.0, 5.0), (2.5, 33.0, 8.0)]))))
    folder = tmp_path_factory.mktemp("excluded")
    path = write_experiment(folder, runs)
    swapped = "time_s,left_rpm,right_rpm\n0.0,5.0,33.0\n2.5,8.0,33.0\n"
    (folder / "r4_commands.csv").write_text(swapped, encoding="utf-8")
    text = path.read_text(encoding="utf-8").replace("left_rpm = 33.0\nright_rpm = 5.0", 'commands = "r4_commands.csv"')
    path.write_text(text, encoding="utf-8")
    found = analyze(path, folder / "out", simulate=True, workers=1)
    return found, report_html(found)


def test_runs_that_are_not_what_the_file_says_are_named_first_and_in_no_comparison(
    with_excluded_run: tuple[Analysis, str],
) -> None:
    found, page = with_excluded_run
    assert [(item.runs, item.kind) for item in found.mistakes] == [((run,), "sides-swapped") for run in ("r2", "r4")]
    assert found.excluded_runs == {"r2", "r4"}
    assert set(found.turning["run"]) == {"r0", "r1", "r2", "r3", "r4"}
    assert not (found.pooled[["left_rpm", "right_rpm"]] == [22.0, 33.0]).all(axis=1).any()
    summary = re.search(r'<ul class="summary"><li>(.*?)</li><li>(.*?)</li><li>(.*?)</li>', page, re.DOTALL)
    assert summary is not None
    for number, run in ((1, "r2"), (2, "r4")):
        assert summary[number].startswith(f"{run}: turns as if left and right were exchanged")
    assert summary[3].endswith("Left out of all results below until this is corrected: r2, r4.")


def test_a_run_that_the_diagnosis_explains_is_no_mistake_of_the_report(
    with_excluded_run: tuple[Analysis, str], tmp_path: Path
) -> None:
    """A spring pulled a robot onto the path of exchanged sides: "a wire pulls" stood below "left and right"."""
    found, _ = with_excluded_run
    explained = {
        "verdict": "effect",
        "reason": "",
        "effects": [],
        "explained_mistakes": [
            {"runs": ["r2"], "kind": "sides-swapped", "equivalent_kinds": [], "sentence": "r2: left and right"},
            {"runs": ["r4"], "kind": "reversed", "equivalent_kinds": [], "sentence": "r4: backward"},
        ],
    }
    (tmp_path / "diagnosis.json").write_text(json.dumps(explained), encoding="utf-8")
    path = found.outputs.folder.parent / "experiment.toml"
    again = analyze(path, tmp_path, simulate=True, workers=1)
    assert again.excluded_runs == {"r4"}
    assert (again.pooled[["left_rpm", "right_rpm"]] == [22.0, 33.0]).all(axis=1).any()
    assert "r2: turns as if" not in report_html(again)
    (tmp_path / "diagnosis.json").write_text("{", encoding="utf-8")
    assert analyze(path, tmp_path, simulate=True, workers=1).excluded_runs == {"r2", "r4"}


def test_phases_of_an_excluded_run_are_in_no_result_and_count_as_one_run(
    with_excluded_run: tuple[Analysis, str],
) -> None:
    found, page = with_excluded_run
    assert len(found.turning) == 6
    summary = re.search(r'<ul class="summary">(.*?)</ul>', page, re.DOTALL)
    assert summary is not None
    assert "r4 (" not in summary[1]  # though it turns tightest by far
    assert "r4 (1) (left out)" in page
    assert re.search(r"\b5 runs, from marks", page)
