"""Files of an experiment: which belong to it, in what state its results are, and how forms change them."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pandas as pd
import pytest

from evaluator.diagnosis.mistakes.recognised import Correction
from evaluator.errors import InputError
from evaluator.workflow import checks
from evaluator.workflow.editing import mending, values
from evaluator.workflow.fresh import new_experiment
from evaluator.workflow.runs import stored_diagnosis
from evaluator.workflow.viewing import marks, overview

EXPERIMENT = """# ours
format = 1
name = "day"
robot = "barrel"
[[run]]
id = "a"
left_rpm = 1.0
right_rpm = 2.0
marks = "a.csv"
[[run]]
id = "b"
robot = "other/robot.toml"
left_rpm = 1.0
right_rpm = 2.0
marks = "b.csv"
"""


def test_effects_beside_the_experiment_and_beside_the_robots_of_its_runs_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("own", "usual", "named"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "robot.toml").touch()
    folders: list[str] = []

    def beside(folder: Path) -> list[str]:
        folders.append(folder.name)
        return [f"of {folder.name}"]

    monkeypatch.setattr(
        stored_diagnosis, "load_beside", lambda folder: folders.append(folder.name) or [f"of {folder.name}"]
    )
    monkeypatch.setattr(stored_diagnosis, "load_installed", lambda: ["installed", "of usual"])
    monkeypatch.setattr(stored_diagnosis, "load_named", lambda: ["named"])
    monkeypatch.setattr(stored_diagnosis, "read_with", lambda _, file: SimpleNamespace(id=f"file {file}"))
    runs = [SimpleNamespace(robot=None), SimpleNamespace(robot=str(tmp_path / "own" / "robot.toml"))]
    day: Any = SimpleNamespace(robot=str(tmp_path / "usual" / "robot.toml"), run=runs)
    found = stored_diagnosis.own_effect_ids(tmp_path / "day.toml", day, [Path("x.toml")])
    assert folders == [tmp_path.name, "own", "usual"]
    assert found == ("installed", "of usual", "named", f"of {tmp_path.name}", "of own", "file x.toml")
    shipped: Any = SimpleNamespace(robot="barrel", run=[SimpleNamespace(robot=None)])
    folders.clear()
    stored_diagnosis.own_effect_ids(tmp_path / "day.toml", shipped)
    assert folders == [tmp_path.name]


def test_files_of_an_experiment_are_those_it_names_and_robots_that_are_no_shipped_ones(tmp_path: Path) -> None:
    path = tmp_path / "day.toml"
    path.write_text(EXPERIMENT.replace('name = "day"', 'name = "day"\ntracking = "t.toml"'), encoding="utf-8")
    (tmp_path / "t.toml").touch()
    found = [str(file.relative_to(tmp_path)) for file in overview.files_named(path)]
    assert found == ["a.csv", "b.csv", "other/robot.toml", "t.toml"]
    path.write_text(EXPERIMENT.replace("other/robot.toml", "six_driven"), encoding="utf-8")
    assert [file.name for file in overview.files_named(path)] == ["a.csv", "b.csv"]


@pytest.mark.parametrize(
    ("stored", "current", "told"), [(False, True, "none"), (True, True, "current"), (True, False, "stale")]
)
def test_a_diagnosis_is_current_where_it_is_stored_and_its_inputs_are_the_same(
    stored: bool, current: bool, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "experiment.toml"
    path.write_text(EXPERIMENT, encoding="utf-8")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "comparison.csv").touch()
    if stored:
        (tmp_path / "out" / "diagnosis.json").touch()
    monkeypatch.setattr("evaluator.workflow.analysis.pending", lambda *_, **more: {"a": ["turn"], **more})
    monkeypatch.setattr(stored_diagnosis, "key_of_diagnosis", lambda *_: "key")
    monkeypatch.setattr(stored_diagnosis, "own_effect_ids", lambda *_: ())
    monkeypatch.setattr(stored_diagnosis, "is_current", lambda _, key: current and key == "key")
    found = overview.results_state(path)
    assert (found.outdated, found.results, found.diagnosis) == ({"a": ["turn"], "simulate": True}, True, told)


def test_an_experiment_that_cannot_be_analysed_says_its_fault_or_how_many_there_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def pending(*_: object, **__: object) -> None:
        raise InputError("why not")

    path = tmp_path / "experiment.toml"
    monkeypatch.setattr("evaluator.workflow.analysis.pending", pending)
    right = EXPERIMENT.replace("other/robot.toml", "six_driven")
    for run in "ab":
        (tmp_path / f"{run}.csv").touch()
    for missing in (0, 1, 2):
        path.write_text(right.replace("left_rpm = 1.0\n", "", missing), encoding="utf-8")
        several = "2 values are missing or wrong; they are marked in the table of runs"
        assert overview.results_state(path).fault == (several if missing == 2 else "why not")
    path.write_text("this is = not toml =", encoding="utf-8")
    assert overview.results_state(path) == overview.ResultsState({}, False, "none", "why not")


MEASURED = "# ours\n[marks]\ngreen_mm = [0.0, 1.5]\nyellow_mm = [0.0, -1.5]\nheight_mm = 6.5\n"


def test_a_robot_for_measuring_alone_may_lack_a_slip_law_and_one_with_a_law_nothing_else(tmp_path: Path) -> None:
    path, robot = tmp_path / "experiment.toml", tmp_path / "robot.toml"
    path.write_text(EXPERIMENT.replace('"barrel"', '"robot.toml"', 1), encoding="utf-8")
    robot.write_text(MEASURED, encoding="utf-8")
    before = values.robot_values(path)
    found = values.set_robot_value(path, before.version, ("marks", "height_mm"), 7)
    assert dict(found.each)[("marks", "height_mm")] == 7.0
    assert robot.read_text(encoding="utf-8") == MEASURED.replace("6.5", "7.0")
    with pytest.raises(InputError, match="height_mm"):
        values.set_robot_value(path, found.version, ("marks", "height_mm"), -1.0)
    robot.write_text(MEASURED + "[slip]\nlongitudinal_stiffness = 1.0\n", encoding="utf-8")
    with pytest.raises(InputError):
        values.set_robot_value(path, values.robot_values(path).version, ("marks", "height_mm"), 7.5)


def test_settings_of_the_tracker_are_written_beside_the_experiment_and_named_in_it(tmp_path: Path) -> None:
    path = tmp_path / "experiment.toml"
    path.write_text(EXPERIMENT, encoding="utf-8")
    nothing = marks.tracking_file(path)
    assert (nothing.path, nothing.version, nothing.said) == (tmp_path / "tracking.toml", "", {})
    assert set(nothing.sought) == {"green", "yellow"}
    written = marks.write_tracking(path, "", {"mark": {"red": {"diameter_px": 12.0}}})
    assert written.said == {"format": 1, "mark": {"red": {"diameter_px": 12.0}}}
    assert written.sought == {"red": {"diameter_px": 12.0}}
    text = written.path.read_text(encoding="utf-8")
    assert text.startswith("# Help for the tracker")
    assert 'tracking = "tracking.toml"' in path.read_text(encoding="utf-8")
    assert path.read_text(encoding="utf-8").startswith("# ours\n")
    again = marks.write_tracking(path, written.version, {"exposure": 0.5})
    assert again.said == {"format": 1, "exposure": 0.5}
    with pytest.raises(InputError, match="exposure"):
        marks.write_tracking(path, again.version, {"exposure": 2.0})
    assert marks.tracking_file(path) == again
    path.write_text(EXPERIMENT.replace('name = "day"', 'name = "day"\ntracking = "t.toml"'), encoding="utf-8")
    assert marks.tracking_file(path).path == tmp_path / "t.toml"


def test_marks_of_a_run_are_exchanged_by_the_pair_of_its_own_robot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, asked = tmp_path / "day.toml", list[Any]()
    path.write_text(EXPERIMENT, encoding="utf-8")
    wrong = [
        SimpleNamespace(runs=(run,), corrections={run: Correction(marks_exchanged=True)}, sentence="") for run in "ab"
    ]
    table = pd.DataFrame({"time_s": [0.0, 1.0]})
    monkeypatch.setattr(mending, "mistakes_of_marks", lambda *_: wrong)
    monkeypatch.setattr(mending, "load_robot", lambda robot: robot)
    monkeypatch.setattr(mending, "reference_pair", lambda robot: (Path(robot).name,))
    monkeypatch.setattr(mending, "read_with", lambda load, at: load(at) if load is mending.load_experiment else table)
    monkeypatch.setattr(mending, "mended_marks", lambda _, __, pair: asked.append(pair) or table)
    for run in "ab":
        (tmp_path / f"{run}.csv").touch()
    mending.write_mended(path)
    assert asked == [("robot.toml",), ("barrel",)]


@pytest.mark.parametrize(
    ("key", "name", "text", "said"),
    [
        ("tracking", "t.toml", "exposure = 2.0\n", "exposure"),
        ("poses", "p.csv", "time_s,x_mm\n0,1\n1,2\n", "p.csv"),
        ("commands", "c.csv", "time_s\n0\n1\n", "c.csv"),
        ("camera", "c.json", "{}", "c.json"),
    ],
)
def test_a_file_that_cannot_be_read_is_a_fault_and_recordings_of_ros_wait_for_the_topics_of_their_run(
    key: str, name: str, text: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "day.toml").write_text(EXPERIMENT, encoding="utf-8")
    (tmp_path / name).write_text(text, encoding="utf-8")
    written = checks._written(tmp_path / "day.toml")
    assert written is not None
    (fault,) = checks.CHECKS[key](written, name)
    assert said in fault
    monkeypatch.setattr("evaluator.interchange.bags.is_bag", lambda path: path == tmp_path / name)
    if key in ("poses", "commands"):
        assert list(checks.CHECKS[key](written, name)) == []


def test_a_value_of_a_gauge_is_changed_in_its_file_alone_and_a_wrong_one_is_refused(tmp_path: Path) -> None:
    path = new_experiment(tmp_path)[1]
    text = path.read_text(encoding="utf-8")
    before = values.gauge_values(path)
    place, value = next((place, value) for place, value in before.each if place[-1] == "pitch_mm")
    found = values.set_gauge_value(path, before.version, place, 2.0 * float(value))
    assert dict(found.each) == {**dict(before.each), place: 2.0 * float(value)}
    assert len(path.read_text(encoding="utf-8").splitlines()) == len(text.splitlines())  # comments stay
    with pytest.raises(InputError, match="pitch_mm"):
        values.set_gauge_value(path, found.version, place, -1.0)
    assert values.gauge_values(path) == found
