"""What makes a result out of date: which input belongs to which stage, what a record keeps, and how a job fails."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from evaluator.errors import InputError
from evaluator.files import named_from
from evaluator.interchange.bags import Topics
from evaluator.interchange.tracks import Tracks
from evaluator.settings import Run
from evaluator.workflow import analysis
from evaluator.workflow.results import provenance
from evaluator.workflow.results.validity import Record, file_hash
from evaluator.workflow.runs import job as jobs
from evaluator.workflow.runs.job import Job, RunResult
from simulator.effects.entry import EffectEntry
from simulator.robot import load_robot

ALL = {"track", "turn", "simulate"}


@pytest.fixture
def base(tmp_path: Path) -> Job:
    """A run of a video whose files are there."""
    for name in ("a.mp4", "camera.json", "tracking.toml", "corrections.csv", "log.csv", "a.csv", "other"):
        (tmp_path / name).write_text(name, encoding="utf-8")
    run = Run(id="a", video=tmp_path / "a.mp4", camera=tmp_path / "camera.json", left_rpm=30.0, right_rpm=20.0)
    return Job(run, load_robot("barrel"), None, None, tmp_path / "out", simulate=True)


def with_run(job: Job, **more: Any) -> Job:
    return replace(job, run=job.run.model_copy(update=more))


def changed(job: Job, other: Job) -> set[str]:
    """Stages whose keys differ."""
    before, after = job.keys(), other.keys()
    return {stage for stage in ALL if before[stage] != after[stage]}


def test_what_places_the_marks_changes_all_stages_and_what_comes_later_leaves_the_earlier_ones(base: Job) -> None:
    folder, robot = base.out.parent, base.robot
    other = folder / "other"
    assert base.keys() == replace(base, out=folder / "elsewhere").keys()  # where results lie does not matter
    for more in ({"video": other}, {"camera": other}, {"rate_hz": 60.0}, {"corrections": folder / "corrections.csv"}):
        assert changed(base, with_run(base, **more)) == ALL, more
    assert changed(base, replace(base, tracking=folder / "tracking.toml")) == ALL
    marks = robot.marks.model_copy(update={"green_mm": (1.0, 2.0)})
    assert changed(base, replace(base, robot=robot.model_copy(update={"marks": marks}))) == ALL
    for name, value in (("left_rpm", 31.0), ("right_rpm", 31.0), ("start_s", 0.7), ("stop_s", 3.0)):
        assert changed(base, with_run(base, **{name: value})) == ALL - {"track"}, name
    assert changed(base, with_run(base, commands=folder / "log.csv")) == ALL - {"track"}
    body = robot.body.model_copy(update={"length_mm": 9.0})
    assert changed(base, replace(base, robot=robot.model_copy(update={"body": body}))) == ALL - {"track"}
    slip = robot.slip.model_copy(update={"lateral_friction": 0.3})
    assert changed(base, replace(base, robot=robot.model_copy(update={"slip": slip}))) == {"simulate"}
    assert changed(base, replace(base, order=1)) == {"simulate"}


def test_what_a_run_does_not_read_is_in_no_key(base: Job) -> None:
    folder = base.out.parent
    given = with_run(base, video=None, camera=None, marks=folder / "a.csv")
    assert changed(given, replace(given, tracking=folder / "tracking.toml")) == set()
    assert changed(given, with_run(given, corrections=folder / "corrections.csv")) == set()
    assert changed(given, with_run(given, topics=Topics(track_m=2.0))) == set()
    assert changed(given, replace(given, tracks=Tracks(unit="cm"))) == ALL
    assert changed(base, replace(base, tracks=Tracks(unit="cm"))) == set()
    logged = with_run(given, commands=folder / "log.csv")
    assert changed(logged, with_run(logged, topics=Topics(track_m=2.0))) == ALL - {"track"}
    posed = with_run(given, marks=None, poses=folder / "a.csv")
    assert changed(posed, with_run(posed, topics=Topics(track_m=2.0))) == ALL


def test_the_text_of_an_own_effect_counts_for_the_simulation(base: Job, monkeypatch: pytest.MonkeyPatch) -> None:
    entry = EffectEntry.model_validate({"id": "mine"})
    job = replace(base, robot=base.robot.model_copy(update={"effect": (entry,)}))
    own = dict.fromkeys(("mine",), "one text")
    monkeypatch.setattr(jobs, "is_own", own.__contains__)
    monkeypatch.setattr(jobs, "text_of", own.__getitem__)
    before = job.keys()
    own["mine"] = "another"
    after = job.keys()
    assert {stage for stage in ALL if before[stage] != after[stage]} == {"simulate"}
    monkeypatch.setattr(jobs, "is_own", lambda _: False)
    assert job.keys()["simulate"] not in (before["simulate"], after["simulate"])


@pytest.mark.parametrize(
    ("marks", "unit", "program", "camera"),
    [
        (None, None, "", True),  # a video
        ("a.csv", None, "turnscope", False),
        ("a.csv", "px", "plain", True),
        ("a.csv", None, "plain", True),
        ("a.csv", "cm", "plain", False),
        ("a.csv", "px", "turnscope", False),
    ],
)
def test_marks_in_a_length_need_no_camera(
    marks: str | None, unit: Any, program: str, *, camera: bool, base: Job, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jobs, "program_of", lambda _: program)
    job = replace(base, tracks=Tracks(unit=unit))
    if marks:
        job = with_run(job, video=None, marks=base.out.parent / marks)
    assert (job.camera == base.run.camera) == camera
    assert (job.camera is None) != camera
    assert with_run(job, poses=base.out.parent / "a.csv").camera is None


def test_files_of_a_run_are_those_that_are_read(base: Job) -> None:
    folder = base.out.parent
    video = replace(with_run(base, corrections=folder / "corrections.csv"), tracking=folder / "tracking.toml")
    assert [file.name for file in video.files] == ["a.mp4", "camera.json", "tracking.toml", "corrections.csv"]
    given = replace(with_run(video, video=None, camera=None, marks=folder / "a.csv", commands=folder / "log.csv"))
    assert [file.name for file in given.files] == ["a.csv", "log.csv"]
    stages = [replace(base, simulate=on, marks_only=only).stages for on, only in ((True, False), (False, False))]
    assert stages == [("track", "turn", "simulate"), ("track", "turn")]
    assert replace(base, marks_only=True).stages == ("track",)


def test_a_record_keeps_what_was_computed_until_its_key_or_a_file_changes(tmp_path: Path) -> None:
    record = Record(tmp_path / "records" / "a.json")
    file = tmp_path / "marks" / "a.csv"
    file.parent.mkdir()
    file.write_text("one", encoding="utf-8")
    kept = record.keep("track", "k", [file], {"last_s": 1.23456789012345})
    assert kept == {"last_s": 1.23456789}  # nine digits, as in tables
    again = Record.load(record.path)
    assert again.fresh("track", "k") == kept
    assert (again.fresh("track", "other"), again.fresh("turn", "k")) == (None, None)
    file.write_text("two", encoding="utf-8")
    assert again.fresh("track", "k") is None
    file.unlink()
    assert again.fresh("track", "k") is None
    file.write_text("one", encoding="utf-8")
    again.forget()
    assert not file.exists()
    assert not record.path.exists()
    for text in ("{", "[1]", '{"track": 3}'):
        record.path.write_text(text, encoding="utf-8")
        assert Record.load(record.path).fresh("track", "k") is None


@pytest.mark.parametrize(("moves", "said"), [(False, ("the marks move",)), (True, ()), (None, ("the marks move",))])
def test_motion_before_the_start_is_not_told_twice(moves: bool | None, said: tuple[str, ...], base: Job) -> None:
    tracked = {} if moves is None else {"plate_moves": moves, "readout": [4.0, "which shutter?"]}
    found = RunResult.of(base, {"track": tracked, "turn": {"at_rest": ["the marks move"]}}, reused=False)
    assert found.at_rest == said
    assert found.readout == (None if moves is None else (4.0, "which shutter?"))


def test_a_camera_is_asked_about_once_and_motion_that_a_mistake_explains_is_not_told_again() -> None:
    runs = [SimpleNamespace(id=name) for name in "abcd"]
    results = {
        "a": RunResult("a", notes=("dark",), readout=(3.0, "3 times"), at_rest=("moves",)),
        "b": RunResult("b", readout=(5.0, "5 times"), at_rest=("moves",)),
        "c": RunResult("c", readout=(4.0, "4 times")),
        "d": RunResult("d"),
    }
    mistakes: list[Any] = [SimpleNamespace(runs=("a",))]
    said = analysis._notes(SimpleNamespace(run=runs), results, mistakes)  # type: ignore[arg-type]
    assert said == {"a": ("dark",), "b": ("moves", "5 times")}


def test_a_folder_has_the_hash_of_its_names_and_contents(tmp_path: Path) -> None:
    for name, text in (("b", "2"), ("a", "1")):
        (tmp_path / name).write_text(text, encoding="utf-8")
    before = file_hash(tmp_path)
    (tmp_path / "a").rename(tmp_path / "c")
    assert file_hash(tmp_path) != before
    (tmp_path / "c").rename(tmp_path / "a")
    assert file_hash(tmp_path) == before
    (tmp_path / "folder").mkdir()  # no image
    assert file_hash(tmp_path) == before
    (tmp_path / "a").write_text("3", encoding="utf-8")
    assert file_hash(tmp_path) != before


def test_a_result_is_known_where_every_stage_is_up_to_date_or_an_input_cannot_be_read(base: Job) -> None:
    assert jobs.known_result(base) is None
    keys, record = base.keys(), base.record()
    for stage in ("track", "turn"):
        record.keep(stage, keys[stage], [], {"rows": [{"radius_mm": 1.0}]})
    assert jobs.outdated_stages(base) == ["simulate"]
    assert jobs.known_result(base) is None
    record.keep("simulate", keys["simulate"], [], {"rows": [{"gap_rms_mm": 2.0}]})
    assert jobs.outdated_stages(base) == []
    found = jobs.known_result(base)
    assert found == RunResult("a", ({"radius_mm": 1.0},), ({"gap_rms_mm": 2.0},), (), None, reused=True)
    base.run.source.unlink()
    lost = jobs.known_result(base)
    assert lost is not None
    assert lost.fault == f"{base.run.source}: no such file or directory"
    assert not base.record().path.exists()


@pytest.mark.parametrize(
    ("reason", "said"),
    [("{folder}/camera.json: no camera", "{folder}/camera.json: no camera"), ("it\n ends", "{folder}/a.mp4: it ends")],
)
def test_the_fault_of_a_run_names_a_file(reason: str, said: str, base: Job) -> None:
    folder = base.out.parent
    found = jobs.failed(base, InputError(reason.format(folder=folder)))
    assert (found.run, found.fault, found.turning) == ("a", said.format(folder=folder), ())


def test_provenance_has_hashes_of_what_was_read_and_none_of_what_changed(tmp_path: Path) -> None:
    files = {name: tmp_path / name for name in ("day.toml", "a.csv", "b.csv", "gone.csv")}
    for name in ("day.toml", "a.csv", "b.csv"):
        files[name].write_text(name, encoding="utf-8")
    out = tmp_path / "out.json"

    def content(changed: list[Path]) -> Any:
        read = [files[name] for name in ("a.csv", "b.csv", "gone.csv")]
        provenance.write_provenance(out, files["day.toml"], "format = 1", read, changed, ["analyze", "day.toml"])
        return json.loads(out.read_text(encoding="utf-8"))

    found = content([])
    assert (found["format"], found["experiment"], found["settings"]) == (1, "day.toml", {"format": 1})
    assert found["inputs_sha256"] == {name: file_hash(files[name]) for name in ("day.toml", "a.csv", "b.csv")}
    assert "changed_meanwhile" not in found
    found = content([files["b.csv"]])
    assert list(found["inputs_sha256"]) == ["a.csv", "day.toml"]
    assert found["changed_meanwhile"] == [named_from(tmp_path, files["b.csv"])]
