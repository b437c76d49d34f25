"""The studio's Python without a server: folder, history, jobs, the process of a job, and what requests may hold."""

from __future__ import annotations

import json
from math import inf
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from evaluator.errors import InputError
from evaluator.progress import Cancelled
from evaluator.studio import history, work
from evaluator.studio.folder import DEPTH, VIDEOS, Folder
from evaluator.studio.history import History
from evaluator.studio.jobs import MOST_KEPT, Jobs
from evaluator.workflow import ChangedMeanwhileError

pytest.importorskip("starlette", reason="the studio's libraries are not installed (turnscope[studio])")

from evaluator.studio.answers import Asked, number
from evaluator.studio.routes import findings


def test_files_of_a_folder_are_those_within_that_are_not_hidden(tmp_path: Path) -> None:
    inside, outside = tmp_path / "in", tmp_path / "out.mp4"
    deep = Path(*"abcdefg"[: DEPTH + 1])
    for name in (
        "b.mp4",
        "a.MP4",
        "c.png",
        ".hidden.mp4",
        ".git/d.mp4",
        "__pycache__/e.mp4",
        deep / "f.mp4",
        deep.parent / "g.mp4",
    ):
        (inside / name).parent.mkdir(parents=True, exist_ok=True)
        (inside / name).touch()
    outside.touch()
    (inside / "link.mp4").symlink_to(outside)
    folder = Folder(inside)
    assert [folder.relative(path) for path in folder.files(VIDEOS)] == ["a.MP4", "b.mp4", str(deep.parent / "g.mp4")]
    assert len(list(folder.files())) == 4
    with pytest.raises(InputError, match="lies outside the folder"):
        folder.inside(Path("../out.mp4"))
    identifier = folder.id_of(inside / "b.mp4")
    assert Folder(inside).path(identifier) == (inside / "b.mp4").resolve()  # another studio finds it again
    (inside / "b.mp4").unlink()
    with pytest.raises(InputError, match="no longer exists"):
        folder.path(identifier)


def everything(path: Path) -> bool:
    return bool(path)


def test_a_change_is_taken_back_and_made_again_unless_the_file_has_changed_since(tmp_path: Path) -> None:
    file, other, past = tmp_path / "a", tmp_path / "b", History()
    past.record([file], "a made", lambda: file.write_text("1"))
    past.record([file, other], "both", lambda: (file.write_text("2"), other.write_text("x")))
    past.record([file], "nothing", lambda: None)
    assert past.next_steps(everything) == {"undo": {"number": 2, "words": "both"}, "redo": None}
    assert past.next_steps(lambda path: path.name == "c") == {"undo": None, "redo": None}
    with pytest.raises(ChangedMeanwhileError, match="in another tab: look before you undo"):
        past.step(everything, "undo", 1)
    assert past.step(everything, "undo", 2) == "both"
    assert (file.read_text(), other.exists()) == ("1", False)
    assert past.step(everything, "redo", 2) == "both"
    assert (file.read_text(), other.read_text()) == ("2", "x")
    file.write_text("by hand")
    with pytest.raises(ChangedMeanwhileError, match="a was changed since"):
        past.step(everything, "undo", 2)
    assert other.read_text() == "x"  # a change of both is taken back as a whole or not at all
    file.write_text("2")
    past.step(everything, "undo", 2)
    done = past.watch([other], "by a job")
    other.write_text("y")
    done()
    assert past.next_steps(everything)["redo"] is None  # what is made anew cannot be made again
    assert past.next_steps(everything)["undo"] == {"number": 3, "words": "by a job"}
    with pytest.raises(InputError, match="there is nothing to redo"):
        past.step(everything, "redo", 3)


def test_a_change_can_be_made_again_until_its_file_is_changed_otherwise(tmp_path: Path) -> None:
    one, other, past = tmp_path / "a", tmp_path / "b", History()
    past.record([one], "a", lambda: one.write_bytes(b"1"))
    past.step(one.__eq__, "undo", 1)
    past.record([other], "b", lambda: other.write_bytes(b"2"))
    assert past.next_steps(one.__eq__) == {"undo": None, "redo": {"number": 1, "words": "a"}}
    past.record([one, other], "both", lambda: one.write_bytes(b"3"))
    assert past.next_steps(one.__eq__) == {"undo": {"number": 3, "words": "both"}, "redo": None}


def test_the_oldest_changes_are_forgotten_first_and_the_last_never(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(history, "MOST_BYTES", 10)
    past = History()
    for name, size in (("a", 4), ("b", 4), ("c", 3), ("d", 99)):
        past.record([tmp_path / name], name, lambda path=tmp_path / name, size=size: path.write_text("x" * size))
        if name == "c":
            assert past.next_steps(lambda path: path.name == "a")["undo"] is None
            assert past.next_steps(lambda path: path.name == "b")["undo"] is not None
    assert past.next_steps(everything)["undo"] == {"number": 4, "words": "d"}
    assert past.next_steps(lambda path: path.name != "d")["undo"] is None


def test_an_equal_job_is_added_once_and_unfinished_ones_are_written_down(tmp_path: Path) -> None:
    for name in ("a.toml", "b.toml"):
        (tmp_path / name).touch()
    jobs, journal = Jobs(Folder(tmp_path)), tmp_path / ".turnscope-studio.json"
    first = jobs.add("analyse", tmp_path / "a.toml")
    assert jobs.add("analyse", tmp_path / "a.toml") == first
    second, third = jobs.add("diagnose", tmp_path / "a.toml", {"x": 1}), jobs.add("analyse", tmp_path / "b.toml")
    assert [job["number"] for job in jobs.view()] == [third, second, first] == [3, 2, 1]
    written = json.loads(journal.read_text())["running"]
    assert [(order["kind"], order["target"], order["options"]) for order in written] == [
        ("analyse", "a.toml", {}), ("diagnose", "a.toml", {"x": 1}), ("analyse", "b.toml", {}),
    ]  # fmt: skip
    version = jobs.version
    jobs.end(first, "paused")
    jobs.end(99, "paused")
    assert (jobs.view()[-1]["state"], jobs.version) == ("paused", version + 1)
    assert len(json.loads(journal.read_text())["running"]) == 2
    again = jobs.add("analyse", tmp_path / "a.toml")
    assert again == 4
    assert first not in [job["number"] for job in jobs.view()]  # the paused one is continued as the new one
    for job in (second, third, again):
        jobs.end(job, "cancelled")
    assert not journal.exists()
    for _ in range(MOST_KEPT + 5):
        jobs.end(jobs.add("analyse", tmp_path / "a.toml"), "cancelled")
    assert len(jobs.view()) <= MOST_KEPT + 1
    with pytest.raises(InputError):
        jobs.add("analyse", tmp_path / ".." / "c.toml")


def test_what_a_job_says_becomes_its_state(tmp_path: Path) -> None:
    (tmp_path / "a.toml").touch()
    jobs, done = Jobs(Folder(tmp_path)), list[str]()
    jobs.add("analyse", tmp_path / "a.toml", done=lambda: done.append("done"))
    job = jobs._jobs[1]
    jobs._note(job, ("outdated", {"r1": ["track"], "r2": []}))
    jobs._note(job, ("progress", ("tracking", 0.25)))
    assert (job.stage, job.share, job.working, job.finished) == ("tracking", 0.25, ["r1"], [])
    record = tmp_path / "out-a" / "records" / "r1.json"
    record.parent.mkdir(parents=True)
    record.touch()
    job.began = record.stat().st_mtime
    jobs._note(job, ("progress", ("tracking", 0.5)))
    assert (job.finished, job.working) == (["r1"], [])
    job.began += 1  # written by an earlier job
    jobs._note(job, ("progress", ("tracking", 0.5)))
    assert job.finished == []
    jobs._note(job, ("done", {"verdict": "sound"}))
    assert (job.state, job.share, job.summary, job.sentence, done) == ("done", 1.0, {"verdict": "sound"}, "", ["done"])
    for kind, wish, state, sentence in (
        ("failed", "", "failed", "so"),
        ("cancelled", "paused", "paused", "so"),
        ("cancelled", "", "cancelled", "so"),
    ):
        job.state, job.wish, job.share = "running", wish, 0.5
        jobs._note(job, (kind, sentence))
        assert (job.state, job.sentence, job.summary, job.share) == (state, sentence, {}, 0.5)


class Pipe:
    """A pipe to a studio that has asked for an end, or has gone, or only listens."""

    def __init__(self, asks: bool = False, gone: bool = False) -> None:
        self.asks, self.gone, self.sent = asks, gone, list[Any]()

    def poll(self) -> bool:
        return self.asks

    def recv(self) -> str:
        return "end"

    def send(self, message: Any) -> None:
        if self.gone:
            raise OSError
        self.sent.append(message)


def test_progress_is_told_now_and_then_and_at_the_end_and_stops_where_the_studio_asks(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = [100.0]
    monkeypatch.setattr(work.time, "monotonic", lambda: clock[0])
    progress = work._PipeProgress(pipe := Pipe())  # type: ignore[arg-type]
    for at, done in ((100.0, 1.0), (100.1, 2.0), (100.2, 3.0), (100.21, 4.0)):
        clock[0] = at
        progress("tracking", done, 4.0)
    assert pipe.sent == [("progress", ("tracking", share)) for share in (0.25, 0.75, 1.0)]
    progress("nothing", 0.0, 0.0)
    assert pipe.sent[-1] == ("progress", ("nothing", 0.0))
    for broken in (Pipe(asks=True), Pipe(gone=True)):
        with pytest.raises(Cancelled):
            work._PipeProgress(broken)("tracking", 1.0)  # type: ignore[arg-type]
    work._PipeProgress(Pipe(gone=True)).finally_say("done", 1)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("error", "last"),
    [
        (None, ("done", {"a": 1})),
        (Cancelled(), ("cancelled", "")),
        (InputError("a.csv: empty"), ("failed", "a.csv: empty")),
        (FileNotFoundError(2, "No such file", "x/a.csv"), ("failed", "a.csv: No such file")),
        (KeyError("x"), ("failed", "unexpected KeyError: 'x'")),
    ],
)
def test_the_last_word_of_a_job_is_done_failed_or_cancelled(
    error: Exception | None, last: tuple[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    import signal

    def kind(*_: Any) -> dict[str, int]:
        if error is not None:
            raise error
        return {"a": 1}

    monkeypatch.setattr(signal, "signal", lambda *_: None)
    monkeypatch.setitem(work.KINDS, "analyse", kind)
    work.carry_out(pipe := Pipe(), "analyse", Path("a.toml"), {})  # type: ignore[arg-type]
    assert pipe.sent == [last]


def test_numbers_and_effects_of_a_request_are_what_they_should_be() -> None:
    assert (number("2.5", "x"), number(3, "x")) == (2.5, 3.0)
    for wrong in ("two", None, [], inf, "nan"):
        with pytest.raises(InputError, match=r"^x "):
            number(wrong, "x")
    asked = Asked({}, {"at": "7"}, {"text": "a", "list": []})
    assert (asked.number("at", 1.0), asked.number("other", 1.0), asked.text("text")) == (7.0, 1.0, "a")
    for name in ("list", "none"):
        with pytest.raises(InputError, match=f"{name} is missing"):
            asked.text(name)
    assert findings._effects({"a": {"x": "1.5", "y": 2, "z": [1]}}) == {"a": {"x": "1.5", "y": 2.0, "z": [1]}}
    many = {str(k): {} for k in range(findings.MOST_EFFECTS + 1)}
    for refused in ([], {"a": 1}, many, {"a": {"x": None}}):
        with pytest.raises(InputError):
            findings._effects(refused)
    assert len(findings._effects(dict(list(many.items())[1:]))) == findings.MOST_EFFECTS


def test_motions_are_asked_for_in_pairs_and_drawn_beside_those_without_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[Any] = []
    monkeypatch.setattr(
        findings, "sandbox_motions", lambda robot, pairs, **more: calls.append((robot, pairs, more)) or len(calls)
    )
    studio: Any = SimpleNamespace()
    body = {"robot": "column", "commands": [["1", 2]], "nominal": {"body.mass_g": 3}, "effects": {"a": {"x": 1}}}
    size = {"length_mm": 5.0, "width_mm": 9.0}
    assert findings.motions(studio, Asked({}, {}, body)) == {"changed": 1, "body": size}
    nominal, effects = {"body.mass_g": 3.0}, {"a": {"x": 1.0}}
    assert calls == [("column", [(1.0, 2.0)], {"nominal": nominal, "effects": effects, "duration_s": 8.0})]
    both = findings.motions(studio, Asked({}, {}, {"commands": [], "base": True, "duration_s": "2"}))
    assert both == {"changed": 2, "base": 3, "body": size}
    assert calls[2] == ("barrel", [], {"nominal": {}, "effects": {}, "duration_s": 2.0})
    for wrong in (None, [1], [[1, 2, 3]], "ab"):
        with pytest.raises(InputError, match="pairs of left and right rpm"):
            findings.motions(studio, Asked({}, {}, {"commands": wrong}))
