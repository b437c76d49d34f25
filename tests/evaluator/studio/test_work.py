"""The process of a job of the studio: what each kind of work does and tells, with a workflow that is made up."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

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
    monkeypatch.setattr("signal.signal", lambda *_: None)
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
