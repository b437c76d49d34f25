"""An experiment whose mistakes are put right on request shows none; the old file stays as it is."""

from __future__ import annotations

import json
import shutil
from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from evaluator.cli.first_steps.check import check
from evaluator.diagnosis.experiment import session_of
from evaluator.errors import InputError
from evaluator.files.csv_tables import read_table
from evaluator.settings import load_experiment
from evaluator.workflow.checks import check_experiment
from evaluator.workflow.editing.mending import write_mended
from evaluator.workflow.runs.mistakes import given_marks, mistakes_of_marks
from tests.evaluator.diagnosis.hidden import COMMANDS, write_hidden

EXCHANGED = {"green_x_mm": "yellow_x_mm", "green_y_mm": "yellow_y_mm"}
EXCHANGED |= {new: old for old, new in EXCHANGED.items()}


def mistakes(path: Path) -> dict[str, str]:
    experiment = load_experiment(path)
    return {run: item.kind for item in mistakes_of_marks(experiment, given_marks(experiment)) for run in item.runs}


def rewrite(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


@pytest.fixture(scope="module")
def spoilt(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An experiment with one mistake each in seven of its sixteen runs."""
    folder = tmp_path_factory.mktemp("spoilt")
    path = write_hidden(folder, {}, commands=COMMANDS * 2, seconds=4.0)
    rewrite(path, 'id = "r4"\nleft_rpm = -33.3', 'id = "r4"  # the second gear\nleft_rpm = 33.3')
    rewrite(path, "right_rpm = -14.4", "right_rpm = 14.4")
    rewrite(path, 'id = "r6"\nleft_rpm = 60.0\nright_rpm = 40.0', 'id = "r6"\nleft_rpm = 40.0\nright_rpm = 60.0')
    rewrite(
        path,
        'id = "r10"\nleft_rpm = 33.3\nright_rpm = 14.4\nstart_s = 0.3',
        'id = "r10"\nleft_rpm = 33.3\nright_rpm = 14.4\nstart_s = 0.05',
    )
    tables = {run: pd.read_csv(folder / f"{run}.csv") for run in ("r2", "r3", "r5", "r15")}
    tables["r2"] = tables["r2"].rename(columns=EXCHANGED)
    tables["r3"][["green_x_mm", "yellow_x_mm"]] *= -1
    tables["r5"].iloc[:, 1:] /= 25.4
    tables["r15"].iloc[:, 1:] = tables["r15"].iloc[0, 1:]
    for run, table in tables.items():
        table.to_csv(folder / f"{run}.csv", index=False)
    return path


def test_a_check_reads_each_marks_file_once_and_says_the_mistakes_that_a_diagnosis_finds(
    spoilt: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    count = Counter[Path]()
    monkeypatch.setattr("evaluator.marks.read_table", lambda file: [count.update([file]), read_table(file)][1])
    said = check_experiment(spoilt).mistakes
    assert set(count.values()) == {1}
    assert len(count) == 16
    experiment = load_experiment(spoilt)
    found = session_of(experiment, given_marks(experiment)).mistakes
    assert said == tuple(item.sentence for item in found)
    assert {run: item.kind for item in found for run in item.runs} == {
        "r2": "marks-swapped",
        "r3": "mirrored",
        "r4": "reversed",
        "r5": "wrong-unit",
        "r6": "sides-swapped",
        "r10": "late-start",
        "r15": "stuck",
    }
    assert len(said) == 7


def test_a_mended_experiment_shows_no_mistake_and_keeps_its_comments(spoilt: Path, tmp_path: Path) -> None:
    path = Path(shutil.copytree(spoilt.parent, tmp_path / "again")) / spoilt.name
    before = path.read_bytes()
    told = CliRunner().invoke(check, [str(path), "--write-mended"], standalone_mode=False)
    mended = path.with_name("experiment-mended.toml")
    assert path.read_bytes() == before
    assert mistakes(mended) == {}
    assert "# the second gear" in mended.read_text(encoding="utf-8")
    assert "r15 is left out" in told.stderr
    runs = {run.id: run for run in load_experiment(mended).run}
    assert set(runs) == {run.id for run in load_experiment(path).run} - {"r15"}
    assert (runs["r4"].left_rpm, runs["r4"].right_rpm) == (-33.3, -14.4)
    assert runs["r10"].start_s == pytest.approx(0.3, abs=0.02)


def test_a_mended_experiment_that_is_there_is_not_written_over(tmp_path: Path) -> None:
    path = write_hidden(tmp_path, {})
    assert write_mended(path) is None
    rewrite(path, "left_rpm = 33.3\nright_rpm = 14.4", "left_rpm = -33.3\nright_rpm = -14.4")
    assert write_mended(path) is not None
    with pytest.raises(InputError, match="exists already"):
        write_mended(path)


def test_what_a_diagnosis_explains_is_not_mended(tmp_path: Path) -> None:
    path = write_hidden(tmp_path, {})
    rewrite(path, "left_rpm = 33.3\nright_rpm = 14.4", "left_rpm = -33.3\nright_rpm = -14.4")
    (run, kind), *others = mistakes(path).items()
    assert not others
    explained = [{"runs": [run], "kind": kind, "equivalent_kinds": [], "sentence": ""}]
    out = tmp_path / "out"
    out.mkdir()
    (out / "diagnosis.json").write_text(json.dumps({"verdict": "effect", "explained_mistakes": explained}))
    assert write_mended(path, out) is None
    assert write_mended(path) is not None


def test_a_check_compares_poses_with_their_commands(tmp_path: Path) -> None:
    """A laboratory with motion capture was told "no errors" of an experiment whose poses were all mirrored."""
    path = write_hidden(tmp_path, {}, commands=COMMANDS, seconds=4.0)
    for run in ("r1", "r2", "r3"):
        marks = pd.read_csv(tmp_path / f"{run}.csv")
        green, yellow = (marks[[f"{name}_x_mm", f"{name}_y_mm"]].to_numpy() for name in ("green", "yellow"))
        left = (green - yellow) / 3.66  # unit vector to the left of the robot
        ahead = np.column_stack([left[:, 1], -left[:, 0]])
        middle, heading = (green + yellow) / 2 + 1.55 * ahead, np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))
        table = {"time_s": marks["time_s"], "x_mm": middle[:, 0], "y_mm": middle[:, 1], "heading_rad": heading}
        pd.DataFrame(table).to_csv(tmp_path / f"{run}-poses.csv", index=False)
        rewrite(path, f'marks = "{run}.csv"', f'poses = "{run}-poses.csv"')
    assert check_experiment(path).mistakes == ()
    rewrite(path, 'id = "r2"\nleft_rpm = 33.3\nright_rpm = 14.4', 'id = "r2"\nleft_rpm = -33.3\nright_rpm = -14.4')
    found = check_experiment(path)
    assert (found.faults, found.unseen, len(found.mistakes)) == ((), (), 1)
    assert found.mistakes[0].startswith("r2: drives the opposite way to its command")
    mended = write_mended(path)
    assert mended is not None
    assert check_experiment(mended.path).mistakes == ()
