"""Ids of runs: names in any script, but nothing that leaves the folder or breaks a file name."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from evaluator.settings import Experiment, Run


def run(name: str) -> Run:
    settings: dict[str, Any] = {"id": name, "left_rpm": 1.0, "right_rpm": 1.0, "marks": "x.csv"}
    return Run.model_validate(settings)


TAKEN = ["r.06", "7", "пробег-1", "実験2", "تجربة5", "हिन्दी", "Größe8", "common", "nul2", "運" * 80]
REFUSED = ["", "run a", "r;x", "=1+1", "../x", "a/b", "a\\b", ".x", "x.", "a\nb", "<b>", "a" * 81, "𠀀" * 61]
DEVICES = ["nul", "Aux", "com1.2"]  # of Windows


@pytest.mark.parametrize("name", TAKEN)
def test_names_in_any_script_are_taken(name: str) -> None:
    assert run(name).id == name


@pytest.mark.parametrize("name", [*REFUSED, *DEVICES])
def test_names_that_no_file_should_have_are_refused(name: str) -> None:
    with pytest.raises(ValidationError):
        run(name)


@pytest.mark.parametrize(
    ("ids", "said"),
    [
        (["r1", "r2", "r1"], "run id r1 is used more than once"),
        (["r1", "r2", "R1"], "run ids r1, R1 name one file on Windows and macOS"),
        (["caf\u00e9", "cafe\u0301"], "name one file on Windows and macOS"),
    ],
)
def test_runs_whose_files_would_replace_each_other_are_refused(ids: list[str], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        Experiment(format=1, name="n", robot="barrel", run=tuple(map(run, ids)))
