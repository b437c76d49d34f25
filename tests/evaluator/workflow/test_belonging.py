"""Results of one experiment never replace or join those of another."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from evaluator.errors import InputError
from evaluator.settings import Experiment, load_experiment
from evaluator.workflow import analyze, compare, diagnose, export, measure
from evaluator.workflow.results.belonging import claimed
from evaluator.workflow.results.outputs import Outputs
from evaluator.workflow.results.provenance import write_provenance
from tests.evaluator.synthetic import circling_marks, write_experiment


def experiment_named(folder: Path, name: str, *recordings: str) -> Path:
    """An experiment with a recording of each of some contents."""
    folder.mkdir(exist_ok=True)
    lines = ["format = 1", f'name = "{name}"', 'robot = "barrel"']
    for k, content in enumerate(recordings):
        (folder / f"r{k}.csv").write_text(content, encoding="utf-8")
        lines += ["[[run]]", f'id = "r{k}"', "left_rpm = 30.0", "right_rpm = 30.0", f'marks = "r{k}.csv"']
    path = folder / "experiment.toml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def loaded(folder: Path, name: str, *recordings: str) -> Experiment:
    return load_experiment(experiment_named(folder, name, *recordings))


def claim(outputs: Outputs, experiment: Experiment) -> None:
    """What a command notes that writes one result."""
    with claimed(outputs, experiment):
        outputs.turning.parent.mkdir(exist_ok=True)
        outputs.turning.write_text("run\n", encoding="utf-8")


@pytest.fixture
def outputs(tmp_path: Path) -> Outputs:
    """An output folder with results of the experiment `first` with the recordings `a` and `b`."""
    found = Outputs(tmp_path / "out")
    claim(found, loaded(tmp_path / "first", "first", "a", "b"))
    return found


@pytest.mark.parametrize("command", [analyze, compare, measure, diagnose, export])
def test_every_command_refuses_a_folder_with_results_of_another_experiment(
    outputs: Outputs, tmp_path: Path, command: Callable[..., object]
) -> None:
    before = {path: path.read_bytes() for path in outputs.folder.rglob("*") if path.is_file()}
    other = experiment_named(tmp_path / "other", "other", "c", "d")
    with pytest.raises(InputError, match=r"out: holds results of the experiment 'first'; write those of 'other' to"):
        command(other, outputs.folder)
    assert {path: path.read_bytes() for path in outputs.folder.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize(
    ("name", "recordings"),
    [
        ("first", ("c", "d")),  # other recordings below the same name
        ("renamed", ("a", "b")),
        ("renamed", ("c", "b", "e")),  # and most of the recordings are others
    ],
)
def test_an_experiment_that_was_edited_goes_on_in_its_folder(
    outputs: Outputs, tmp_path: Path, name: str, recordings: tuple[str, ...]
) -> None:
    claim(outputs, loaded(tmp_path / "edited", name, *recordings))
    assert json.loads(outputs.experiment.read_text(encoding="utf-8"))["name"] == name


def test_recordings_are_not_read_again_while_the_name_is_the_same(
    outputs: Outputs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("evaluator.workflow.results.belonging.file_hash", lambda path: pytest.fail(f"reads {path}"))
    claim(outputs, loaded(tmp_path / "first", "first", "a", "b"))


def test_a_recording_that_could_not_be_read_once_is_noted_the_next_time(outputs: Outputs, tmp_path: Path) -> None:
    before = outputs.experiment.read_bytes()
    experiment = loaded(tmp_path / "first", "first", "a", "b")
    experiment.run[0].source.unlink()
    outputs.experiment.unlink()
    claim(outputs, experiment)
    assert outputs.experiment.read_bytes() != before
    claim(outputs, loaded(tmp_path / "first", "first", "a", "b"))
    assert outputs.experiment.read_bytes() == before


def test_the_note_depends_on_contents_only(outputs: Outputs, tmp_path: Path) -> None:
    moved = Outputs(tmp_path / "elsewhere")
    claim(moved, loaded(tmp_path / "moved", "first", "b", "a"))
    assert moved.experiment.read_bytes() == outputs.experiment.read_bytes()


def test_a_folder_of_an_earlier_version_is_known_by_its_provenance(outputs: Outputs, tmp_path: Path) -> None:
    outputs.experiment.unlink()
    path = tmp_path / "first" / "experiment.toml"
    recordings = [run.source for run in load_experiment(path).run]
    write_provenance(outputs.provenance, path, path.read_text(encoding="utf-8"), recordings, (), ())
    with pytest.raises(InputError, match="holds results of the experiment 'first'"):
        claim(outputs, loaded(tmp_path / "other", "other", "c"))
    claim(outputs, loaded(tmp_path / "renamed", "renamed", "b"))


@pytest.mark.parametrize("content", ["{", "[]", '{"name": "first", "recordings_sha256": null}'])
def test_a_note_that_cannot_be_read_is_written_anew(outputs: Outputs, tmp_path: Path, content: str) -> None:
    outputs.experiment.write_text(content, encoding="utf-8")
    claim(outputs, loaded(tmp_path / "other", "other", "c"))
    assert "other" in outputs.experiment.read_text(encoding="utf-8")


@pytest.mark.parametrize("killed", [False, True])
def test_a_folder_without_results_is_free_for_another_experiment(tmp_path: Path, killed: bool) -> None:
    found = Outputs(tmp_path / "out")
    with pytest.raises(InputError, match="lacks time_s"):
        analyze(experiment_named(tmp_path / "broken", "broken", "a"), found.folder, workers=1)
    assert not found.experiment.exists()
    if killed:
        found.experiment.write_text('{"name": "broken", "recordings_sha256": ["0"]}', encoding="utf-8")
    claim(found, loaded(tmp_path / "other", "other", "c"))
    assert "other" in found.experiment.read_text(encoding="utf-8")


def test_results_and_the_note_on_their_experiment_are_written_together(tmp_path: Path) -> None:
    path = write_experiment(tmp_path, [("r01", 14.4, 33.3, circling_marks(6.0, seconds=2))])
    found = measure(path, tmp_path / "out", workers=1)
    assert json.loads(found.outputs.experiment.read_text(encoding="utf-8"))["name"] == "circles"
    assert found.outputs.experiment in found.outputs.of_analysis(["r01"])
