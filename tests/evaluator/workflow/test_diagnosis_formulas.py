"""Around a diagnosis: files that it writes and removes, runs that it reads, its folders; what a plan begins with."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pandas as pd
import pytest

from evaluator.diagnosis.design import plan as designs
from evaluator.diagnosis.design.candidate_runs import CandidateRun
from evaluator.errors import InputError
from evaluator.settings import Experiment, load_experiment
from evaluator.workflow.diagnosis import batch, experiment, planning
from evaluator.workflow.diagnosis.batch import Answer, Order, folders_of
from evaluator.workflow.diagnosis.experiment import DiagnosisResult
from evaluator.workflow.results.outputs import Outputs
from evaluator.workflow.runs import stored_diagnosis

TEXT = 'format = 1\nname = "day"\nrobot = "barrel"\ncamera = "camera.json"\n' + "".join(
    f'\n[[run]]\nid = "{run}"\nleft_rpm = 30.0\nright_rpm = 20.0\n{source} = "{run}.{end}"\n'
    for run, source, end in (("a", "marks", "csv"), ("b", "marks", "csv"), ("c", "video", "mp4"))
)


@pytest.fixture
def day(tmp_path: Path) -> Experiment:
    """Two runs of given marks, of which one is of another program, and a video."""
    (tmp_path / "day.toml").write_text(TEXT, encoding="utf-8")
    (tmp_path / "a.csv").write_text("time_s,green_x_mm,green_y_mm,yellow_x_mm,yellow_y_mm\n0,1,2,3,4\n")
    return load_experiment(tmp_path / "day.toml")


def test_files_of_a_diagnosis_are_those_of_its_answer_and_those_of_an_earlier_one_go(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    outputs = Outputs(tmp_path)
    forms = ["first", "second"]
    monkeypatch.setattr(experiment, "own_effects", lambda _: forms)
    monkeypatch.setattr(experiment, "robot_with_effect", lambda _, text: f"{text} with it")
    monkeypatch.setattr(experiment, "disagreement", lambda found: found.table)
    own = {"mine": tmp_path / "mine.toml", "code": tmp_path / "code.py", "other": tmp_path / "other.toml"}
    for path in own.values():
        path.write_text(f"text of {path.stem}", encoding="utf-8")
    monkeypatch.setattr(experiment, "file_of", own.get)
    session = SimpleNamespace(own=("mine", "code", "other"))

    def written(content: Any, **more: Any) -> tuple[set[str], set[str]]:
        usual = {"verdict": "unknown", "chosen": frozenset({"mine", "code", "tilt"}), "follows": True}
        found: Any = SimpleNamespace(**{**usual, "session": session, "table": pd.DataFrame({"run": ["a"]}), **more})
        files = experiment._written(found, content, "robot", outputs)
        there = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file()}
        return {path.relative_to(tmp_path).as_posix() for path in files}, there - {path.name for path in own.values()}

    files, there = written({"verdict": "unknown"})
    assert files == there == {
        *("diagnosis.json", "disagreement.csv", "robot_with_effect.toml", "own_effect.toml", "own_effect_2.toml"),
        "effects/mine.toml",
    }  # fmt: skip
    assert outputs.robot_with_effect.read_text() == "robot with it"
    assert [path.read_text() for path in outputs.own_effects[:2]] == forms
    assert (outputs.effects / "mine.toml").read_text() == "text of mine"
    assert json.loads(outputs.diagnosis.read_text()) == {"verdict": "unknown"}
    files, there = written({"verdict": "effect"}, verdict="effect", follows=False, table=None, chosen=frozenset())
    assert files == {"diagnosis.json"}
    assert there == {"diagnosis.json", "effects/mine.toml"}
    assert written({}, chosen=frozenset({"tilt"}), follows=False)[0] == {
        *("diagnosis.json", "disagreement.csv", "own_effect.toml", "own_effect_2.toml"),
    }
    with pytest.raises(ValueError, match="JSON compliant"):
        written({"size": float("nan")})  # no file that other programs cannot read


def test_marks_are_read_where_they_are_and_the_others_tracked(
    day: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "b.csv").write_text("frame;x;y\n1;2;3\n")
    outputs = Outputs(tmp_path / "out")
    asked: list[Any] = []
    given: list[Any] = []
    read = SimpleNamespace(skipped={"d": "short"}, data=("a",), mistakes=())

    def jobs(described: Experiment, *_: Any, **more: Any) -> Any:
        del more
        return [SimpleNamespace(run=run, camera=run.camera) for run in described.run]

    def results(each: Any, *_: Any) -> Any:
        asked.extend(each)
        return {job.run.id: SimpleNamespace(fault="dark" if job.run.id == "c" else None) for job in each}

    def session(_: Any, marks: Any, cameras: Any) -> Any:
        given.append((dict(marks), dict(cameras)))
        return read

    monkeypatch.setattr(experiment, "results_of", results)
    monkeypatch.setattr(experiment, "session_of", session)
    monkeypatch.setattr(experiment, "jobs_of", jobs)
    monkeypatch.setattr(experiment, "replace", lambda item, **more: SimpleNamespace(**{**vars(item), **more}))
    found = experiment._session(tmp_path / "day.toml", day, outputs, lambda *_: None, 1, None)
    assert all(job.marks_only for job in asked)
    assert given[0][0] == {"a": tmp_path / "a.csv", "b": outputs.marks("b")}
    assert set(given[0][1]) == {"a", "b"}
    assert found.skipped == {"d": "short", "c": "dark"}
    read.data, read.left_out = (), {"e": "of another clock"}
    with pytest.raises(InputError, match=r"no run can be used \(d: short; c: dark; e: of another clock\)"):
        experiment._session(tmp_path / "day.toml", day, outputs, lambda *_: None, 1, None)
    read.mistakes = ("one",)  # they are the answer
    experiment._session(tmp_path / "day.toml", day, outputs, lambda *_: None, 1, None)
    a, b, _ = day.run
    assert [experiment._to_be_read(run, day) for run in (a, b)] == [False, True]
    assert experiment._to_be_read(a, day.model_copy(update={"tracks": object()}))
    (tmp_path / "b.csv").unlink()
    assert not experiment._to_be_read(b, day)  # the session says that it is missing


def test_a_result_is_shown_in_a_line_and_as_a_table() -> None:
    size = {"value": 1.23456, "low": 1.0, "high": 2.0}
    content = {"verdict": "effect", "effects": [{"id": "tilt", "parameters": {"angle_deg": size}}]}
    found = DiagnosisResult(Path("day/experiment.toml"), Path("out"), content, anew=True)
    assert repr(found) == "DiagnosisResult(experiment.toml, effect: tilt)"
    assert "<td>tilt</td><td>angle_deg</td><td>1.235</td><td>1 to 2</td>" in found._repr_html_()
    none = DiagnosisResult(Path("e.toml"), Path("out"), {"verdict": "none", "effects": []}, anew=False)
    assert (repr(none), none._repr_html_()) == ("DiagnosisResult(e.toml, none)", "<p>verdict: none</p>")


def test_experiments_have_folders_of_their_names_and_of_their_folders_where_names_are_shared() -> None:
    out = Path("out")
    found = folders_of([Path("monday/day.toml"), Path("tuesday/day.toml"), Path("tuesday/night.toml")], out)
    assert [path.relative_to(out).as_posix() for path in found.values()] == ["monday-day", "tuesday-day", "night"]
    with pytest.raises(InputError, match="the same name in folders of the same name"):
        folders_of([Path("a/monday/day.toml"), Path("b/monday/day.toml")], out)


@pytest.mark.parametrize(("workers", "dask", "trackers"), [(5, None, 2), (1, None, 1), (5, "tcp://there", 1)])
def test_each_experiment_has_its_share_of_the_processes_and_answers_come_in_order(
    workers: int, dask: str | None, trackers: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths, told = [tmp_path / f"{name}.toml" for name in "ab"], []

    class Answers:
        def __init__(self, _: Any, orders: list[Order], **more: Any) -> None:
            self.orders = orders
            assert [order.trackers for order in orders] == [trackers] * 2
            assert more["workers"] == workers

        def __enter__(self) -> Any:
            return iter([(k, Answer(self.orders[k].experiment, self.orders[k].out)) for k in (1, 0)])

        def __exit__(self, *_: object) -> None:
            pass

    monkeypatch.setattr(batch, "answers_of", Answers)
    found = batch.diagnose_each(
        [*paths, paths[0]], tmp_path / "out", workers=workers, dask=dask, progress=lambda *said: told.append(said[1:])
    )
    assert [answer.experiment for answer in found] == paths
    assert told == [(0, 2), (1, 2), (2, 2)]


def test_a_stored_diagnosis_is_out_of_date_where_a_record_says_so(
    day: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    outputs, key = Outputs(tmp_path / "out"), ["one"]
    monkeypatch.setattr(stored_diagnosis, "key_of_diagnosis", lambda *_: key[0])
    assert stored_diagnosis.earlier_diagnosis(day, outputs) is None
    outputs.folder.mkdir()
    outputs.diagnosis.write_text('{"verdict": "none"}', encoding="utf-8")
    stored = stored_diagnosis.earlier_diagnosis(day, outputs)
    assert stored is not None
    assert not stored.outdated  # of another program
    stored_diagnosis.keep(outputs, "one", [outputs.diagnosis])
    assert stored_diagnosis.is_current(outputs, "one")
    for now, outdated in (("one", False), ("two", True)):
        key[0] = now
        stored = stored_diagnosis.earlier_diagnosis(day, outputs)
        assert stored is not None
        assert (stored.content["verdict"], stored.outdated) == ("none", outdated)
    for text in ("[1]", "{}"):
        outputs.diagnosis.write_text(text, encoding="utf-8")
        with pytest.raises(InputError, match="has no verdict"):
            stored_diagnosis.load_diagnosis(outputs.diagnosis)


def test_what_defines_an_own_effect_today(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert stored_diagnosis._text_now("mine", stored_diagnosis.INSTALLED) == "mine"
    assert stored_diagnosis._text_now("mine", str(tmp_path / "gone.toml")) == ""
    code, terms = tmp_path / "mine.py", tmp_path / "mine.toml"
    code.write_text("raise SystemExit", encoding="utf-8")
    terms.write_text("of terms", encoding="utf-8")
    assert stored_diagnosis._text_now("mine", str(code)) == "raise SystemExit"  # it is read, not executed
    monkeypatch.setattr(stored_diagnosis, "load_own", lambda path: SimpleNamespace(id=path.stem))
    monkeypatch.setattr(stored_diagnosis, "text_of", lambda effect: f"text of {effect}")
    assert stored_diagnosis._text_now("mine", str(terms)) == "text of mine"


def test_a_plan_leaves_half_the_robot_at_every_rim_and_asks_for_effects_as_far_as_it_reaches(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    run, asked, told = CandidateRun(30.0, 20.0, 0.0), [], []
    monkeypatch.setattr("evaluator.diagnosis.candidates.coordinates.named_terms", lambda *how: asked.append(how) or {})
    monkeypatch.setattr(designs, "plan_runs", lambda _, __, rpm, room, runs: asked.append((rpm, room, runs)) or [run])
    monkeypatch.setattr(designs, "expected", lambda _, __, chosen: chosen)
    robot = planning.robot_of("barrel")
    robot = robot.model_copy(update={"body": robot.body.model_copy(update={"length_mm": 6.0, "width_mm": 8.0})})
    found = planning.plan(robot, 3, rpm=[30.0, 60.0], plate_mm=(40.0, 30.0), progress=lambda *said: told.append(said))
    assert (found.runs, found.effects) == ((run,), (run,))
    (reach, levels), (rpm, room, runs) = asked
    assert (reach, levels, rpm, runs) == (16.0, (30.0, 60.0), [30.0, 60.0], 3)
    assert (room.middle_mm, room.half_mm) == ((0.0, 0.0), (16.0, 11.0))
    assert [stage for stage, _ in told] == ["terms", "runs", "effects"]
    assert sorted(share for _, share in told) == [share for _, share in told]
    assert told[0][1] == 0.0
    assert told[2][1] < 1.0
    for plate, fits in (((8.0, 30.0), False), ((30.0, 8.01), True), ((float("inf"), 30.0), False)):
        if fits:
            planning.plan(robot, 3, plate_mm=plate)
        else:
            with pytest.raises(InputError, match="no room to drive: the robot is 8 mm across"):
                planning.plan(robot, 3, plate_mm=plate)
