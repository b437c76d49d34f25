"""A plan becomes files that are ready to be filled with recordings."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pandas as pd
import pytest
from click.testing import CliRunner

from evaluator.cli.group import turnscope
from evaluator.diagnosis.design.candidate_runs import CandidateRun
from evaluator.errors import InputError
from evaluator.interchange.commands import from_log
from evaluator.workflow import Plan, write_plan
from evaluator.workflow.diagnosis.planned_experiment import START_S

RUNS = (CandidateRun(30.0, 30.0, 90.0, -5.0, 2.5, 3.0), CandidateRun(-12.9, -30.0, 0.0, 10.0, 0.0, 4.5))


def test_an_experiment_and_its_commands_are_written(tmp_path: Path) -> None:
    experiment, *logs = write_plan(Plan(RUNS, ()), "barrel", tmp_path / "mine" / "planned.toml")
    written = tomllib.loads(experiment.read_text(encoding="utf-8"))
    assert written["robot"] == "barrel"
    for run, planned, log in zip(written["run"], RUNS, logs, strict=True):
        assert (run["left_rpm"], run["right_rpm"]) == planned.command
        assert run["stop_s"] - run["start_s"] == pytest.approx(planned.duration_s)
        table = pd.read_csv(log)
        assert table.to_numpy().tolist() == [[0.0, *planned.command], [planned.duration_s, 0.0, 0.0]]
    assert written["run"][0]["start_s"] == START_S
    assert "x = -5.0 mm, y = 2.5 mm, heading 90 degrees" in experiment.read_text(encoding="utf-8")


@pytest.mark.parametrize("there", ["planned.toml", "commands/r02.csv"])
def test_nothing_is_overwritten_and_nothing_written_in_part(tmp_path: Path, there: str) -> None:
    (tmp_path / "commands").mkdir()
    (tmp_path / there).write_text("mine")
    with pytest.raises(InputError, match="exists already"):
        write_plan(Plan(RUNS, ()), "barrel", tmp_path / "planned.toml")
    assert [path.read_text() for path in tmp_path.rglob("*") if path.is_file()] == ["mine"]


def test_check_misses_only_what_is_still_to_be_recorded(tmp_path: Path) -> None:
    output, *logs = write_plan(Plan(RUNS, ()), "barrel", tmp_path / "planned.toml")
    for log in logs:
        from_log(log)
    checked = CliRunner().invoke(turnscope, ["check", str(output)])
    assert checked.exit_code == 0, checked.output
    assert "r01.mp4" in checked.output
    assert "camera.json" in checked.output


def test_the_command_says_what_it_wrote(tmp_path: Path) -> None:
    output = tmp_path / "circular.toml"
    told = ["--circular-test", "--rpm", "20", "--rpm", "40", "--rpm", "60", "--repetitions", "1", "-o", str(output)]
    done = CliRunner().invoke(turnscope, ["plan", *told])
    assert done.exit_code == 0, done.output
    assert f"{output}: 24 runs, commands in {tmp_path / 'commands'}" in done.output
    assert len(list((tmp_path / "commands").iterdir())) == 24


def test_an_ordinary_plan_is_written_from_the_command_line_beside_what_programs_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    output = tmp_path / "planned.toml"
    told = ["plan", "--runs", "2", "--rpm", "30", "--plate", "30", "25", "--json", "-o", str(output)]
    done = CliRunner().invoke(turnscope, told)
    assert done.exit_code == 0, done.output
    runs = json.loads(done.stdout)["runs"]
    written = tomllib.loads(output.read_text(encoding="utf-8"))
    assert [(run["left_rpm"], run["right_rpm"]) for run in written["run"]] == [
        (run["left_rpm"], run["right_rpm"]) for run in runs
    ]
    assert sorted(path.name for path in (tmp_path / "commands").iterdir()) == ["r01.csv", "r02.csv"]
    monkeypatch.setattr("evaluator.workflow.plan", None)  # refused before anything is computed
    again = CliRunner().invoke(turnscope, told)
    assert isinstance(again.exception, InputError)
    assert "exists already" in str(again.exception)
