"""The process of a job of the studio: what each kind of work does and tells, with a workflow that is made up."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from evaluator.errors import InputError
from evaluator.progress import Cancelled
from evaluator.studio import work


def test_jobs_of_the_studio_do_what_they_are_named_after_and_tell_it(monkeypatch: pytest.MonkeyPatch) -> None:
    sent, called = list[Any](), list[Any]()
    compared = SimpleNamespace(faults={"r1": "no camera"}, notes={"r2": ("late",)})
    found = SimpleNamespace(verdict="sure", effects={"plate-tilt": 1})
    solved = SimpleNamespace(verdict=SimpleNamespace(summary="good", level="ok"), save=called.append)
    for name, answer in (
        ("compare", compared), ("diagnose", found), ("calibrate", solved), ("pending", ["r1"]), ("out_folder", "out"),
        ("prepare_samples", SimpleNamespace(calibrated=solved)),
    ):  # fmt: skip
        monkeypatch.setattr(
            f"evaluator.workflow.{name}",
            lambda *said, name=name, answer=answer, **_: called.append((name, *said)) or answer,
        )
    pipe: Any = SimpleNamespace(send=sent.append, poll=lambda: False)
    analysed = {"faults": {"r1": "no camera"}, "notes": {"r2": ["late"]}}
    here = Path("e.toml")
    work.carry_out(pipe, "analyse", here, {})
    assert sent == [("outdated", ["r1"]), ("done", analysed)]
    sent.clear()
    work.carry_out(pipe, "diagnose", here, {})
    assert sent[-1] == ("done", {**analysed, "verdict": "sure", "effects": ["plate-tilt"]})
    assert ("diagnose", here, "out") in called
    work.carry_out(pipe, "samples", here, {})
    assert sent[-1] == ("done", {"verdict": "good"})
    work.carry_out(pipe, "calibrate", here, {"images": ["a.png"], "camera": "camera.json"})
    assert sent[-1] == ("done", {"verdict": "good", "level": "ok"})
    assert called[-2:] == [("calibrate", [Path("a.png")], here), Path("camera.json")]


@pytest.mark.parametrize(
    ("error", "last"),
    [
        (Cancelled(), ("cancelled", "")),
        (InputError("no camera"), ("failed", "no camera")),
        (FileNotFoundError(2, "No such file", "/x/a.mp4"), ("failed", "a.mp4: No such file")),
        (OSError("disk full"), ("failed", "disk full")),
        (KeyError("x"), ("failed", "unexpected KeyError: 'x'")),
    ],
)
def test_a_job_that_fails_says_why_in_a_sentence(
    error: Exception, last: tuple[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> Any:
        raise error

    sent = list[Any]()
    monkeypatch.setitem(work.KINDS, "analyse", fail)
    work.carry_out(SimpleNamespace(send=sent.append), "analyse", Path("e.toml"), {})  # type: ignore[arg-type]
    assert sent == [last]


def test_progress_is_told_every_seventh_of_a_second_and_at_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    sent, clock = list[Any](), iter([10.0, 10.1, 10.2, 10.21, 10.22])
    monkeypatch.setattr(work, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    asked = [False]
    pipe: Any = SimpleNamespace(send=lambda said: sent.append(said[1]), poll=lambda: asked[0], recv=asked.pop)
    progress = work._PipeProgress(pipe)
    for done, total in ((1, 4), (2, 4), (3, 4), (4, 4), (0, 0)):
        progress("tracking", done, total)
    assert sent == [("tracking", 0.25), ("tracking", 0.75), ("tracking", 1.0), ("tracking", 0.0)]
    asked[0] = True
    with pytest.raises(Cancelled):
        progress("tracking", 1, 4)
    pipe.poll = lambda: (_ for _ in ()).throw(OSError)
    with pytest.raises(Cancelled):  # the studio has ended
        progress("tracking", 1, 4)
    pipe.send = lambda _: (_ for _ in ()).throw(OSError)
    progress.finally_say("done", 1)
