"""What a table of runs says is wrong, how a new one is begun, and single values of files: a case for every rule."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

from evaluator.errors import InputError
from evaluator.workflow.editing import documents, experiments, robots, unfinished, values
from evaluator.workflow.editing.documents import version_of
from evaluator.workflow.editing.experiments import Edit, Fault, edit_experiment, new_table, read_experiment, run_id
from simulator.robot import shipped_robot_text

HEAD = 'format = 1\nname = "two"\nrobot = "barrel"\n'
RUN = '[[run]]\nid = "a"\nleft_rpm = 30.0\nright_rpm = 20.0\nmarks = "a.csv"\n'


def written(folder: Path, text: str) -> Path:
    (folder / "a.csv").touch()
    (folder / "experiment.toml").write_text(text, encoding="utf-8")
    return folder / "experiment.toml"


@pytest.mark.parametrize(
    ("text", "faults"),
    [
        (HEAD + RUN, []),
        (HEAD + RUN.replace("a.csv", "gone.csv"), [Fault(0, "marks", "gone.csv does not exist")]),
        (HEAD + RUN + RUN.replace('id = "a"', 'id = "b"\nrobot = "gone.toml"'),
         [Fault(1, "robot", "gone.toml does not exist")]),
        (HEAD + 'camera = "c.json"\n' + RUN,
         [Fault(None, "camera", "c.json does not exist yet: calibrate the camera first")]),
        (HEAD.replace("barrel", "r.toml") + RUN,
         [Fault(None, "robot", "r.toml does not exist: robot = must be a file or a shipped robot")]),
        (HEAD + RUN.replace("left_rpm = 30.0\n", ""), [Fault(0, "left_rpm", "left_rpm is missing")]),
        (RUN, [Fault(None, name, f"{name} is missing") for name in ("format", "name", "robot")]),
        (HEAD + RUN.replace("30.0", '"x"'), [Fault(0, "left_rpm", "")]),
    ],
)  # fmt: skip
def test_a_fault_stands_at_its_cell(text: str, faults: list[Fault], tmp_path: Path) -> None:
    found = read_experiment(written(tmp_path, text)).faults
    assert [(fault.row, fault.key) for fault in found] == [(fault.row, fault.key) for fault in faults]
    assert all(wanted.sentence in fault.sentence for fault, wanted in zip(found, faults, strict=True))


def test_runs_that_are_no_tables_are_no_rows(tmp_path: Path) -> None:
    for runs in ("run = 3\n", 'run = ["a"]\n'):
        found = read_experiment(written(tmp_path, HEAD + runs))
        assert (found.rows, found.head["name"]) == ((), "two")
        assert found.faults


@pytest.mark.parametrize(
    ("edit", "refused"),
    [
        (Edit("set", 0, "left_rpm", 1.0), False), (Edit("set", 0, "robot", "column"), False),
        (Edit("set", 0, "name", "x"), True), (Edit("set", None, "run", 1.0), True),
        (Edit("set", None, "name", "x"), False), (Edit("set", None, "left_rpm", 1.0), True),
        (Edit("add", values={"id": "n"}), False), (Edit("add", values={"name": "n"}), True), (Edit("remove", 0), False),
    ],
)  # fmt: skip
def test_a_cell_belongs_to_a_column_of_its_row(edit: Edit, refused: bool, tmp_path: Path) -> None:
    path = written(tmp_path, HEAD + RUN)
    if refused:
        with pytest.raises(InputError, match="no such column of experiment"):
            edit_experiment(path, version_of(path), [edit])
    else:
        edit_experiment(path, version_of(path), [edit])


def test_an_empty_cell_is_no_key_and_a_first_run_makes_the_table(tmp_path: Path) -> None:
    path = written(tmp_path, HEAD + RUN)
    for value in (None, ""):
        edits = [Edit("set", 0, "group", "A"), Edit("set", 0, "group", value), Edit("set", 0, "rate_hz", value)]
        assert "group" not in edit_experiment(path, version_of(path), edits).rows[0]
    edit_experiment(path, version_of(path), [Edit("remove", 0)])
    assert "run" not in tomllib.loads(path.read_text())
    found = edit_experiment(path, version_of(path), [Edit("add", values={"id": "b", "left_rpm": 0.0, "group": ""})])
    assert found.rows == ({"id": "b", "left_rpm": 0.0},)


@pytest.mark.parametrize(
    ("recording", "taken", "found"),
    [
        ("r01.mp4", [], "r01"), ("my run (2).mp4", [], "my-run--2-"), ("über.mp4", [], "ber"), ("._-.mp4", [], "run"),
        ("r01.mp4", ["r01"], "r01-2"), ("r01.mp4", ["r01", "r01-2"], "r01-3"), ("a.b_c-d.mp4", [], "a.b_c-d"),
    ],
)  # fmt: skip
def test_a_run_is_named_after_its_recording(recording: str, taken: list[str], found: str) -> None:
    assert run_id(recording, taken) == found


def test_a_new_table_has_a_run_for_every_recording_and_the_hints_of_the_template(tmp_path: Path) -> None:
    path = written(tmp_path, HEAD + '[[run]]\nid = "r01"      # a name\n# video = "r01.mp4"  # or marks\n')
    new_table(path, "monday", "column", ["b/x.mp4", "x.mp4"])
    content = tomllib.loads(path.read_text())
    assert (content["name"], content["robot"]) == ("monday", "column")
    assert content["run"] == [
        {"id": "x", "start_s": 0.5, "video": "b/x.mp4"}, {"id": "x-2", "start_s": 0.5, "video": "x.mp4"},
    ]  # fmt: skip
    text = path.read_text()
    assert '# id = "r01"    # a name' in text  # the comment where it was
    assert '# video = "r01.mp4"' in text
    path = written(tmp_path, HEAD + RUN)
    new_table(path, "none", "barrel", [])
    assert "run" not in tomllib.loads(path.read_text())


@pytest.mark.parametrize(
    ("text", "ending"), [("a = 1\n\n# said\n", "\n# said\n"), ("a = 1", ""), ("# a\n", "# a\n"), ("", "")]
)
def test_comments_and_blank_lines_at_the_end_of_a_file_are_its_ending(text: str, ending: str) -> None:
    assert documents._without_ending(text) == (text.removesuffix(ending), ending)


def test_a_run_is_shown_before_it_is_complete(tmp_path: Path) -> None:
    runs = [
        '[[run]]\nid = "a"\nvideo = "a.mp4"\nrate_hz = 30\n',
        '[[run]]\nid = "b"\nrobot = "r.toml"\ncamera = "d.json"\nrate_hz = 0\n',
        '[[run]]\nid = "../c"\n', "[[run]]\nid = 3\n", "[[run]]\nleft_rpm = 3\n",
    ]  # fmt: skip
    path = written(tmp_path, 'robot = "barrel"\ncamera = "c.json"\ntracking = "t.toml"\n' + "".join(runs))
    found = unfinished.read_unfinished(path)
    assert (found.name, found.robot, found.tracking) == ("experiment", "barrel", tmp_path / "t.toml")
    first, second = found.runs
    assert (first.id, first.robot, first.camera, first.video, first.rate_hz) == (
        *("a", "barrel", tmp_path / "c.json", tmp_path / "a.mp4", 30),
    )
    assert (second.id, second.robot, second.camera, second.video, second.rate_hz) == (
        *("b", str(tmp_path / "r.toml"), tmp_path / "d.json", None, None),
    )
    assert unfinished.run_of(path, "b") == second
    with pytest.raises(InputError, match="there is no run c"):
        unfinished.run_of(path, "c")
    with pytest.raises(InputError, match="robot is missing"):
        unfinished.read_unfinished(written(tmp_path, 'name = "x"\n'))


def test_values_of_a_file_have_their_places_and_whole_numbers_stay_whole_where_the_file_has_one() -> None:
    text = 'format = 1\na = 2\n[t]\nb = 2.0  # mm\nc = [1, "x"]\n[[effect]]\nid = "y"\n'
    assert values._each(text) == ((("a",), 2), (("t", "b"), 2.0), (("t", "c", 0), 1), (("t", "c", 1), "x"))

    def changed(place: Any, value: Any) -> str:
        return values._with_value(text, place, value)

    assert "b = 3.0  # mm" in changed(("t", "b"), 3)
    assert "a = 3\n" in changed(("a",), 3)
    assert "a = 2.5\n" in changed(("a",), 2.5)
    assert tomllib.loads(changed(("t", "c", 0), 7))["t"]["c"] == [7, "x"]
    assert "t" not in tomllib.loads(changed(("t",), None))
    for place in (("t", "none", "b"), ("a", "b"), ("t", "c", 9), ("none",)):
        with pytest.raises(InputError, match="no longer in the file"):
            changed(place, 1)


def test_effects_of_ones_own_that_a_robot_names_are_written_with_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, asked = written(tmp_path, HEAD + RUN), list[Path]()
    monkeypatch.setattr(robots, "own_effects_for", lambda at, _text: asked.append(at) or {tmp_path / "mine.toml": "id"})
    robots.write_robot(path, shipped_robot_text("barrel"), "")
    assert asked == [tmp_path / "robot.toml"]
    assert (tmp_path / "mine.toml").read_text() == "id"


def test_a_robot_of_an_experiment_is_its_file_or_a_new_one_beside_it(tmp_path: Path) -> None:
    path = written(tmp_path, HEAD + RUN)
    assert robots.robot_file(path) == robots.RobotFile(tmp_path / "robot.toml", "", named=False)
    (tmp_path / "robot.toml").write_text("mine")
    found = robots.robot_file(path)
    assert (found.path.name, found.named) == ("robot-experiment.toml", False)
    done = robots.write_robot(path, shipped_robot_text("barrel"), "")
    assert (done.path.name, done.named) == ("robot-experiment.toml", True)
    assert 'robot = "robot-experiment.toml"' in path.read_text()
    assert (tmp_path / "robot.toml").read_text() == "mine"
    text = robots.with_effects(path, {"plate-tilt": {"angle_deg": 1.0, "azimuth_deg": 2.0}})
    robots.write_robot(path, text, done.version)
    again = robots.with_effects(
        path, {"plate-tilt": {"angle_deg": 3.0, "azimuth_deg": 2.0}, "mass-offset": {"x_mm": 0.5, "y_mm": 0.0}}
    )
    entries = tomllib.loads(again)["effect"]
    assert [(entry["id"], entry.get("angle_deg")) for entry in entries] == [("plate-tilt", 3.0), ("mass-offset", None)]
    assert robots.effects_of(path) == [{"id": "plate-tilt", "angle_deg": 1.0, "azimuth_deg": 2.0}]
    form = {"channel": "moment", "basis": "one", "coefficient": 0.1}
    twice = robots.with_effects(path, {"free-form": form})
    path.with_name("robot-experiment.toml").write_text(twice)
    assert len(tomllib.loads(robots.with_effects(path, {"free-form": form}))["effect"]) == 3  # forms are added
    with pytest.raises(InputError, match="plate-tilt"):
        robots.with_effects(path, {"plate-tilt": {"angle": 1.0}})
    assert experiments.NEW_START_S == 0.5
