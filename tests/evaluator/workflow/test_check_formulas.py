"""Which faults of an experiment are told, once each, and when mistakes of its runs are looked for."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from evaluator.interchange.tracks import program_of
from evaluator.workflow import checks
from evaluator.workflow.checks import Check, Written, check_experiment, doubled_videos

HEAD = 'format = 1\nname = "day"\nrobot = "barrel"\n'


def run(name: str, source: str = "marks", end: str = "csv") -> str:
    return f'\n[[run]]\nid = "{name}"\nleft_rpm = 30.0\nright_rpm = 20.0\n{source} = "{name}.{end}"\n'


@pytest.fixture
def day(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """An experiment of two runs; its parts say what they are told to."""
    said = SimpleNamespace(
        path=tmp_path / "day.toml", named=[], topics=[], outside=None, sizes=[], mistakes=[], asked=0
    )
    said.path.write_text(HEAD + run("a") + run("b"), encoding="utf-8")

    def mistakes(*_: Any) -> list[Any]:
        said.asked += 1
        return said.mistakes

    monkeypatch.setattr(checks, "_faults_of_named_files", lambda _: iter(said.named))
    monkeypatch.setattr(checks, "_faults_of_topics", lambda _: iter(said.topics))
    monkeypatch.setattr(checks, "_outside", lambda *_: said.outside)
    monkeypatch.setattr(checks, "_faults_of_sizes", lambda _: iter(said.sizes))
    monkeypatch.setattr(checks, "mistakes_of_marks", mistakes)
    return said


def test_an_experiment_without_faults_is_asked_for_mistakes(day: Any) -> None:
    day.mistakes = [SimpleNamespace(sentence="a: backward")]
    assert check_experiment(day.path) == Check((), 2, 0, ("a: backward",))


def test_what_the_reader_of_a_marks_file_mends_is_a_note_of_its_run(day: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    marks = {day.path.with_name("b.csv"): SimpleNamespace(notes=["2 rows written twice", "exchanged"])}
    monkeypatch.setattr(checks, "_written", lambda path: checks.Written(path, {}, marks))
    assert check_experiment(day.path).notes == ("b: 2 rows written twice", "b: exchanged")


def test_runs_of_poses_are_said_to_be_unseen(day: Any) -> None:
    for name in "ab":
        day.path.with_name(f"{name}.csv").write_text("time_s,green_x_mm,green_y_mm,yellow_x_mm,yellow_y_mm\n")
    day.path.write_text(HEAD + run("a") + run("b", "poses"), encoding="utf-8")
    assert check_experiment(day.path).unseen == ("b",)


@pytest.mark.parametrize("part", ["named", "topics", "outside", "sizes"])
def test_each_fault_is_told_once_and_no_mistake_beside_it(part: str, day: Any) -> None:
    setattr(day, part, "wrong" if part == "outside" else ["wrong"])
    assert check_experiment(day.path) == Check(("wrong",), 2, 0, ())  # of both runs
    assert day.asked == 0


def test_an_effect_beside_the_experiment_that_cannot_be_read_is_a_fault(day: Any) -> None:
    """Mistakes need the robots with all effects: there were none, and no word why."""
    effect = day.path.parent / "effects" / "mine.toml"
    effect.parent.mkdir()
    effect.write_text("this is = broken [", encoding="utf-8")
    (fault,) = check_experiment(day.path).faults
    assert fault.startswith(f"{effect}: not valid TOML")
    assert day.asked == 0


def test_files_are_read_of_an_experiment_that_cannot_be(day: Any) -> None:
    day.named, day.topics = ["a.csv: bad"], ["never asked"]
    day.path.write_text(HEAD + "nonsense = 1\n" + run("a"), encoding="utf-8")
    found = check_experiment(day.path)
    assert (len(found.faults), found.faults[1], found.runs) == (2, "a.csv: bad", 0)
    assert "nonsense" in found.faults[0]


def written_in(path: Path) -> Written:
    written = checks._written(path)
    assert written is not None
    return written


def test_every_file_is_checked_once_by_the_check_of_its_key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[str, str]] = []

    def noted(key: str) -> Any:
        return lambda written, name: asked.append((key, (written.folder / name).name)) or iter(())

    monkeypatch.setattr(checks, "CHECKS", {key: noted(key) for key in checks.CHECKS})
    path = tmp_path / "day.toml"
    path.write_text(HEAD + 'camera = "c.json"\n' + run("a") + run("b", "video", "mp4") + run("a"), encoding="utf-8")
    assert list(checks._faults_of_named_files(written_in(path))) == []
    assert asked == [("robot", "barrel"), ("camera", "c.json"), ("video", "b.mp4"), ("marks", "a.csv")]
    asked.clear()
    for text in ("run = 3\n", 'run = ["a"]\n'):
        path.write_text(text, encoding="utf-8")
        assert list(checks._faults_of_named_files(written_in(path))) == []
    assert asked == []
    path.write_text("{", encoding="utf-8")
    assert checks._written(path) is None


MARKS = "time_s,{a}_x_mm,{a}_y_mm,{b}_x_mm,{b}_y_mm\n0,1,2,3,4\n0.1,1,2,3,4\n"


@pytest.mark.parametrize(
    ("robot", "text", "said"),
    [
        ("barrel", MARKS.format(a="green", b="yellow"), ""),
        ("gone.toml", MARKS.format(a="green", b="yellow"), ""),  # whatever its marks are
        ("gone.toml", "time_s,green\n0,1\n0.1,1\n", "mark"),
        ("barrel", MARKS.format(a="green", b="blue"), "yellow"),
    ],
)
def test_marks_are_read_as_the_analysis_does(robot: str, text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    written = Written(tmp_path / "day.toml", {"robot": robot})
    faults = list(checks._marks(written, "a.csv"))
    assert len(faults) == bool(said)
    times_s = {path: found.time_s.tolist() for path, found in written.marks.items()}
    assert times_s == ({} if said else {tmp_path / "a.csv": [0.0, 0.1]})
    assert said in "".join(faults)


@pytest.mark.parametrize(("times", "said"), [("time_ms", True), ("Time [s]", False)])
def test_motors_that_start_after_the_end_of_a_table_of_another_program_are_a_fault(
    times: str, said: bool, tmp_path: Path
) -> None:
    rows = "".join(f"{k / 60:.4f},{1 + 0.1 * k},2,{1 + 0.1 * k},-2\n" for k in range(90))
    (tmp_path / "a.csv").write_text(f"{times},green_x_mm,green_y_mm,yellow_x_mm,yellow_y_mm\n{rows}", encoding="utf-8")
    path = tmp_path / "day.toml"
    path.write_text(f"{HEAD}{run('a')}start_s = 0.5\n", encoding="utf-8")
    faults = check_experiment(path).faults
    assert len(faults) == said
    assert all(fault.startswith("run a: start_s = 0.5 s, but a.csv ends at 0.00 s; give the time") for fault in faults)


def test_marks_that_a_spreadsheet_saved_are_those_of_turnscope(tmp_path: Path) -> None:
    """Excel puts a mark of the encoding first, and its empty cells say so."""
    rows = "".join(f"{k / 60:.4f};{1 + 0.1 * k};2;#N/A;-2\n".replace(".", ",") for k in range(90))
    text = f"\ufefftime_s;green_x_mm;green_y_mm;yellow_x_mm;yellow_y_mm\n{rows}"
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    assert program_of(tmp_path / "a.csv") == "turnscope"
    written = Written(tmp_path / "day.toml", {"robot": "barrel"})
    assert list(checks._marks(written, "a.csv")) == []


def test_one_mark_of_two_is_no_pose(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("evaluator.interchange.tracks.program_of", lambda _: "plain")
    shown = {"green": 0, "dust": 0}
    monkeypatch.setattr("evaluator.interchange.tracks.read_points", lambda *_, **__: (0, shown, "mm"))
    (tmp_path / "a.csv").write_text("x", encoding="utf-8")
    written = Written(tmp_path / "day.toml", {"robot": "barrel"})
    (fault,) = checks._marks(written, "a.csv")
    assert "holds the green mark alone; a pose needs two" in fault
    shown["yellow"] = 0
    assert list(checks._marks(written, "a.csv")) == []


def test_images_without_a_clock_are_opened_with_their_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr("evaluator.recording.open_recording", lambda path: opened.append(path.name))
    monkeypatch.setattr("evaluator.recording.has_no_clock", lambda path: path.name == "stack.tif")
    for name in ("stack.tif", "a.mp4"):
        (tmp_path / name).write_text("x", encoding="utf-8")
    for name in ("stack.tif", "a.mp4", "gone.mp4"):
        list(checks._video(Written(tmp_path / "day.toml", {}), name))
    assert opened == ["a.mp4", "gone.mp4"]


@pytest.mark.parametrize(
    ("second", "told"),
    [
        ({}, True),
        ({"start_s": 2.0}, True),  # later, but the first one lasts to the end of the recording
        ({"video": "changed.mp4"}, False),  # of equal size and beginning
        ({"video": "longer.mp4"}, False),
        ({"video": "images"}, False),
        ({"video": None}, False),
    ],
)
def test_a_video_under_two_names_is_doubted(second: dict[str, Any], told: bool, tmp_path: Path) -> None:
    head = b"x" * 70_000
    for name, content in {"a": b"", "b": b"", "changed": b"", "longer": b"z"}.items():
        (tmp_path / f"{name}.mp4").write_bytes(head[: -1 if name == "changed" else None] + content)
    with (tmp_path / "changed.mp4").open("ab") as file:
        file.write(b"y")
    (tmp_path / "images").mkdir()
    given = {"video": "b.mp4", "start_s": 0.5, "stop_s": None, **second}
    video = given["video"] and tmp_path / given["video"]
    runs: Any = [
        SimpleNamespace(id="r1", video=tmp_path / "a.mp4", start_s=0.5, stop_s=None),
        SimpleNamespace(**{**given, "id": "r2", "video": video}),
    ]
    sentence = "r2: its video b.mp4 is that of r1, byte for byte; is it the right recording?"
    assert list(doubled_videos(runs)) == told * [sentence]


def test_one_recording_of_several_runs_is_doubted_only_where_they_are_at_the_same_time(tmp_path: Path) -> None:
    video = tmp_path / "day.mp4"
    video.write_bytes(b"x")
    times = {"r1": (0.5, 2.0), "r2": (2.0, 4.0), "r3": (3.5, None)}
    runs: Any = [SimpleNamespace(id=run, video=video, start_s=a, stop_s=b) for run, (a, b) in times.items()]
    assert [sentence[:33] for sentence in doubled_videos(runs)] == ["r3: its video day.mp4 is that of r2"[:33]]
