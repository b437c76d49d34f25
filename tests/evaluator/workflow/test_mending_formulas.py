"""What a corrected run says in its row, and what its marks and its log become; each correction by itself."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pandas as pd
import pytest

from evaluator.diagnosis.mistakes.recognised import Correction
from evaluator.errors import InputError
from evaluator.interchange.commands import constant
from evaluator.workflow.editing import mending

PAIR = ("left", "right")
MARKS = pd.DataFrame(
    {
        "time_s": [0.0, 1.0, 2.0],
        "left_x_mm": [1.0, 2.0, 3.0],
        "left_y_mm": [4.0, 5.0, 6.0],
        "left_x_sigma_mm": [0.1, 0.1, 0.1],
        "right_x_mm": [7.0, 8.0, 9.0],
        "left_status": ["ok", "ok", "ok"],
    }
)
TARGET = Path("day-mended.toml")


def applied(correction: Correction, row: dict[str, Any], table: pd.DataFrame | None = None) -> tuple[list[str], Any]:
    files: dict[Path, pd.DataFrame] = {}
    said = mending._apply(correction, row, TARGET, files, table, PAIR)
    return said, files


def test_a_command_and_a_start_are_corrected_in_their_row() -> None:
    row = {"id": "a", "left_rpm": 1.0, "right_rpm": 2.0, "start_s": 0.25}
    said, files = applied(Correction(command=(30.0, -20.5), later_s=0.12345), row)
    assert row == {"id": "a", "left_rpm": 30.0, "right_rpm": -20.5, "start_s": 0.373}
    assert said == ["left_rpm = 30, right_rpm = -20.5", "start_s = 0.373"]
    assert files == {}
    row = {"id": "a"}
    assert applied(Correction(later_s=-0.5), row)[0] == ["start_s = -0.5"]
    assert row == {"id": "a", "start_s": -0.5}


def test_a_log_in_the_time_of_the_recording_takes_the_place_of_a_command() -> None:
    log: Any = SimpleNamespace(command=SimpleNamespace(knots=((0.3, 30.0, 20.0), (3.0, 0.0, 0.0))))
    row = {"id": "a", "left_rpm": 1.0, "right_rpm": 2.0, "start_s": 0.25, "stop_s": 3.0, "group": "g"}
    said, files = applied(Correction(log=log), row)
    file = TARGET.with_name("day-mended-a-commands.csv")
    assert row == {"id": "a", "group": "g", "commands": file.name}
    assert said == [f"commands = {file.name}, in the time of the recording"]
    assert files[file].to_dict("list") == {"time_s": [0.3, 3.0], "left_rpm": [30.0, 0.0], "right_rpm": [20.0, 0.0]}


@pytest.mark.parametrize(
    ("correction", "words", "changed"),
    [
        (
            Correction(marks_exchanged=True),
            "its two marks exchanged",
            {"right_x_mm": [1.0, 2.0, 3.0], "left_x_mm": [7.0, 8.0, 9.0], "right_x_sigma_mm": [0.1] * 3},
        ),
        (Correction(seconds_times=0.5), "its seconds times 0.5", {"time_s": [0.0, 0.5, 1.0]}),
        (
            Correction(lost_s=((1.0, 0.25), (2.0, 0.5))),
            "its times later by 0.75 s where frames are missing",
            {"time_s": [0.0, 1.25, 2.75]},
        ),
        (
            Correction(marks_times=(-1.0, 1.0)),
            "mirrored in x",
            {"left_x_mm": [-1.0, -2.0, -3.0], "left_y_mm": [4.0, 5.0, 6.0], "left_x_sigma_mm": [0.1] * 3},
        ),
        (
            Correction(marks_times=(10.0, 10.0)),
            "its lengths times 10",
            {"left_y_mm": [40.0, 50.0, 60.0], "left_x_sigma_mm": [1.0] * 3, "right_x_mm": [70.0, 80.0, 90.0]},
        ),
    ],
)
def test_marks_are_corrected_in_a_file_of_their_own(
    correction: Correction, words: str, changed: dict[str, list[float]]
) -> None:
    assert mending._of_marks(correction)
    row = {"id": "a", "marks": "a.csv", "start_s": 0.3}
    said, files = applied(correction, row, MARKS)
    assert row == {"id": "a", "marks": "day-mended-a.csv", "start_s": 0.3}
    assert said == [f"marks = day-mended-a.csv, {words}"]
    ((_, table),) = files.items()
    assert {name: table[name].tolist() for name in changed} == {
        name: pytest.approx(values) for name, values in changed.items()
    }
    assert table.filter(like="status").iloc[:, 0].tolist() == ["ok"] * 3
    assert MARKS["time_s"].tolist() == [0.0, 1.0, 2.0]  # the table that was read is as it was


def test_a_correction_of_the_command_leaves_the_marks() -> None:
    assert not mending._of_marks(Correction(command=(1.0, 2.0), later_s=0.1))


EXPERIMENT = 'format = 1\nname = "day"\nrobot = "barrel"\ncamera = "camera.json"\n' + "".join(
    f'\n[[run]]\nid = "{run}"\nleft_rpm = 30.0\nright_rpm = 20.0\n{source} = "{run}.{end}"\n'
    for run, source, end in (("a", "marks", "csv"), ("b", "marks", "csv"), ("c", "video", "mp4"))
)


@pytest.fixture
def day(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """An experiment of two runs of marks and a tracked video, and what is wrong with them: corrections by run."""
    path = tmp_path / "day.toml"
    path.write_text(EXPERIMENT, encoding="utf-8")
    for run in "ab":
        MARKS.to_csv(tmp_path / f"{run}.csv", index=False)
    (tmp_path / "out" / "marks").mkdir(parents=True)
    MARKS.to_csv(tmp_path / "out" / "marks" / "c.csv", index=False)
    asked: list[Any] = []
    wrong: dict[str, Correction | None] = {}
    everywhere = [False]  # whether it is wrong in all runs

    def mistakes(_: Any, marks: dict[str, Path]) -> list[Any]:
        asked.append(sorted(marks))
        return [
            SimpleNamespace(runs=(run,), corrections={run: it}, sentence=f"{run}: bad", everywhere=everywhere[0])
            for run, it in wrong.items()
        ]

    monkeypatch.setattr(mending, "mistakes_of_marks", mistakes)
    return SimpleNamespace(path=path, out=tmp_path / "out", asked=asked, wrong=wrong, everywhere=everywhere)


def test_runs_that_are_right_stay_and_what_cannot_be_corrected_in_its_files_is_left_out(day: Any) -> None:
    assert mending.write_mended(day.path) is None
    day.wrong.update(b=None, c=Correction(marks_exchanged=True))  # the marks of a video are no file of the experiment
    mended = mending.write_mended(day.path, day.out)
    assert day.asked == [["a", "b"], ["a", "b", "c"]]
    assert mended is not None
    assert mended.changes == (f"b {mending.LEFT_OUT}", f"c {mending.LEFT_OUT}")
    text = mended.path.read_text(encoding="utf-8")
    assert [f'id = "{run}"' in text for run in "abc"] == [True, False, False]


def test_a_command_is_corrected_for_a_video_and_without_any_run_nothing_is_written(day: Any) -> None:
    day.wrong.update(a=None, b=None, c=Correction(command=(1.0, 2.0)))
    mended = mending.write_mended(day.path, day.out)
    assert mended is not None
    assert mended.changes[2] == "c: left_rpm = 1, right_rpm = 2"
    mended.path.unlink()
    day.wrong.update(c=None)
    with pytest.raises(InputError, match="no run would be left: a: bad"):
        mending.write_mended(day.path, day.out)
    assert not mended.path.exists()


def test_corrected_marks_lie_beside_the_mended_file(day: Any) -> None:
    day.wrong.update(a=Correction(seconds_times=2.0))
    mended = mending.write_mended(day.path)
    assert mended is not None
    assert mended.changes == ("a: marks = day-mended-a.csv, its seconds times 2",)
    assert pd.read_csv(day.path.with_name("day-mended-a.csv"))["time_s"].tolist() == [0.0, 2.0, 4.0]


def test_what_is_wrong_in_all_parts_of_a_recording_of_poses_is_mended_in_its_log_and_else_stays(day: Any) -> None:
    """Parts are named after their recording; a correction of one would hold for the file of all."""
    by_video = 'left_rpm = 30.0\nright_rpm = 20.0\nvideo = "c.mp4"'
    text = EXPERIMENT.replace(by_video, 'commands = "l.csv"\nposes = "c.csv"')
    day.path.write_text(text, encoding="utf-8")
    day.path.with_name("l.csv").write_text("time_s,left_rpm,right_rpm\n0.0,30,20\n9.0,-10,40\n")
    times = [f"{0.1 * k:.1f},{0.1 * k},0,0" for k in range(99)]
    day.path.with_name("c.csv").write_text("\n".join(["time_s,x_mm,y_mm,heading_deg", *times]))
    log = Correction(log=constant(1.0, 2.0, 0.0, None), wheels=(-1.0, True))
    day.wrong.update({"c@0.0s": log, "c@3.0s": log, "cc@1.0s": log})
    day.everywhere[:] = [True]
    mended = mending.write_mended(day.path)
    assert day.asked == [["a", "b", "c"]]
    assert mended is not None
    assert mended.changes == ("c: commands = day-mended-c-commands.csv, in the time of the recording",)
    written = pd.read_csv(day.path.with_name("day-mended-c-commands.csv"))
    assert written[["left_rpm", "right_rpm"]].iloc[[1, -1]].to_numpy().tolist() == [[-20, -30], [-40, 10]]
    mended.path.unlink()
    stays = mending.Mended(day.path, (f"c (2 parts of it) {mending.PART}",))
    day.everywhere[:] = [False]  # of some runs: the parts that are right share the file
    assert mending.write_mended(day.path) == stays
    day.everywhere[:] = [True]
    day.wrong["c@3.0s"] = Correction(log=log.log, wheels=(1.0, True))
    assert mending.write_mended(day.path) == stays
    day.wrong.update({"c@0.0s": None, "c@3.0s": None})
    assert mending.write_mended(day.path) == stays
