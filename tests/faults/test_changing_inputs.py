"""A file that changes while it is read: it is said, and what was made of it never counts as up to date."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from evaluator.diagnosis.experiment import Session
from evaluator.diagnosis.result import Diagnosis
from evaluator.errors import InputError
from evaluator.workflow import analyze, pending, track_recording
from evaluator.workflow import tracking as tracking_module
from evaluator.workflow.diagnosis import experiment as diagnosis_module
from evaluator.workflow.results.unchanged import CHANGED, AsFound
from evaluator.workflow.runs import given
from tests.evaluator.synthetic import circling_marks, write_experiment

Change = Callable[[Path], None]


def appended(path: Path) -> None:
    with path.open("a", encoding="utf-8") as file:
        file.write(path.read_text(encoding="utf-8").splitlines()[-1].replace("0.9", "1.9", 1) + "\n")


def replaced(path: Path) -> None:
    other = path.with_name("other")
    circling_marks(9.0, seconds=1.0, seed=8).to_csv(other, index=False)
    other.replace(path)


def edited_in_place(path: Path) -> None:
    """Of the length it had."""
    content = path.read_bytes()
    path.write_bytes(content[:-2] + bytes([ord("1") + content[-2] % 2]) + content[-1:])


CHANGES: dict[str, Change] = {"appended": appended, "replaced": replaced, "edited": edited_in_place}


def two_runs(folder: Path) -> Path:
    return write_experiment(
        folder, [(f"r0{k}", 14.4, 33.3, circling_marks(5.0 + k, seconds=1.0, seed=k)) for k in (1, 2)]
    )


def when_read(
    monkeypatch: pytest.MonkeyPatch, owner: Any, name: str, act: Callable[[], object], *, first: bool
) -> None:
    """Have something happen once, right before or after a function of a module is called for the first time."""
    original, calls = getattr(owner, name), []

    def watched(*given: Any, **options: Any) -> Any:
        calls.append(given)
        if first and len(calls) == 1:
            act()
        result = original(*given, **options)
        if not first and len(calls) == 1:
            act()
        return result

    monkeypatch.setattr(owner, name, watched)


@pytest.mark.parametrize("change", CHANGES)
def test_a_change_of_a_file_is_seen_whether_it_keeps_its_length_or_its_name(change: str, tmp_path: Path) -> None:
    path, other = tmp_path / "r01.csv", tmp_path / "r02.csv"
    for file in (path, other):
        circling_marks(5.0, seconds=1.0).to_csv(file, index=False)
    found = AsFound.of([path, other, tmp_path / "none"])
    assert found.changed() == []
    CHANGES[change](path)
    assert found.changed() == [path]
    assert (AsFound.of([path]) | found).changed() == []  # the first look counts


def test_an_image_more_is_a_change_of_its_folder(tmp_path: Path) -> None:
    found = AsFound.of([tmp_path])
    (tmp_path / "000.png").write_bytes(b"1")
    assert found.changed() == [tmp_path]


@pytest.mark.parametrize("first", [True, False], ids=["before it is read", "after it is read"])
@pytest.mark.parametrize("change", CHANGES)
def test_a_run_whose_marks_change_while_they_are_read_says_so_and_leaves_nothing_that_counts_as_up_to_date(
    change: str, first: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment, out, marks = two_runs(tmp_path), tmp_path / "out", tmp_path / "r01.csv"
    before = marks.read_bytes()
    with monkeypatch.context() as patched:
        when_read(patched, given, "read_any_marks", lambda: CHANGES[change](marks), first=first)
        found = analyze(experiment, out, workers=1)
    assert found.faults == {"r01": f"{marks}: {CHANGED}"}
    assert not found.outputs.marks("r01").exists()
    assert found.turning["radius_mm"].notna().tolist() == [False, True]
    marks.write_bytes(before)  # back to the content whose key was taken
    assert pending(experiment, out) == {"r01": ["read marks", "turn"], "r02": []}
    analyze(experiment, out, workers=1)
    whole = analyze(experiment, tmp_path / "whole", workers=1)
    assert found.outputs.turning.read_bytes() == whole.outputs.turning.read_bytes()
    assert found.outputs.provenance.read_bytes() == whole.outputs.provenance.read_bytes()


def test_a_file_that_is_written_anew_with_what_it_held_is_no_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment, marks = two_runs(tmp_path), tmp_path / "r01.csv"
    when_read(monkeypatch, given, "read_any_marks", lambda: marks.write_bytes(marks.read_bytes()), first=True)
    assert analyze(experiment, tmp_path / "out", workers=1).faults == {}


def test_an_experiment_file_that_is_edited_during_a_batch_is_said_and_its_results_are_those_of_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment, out = two_runs(tmp_path), tmp_path / "out"

    def edit() -> None:
        before = experiment.read_text(encoding="utf-8")
        experiment.write_text(before.replace("left_rpm = 14.4", "left_rpm = 15.5", 1), encoding="utf-8")

    with monkeypatch.context() as patched:
        when_read(patched, given, "read_any_marks", edit, first=True)
        found = analyze(experiment, out, workers=1)
    assert found.changed == (experiment,)
    assert found.turning["left_rpm"].tolist() == [14.4, 14.4]
    provenance = json.loads(found.outputs.provenance.read_text(encoding="utf-8"))
    assert [run["left_rpm"] for run in provenance["settings"]["run"]] == [14.4, 14.4]
    assert provenance["changed_meanwhile"] == ["experiment.toml"]
    assert sorted(provenance["inputs_sha256"]) == ["r01.csv", "r02.csv"]
    assert pending(experiment, out) == {"r01": ["turn"], "r02": []}
    again = analyze(experiment, out, workers=1)
    assert again.changed == ()
    assert again.turning["left_rpm"].tolist() == [15.5, 14.4]
    assert "changed_meanwhile" not in json.loads(found.outputs.provenance.read_text(encoding="utf-8"))


def test_the_command_names_what_changed_during_a_batch(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from evaluator.cli.failures import run_safely
    from evaluator.cli.group import turnscope

    experiment = two_runs(tmp_path)
    when_read(monkeypatch, given, "read_any_marks", lambda: edited_in_place(experiment), first=True)
    command = ["turnscope", "analyze", str(experiment), "-o", str(tmp_path / "out"), "--workers", "1", "-q"]
    monkeypatch.setattr("sys.argv", command)
    assert run_safely(turnscope) == 0
    assert f"{experiment} changed during the analysis" in capsys.readouterr().err


def test_a_recording_that_grows_while_it_is_tracked_gives_no_marks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    video = tmp_path / "r01.mkv"
    video.write_bytes(b"a recording")
    monkeypatch.setattr(tracking_module, "open_recording", lambda *_, **__: None)

    def tracked(*_: object) -> Any:
        with video.open("ab") as file:
            file.write(b" that goes on")
        return None

    monkeypatch.setattr(tracking_module, "track", tracked)
    with pytest.raises(InputError, match=r"r01\.mkv: changed while it was read; wait until it is complete"):
        track_recording(video, tmp_path / "marks.csv")
    assert not (tmp_path / "marks.csv").exists()


def nothing_found(session: Session, *_: object, **__: object) -> Diagnosis:
    return Diagnosis("insufficient", "no search", session)


def test_marks_that_change_before_a_diagnosis_has_read_them_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment, marks = two_runs(tmp_path), tmp_path / "r01.csv"
    monkeypatch.setattr(diagnosis_module, "diagnose_session", nothing_found)
    when_read(monkeypatch, diagnosis_module, "session_of", lambda: replaced(marks), first=True)
    with pytest.raises(InputError, match=r"r01\.csv: changed while it was read"):
        diagnosis_module.diagnose(experiment, tmp_path / "out")
    assert not (tmp_path / "out" / "diagnosis.json").exists()


def test_marks_that_change_during_a_search_are_named_in_its_answer_which_does_not_count_as_up_to_date(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment, marks, out = two_runs(tmp_path), tmp_path / "r01.csv", tmp_path / "out"
    before = marks.read_bytes()
    monkeypatch.setattr(diagnosis_module, "diagnose_session", nothing_found)
    with monkeypatch.context() as patched:
        when_read(patched, diagnosis_module, "diagnose_session", lambda: replaced(marks), first=True)
        found = diagnosis_module.diagnose(experiment, out)
    assert found.content["changed_meanwhile"] == [str(marks)]
    again = diagnosis_module.diagnose(experiment, out)
    assert again.anew
    assert "changed_meanwhile" not in again.content
    marks.write_bytes(before)
    assert diagnosis_module.diagnose(experiment, out).anew
