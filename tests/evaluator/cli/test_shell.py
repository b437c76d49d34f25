"""What stands between a shell and the commands: errors as sentences, status, child processes, progress, printing."""

from __future__ import annotations

import importlib.util
import io
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Self

import click
import numpy as np
import pytest

import evaluator.cli
from calibration.errors import CalibrationError
from evaluator.cli import guard
from evaluator.cli.failures import run_safely, sentence_of
from evaluator.cli.printable import Printable, printable
from evaluator.cli.progress import progress_bar
from evaluator.errors import InputError
from evaluator.progress import Cancelled
from simulator.errors import SimulationError
from tests.evaluator.cli.called import Called, run


@pytest.mark.parametrize(
    ("raised", "status", "said"),
    [
        (InputError("a.csv: empty"), 2, "error: a.csv: empty\n"),
        (CalibrationError("dark"), 2, "error: dark\n"),
        (SimulationError("tips"), 2, "error: tips\n"),
        (FileNotFoundError(2, "No such file", "a.csv"), 2, "error: a.csv: No such file\n"),
        (OSError(28, "No space left"), 2, "error: No space left\n"),
        (MemoryError("9 GiB"), 2, "error: more memory is needed than this machine has (9 GiB); "),
        (click.UsageError("so"), 2, "Error: so\n"),
        (KeyboardInterrupt(), 130, "interrupted; finished results are kept"),
        (click.Abort(), 130, "interrupted"),
        (Cancelled(), 130, "interrupted"),
        (None, 0, ""),
    ],
)
def test_every_error_of_a_user_is_a_sentence_and_a_status(
    raised: BaseException | None,
    status: int,
    said: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    @click.command()
    def command() -> None:
        if raised is not None:
            raise raised

    monkeypatch.setattr(sys, "argv", ["turnscope"])
    streams = sys.stdout, sys.stderr
    assert run_safely(command) == status  # type: ignore[arg-type]
    assert said in capsys.readouterr().err
    assert (sys.stdout, sys.stderr) == streams


def test_a_defect_of_ours_shows_its_traceback_and_a_command_its_own_status(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["turnscope"])
    group: Any = SimpleNamespace(main=lambda **_: 1)
    assert run_safely(group) == 1
    assert sentence_of(ValueError("a defect")) is None
    assert sentence_of(OSError("odd")) is None

    def defect(**_: Any) -> None:
        raise ValueError("a defect")

    with pytest.raises(ValueError, match="a defect"):
        run_safely(SimpleNamespace(main=defect))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("words", "child"),
    [(["track", "a"], True), (["track", "--help"], False), (["track", "-h"], False), (["steady"], False), ([], False)],
)
def test_what_reads_recordings_runs_in_a_child_but_not_its_help(
    words: list[str], child: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(guard.CHILD, raising=False)
    assert guard.needs_child(words) is child
    monkeypatch.setenv(guard.CHILD, "1")
    assert not guard.needs_child(words)


def test_the_program_begins_in_a_child_in_itself_or_as_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("evaluator.cli.failures.run_safely", lambda _: 3)
    monkeypatch.setattr(guard, "run_in_child", lambda words: len(words) + 10)
    lived: list[str] = []
    monkeypatch.setattr(guard, "live_as_child", lambda: lived.append("child"))
    monkeypatch.delenv(guard.CHILD, raising=False)
    for words, status in ((["track", "a"], 12), (["steady"], 3)):
        monkeypatch.setattr(sys, "argv", ["turnscope", *words])
        with pytest.raises(SystemExit) as ended:
            evaluator.cli.main()
        assert (ended.value.code, lived) == (status, [])
    monkeypatch.setenv(guard.CHILD, "1")
    monkeypatch.setattr(sys, "argv", ["turnscope", "track", "a"])
    with pytest.raises(SystemExit) as ended:
        evaluator.cli.main()
    assert (ended.value.code, lived, guard.CHILD in guard.os.environ) == (3, ["child"], False)


@pytest.mark.skipif(sys.platform == "win32", reason="has no such signals")
@pytest.mark.parametrize(
    ("status", "said"),
    [
        (-9, "memory ran out"),
        (-27, "could not be read within 20 s"),
        (-11, "crashed (SIGSEGV)"),
        (0xC0000005, "(status 0xc0000005)"),
    ],
)
def test_why_a_child_died_is_told_with_what_to_do(status: int, said: str) -> None:
    sentence = guard.crash_sentence(status, "turnscope track a")
    assert sentence.startswith("turnscope track a: ")
    assert said in sentence


def test_progress_on_a_terminal_names_the_stage_and_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    from rich import progress as bars

    shown: list[dict[str, Any]] = []

    class Bars:
        def __init__(self, *_: Any, **__: Any) -> None:
            return

        def __enter__(self) -> Self:
            return self

        def __exit__(self, *_: object) -> None:
            return

        def add_task(self, what: str, **more: Any) -> int:
            shown.append({"description": what, **more})
            return 7

        def update(self, task: int, **more: Any) -> None:
            shown.append({"task": task, **more})

    monkeypatch.setattr(bars, "Progress", Bars)
    monkeypatch.setattr(sys, "stderr", SimpleNamespace(isatty=lambda: True))
    with progress_bar("runs") as report:
        report("tracking", 3, 10)
        report("runs", 0.25)
        report("search", 5, 0)
    assert shown[0] == {"description": "runs", "total": None, "count": ""}
    assert shown[1] == {"task": 7, "completed": 3, "total": 10, "count": "3/10", "description": "runs: tracking"}
    assert shown[2] == {"task": 7, "completed": 0.25, "total": 1.0, "count": "25%", "description": "runs"}
    assert (shown[3]["total"], shown[3]["count"]) == (None, "5")
    with progress_bar("runs", quiet=True) as report:
        report("tracking", 1, 1)
    assert len(shown) == 4


def test_names_from_files_are_printed_as_text() -> None:
    assert printable("a\tb\nc\x1b[31m\x7f\u202e") == "a\tb\nc\\x1b[31m\\x7f\\u202e"
    stream = Printable(io.TextIOWrapper(io.BytesIO(), encoding="ascii"))
    assert stream.write("é\x1b") == 2
    stream.writelines(["a", "b"])
    stream.original.flush()
    assert stream.buffer.getvalue() == b"\\xe9\\x1bab"


def solved(**more: Any) -> Any:
    """What `calibrate` gives."""
    state = SimpleNamespace(free=("focal_px", "k1", "p2", "kappa"), model="brown")
    found = SimpleNamespace(
        views=[[0] * 220, [0]], rms_px=0.01234, fit=SimpleNamespace(state=state), gauge=SimpleNamespace(name="plate")
    )
    verdict = SimpleNamespace(summary="sound: so", next_steps=("tilt it",), notes=("bent",))
    found.views = [type("View", (list,), {"name": "a.png"})(view) for view in found.views]
    advice = SimpleNamespace(sentence="")
    return SimpleNamespace(calibration=found, verdict=verdict, advice=advice, save=lambda _: None, **more)


def test_a_calibration_says_its_verdict_what_next_and_what_was_written(stub: Any) -> None:
    done = solved()
    called: Called = stub("evaluator.workflow.calibrate", done)
    stub("calibration.assessment.next_image.image_notes", ("adds nothing",))
    page: Called = stub("evaluator.report.pages.calibration.write_calibration_page")
    said = run("calibrate", "a.png", "b.png", "--gauge", "g.toml").stdout.splitlines()
    assert said == [
        "2 images, 221 dots, residual 0.012 px RMS, brown lens, k1, p2",
        *("sound: so", "next: tilt it", "note: bent", "note: adds nothing", "written: camera.json, camera.html"),
    ]
    usual = {"plate": 0, "distance_mm": None, "mark_height_mm": 6.5, "strict": False}
    assert called[0] == (((Path("a.png"), Path("b.png")), Path("g.toml")), usual)
    assert page[0][0][3:] == (Path("camera.html"), 10.0)
    done.calibration.fit.state.free, done.advice.sentence = ("focal_px",), "the left"
    more = (
        "--plate",
        "b.png",
        "-o",
        "c.json",
        "--no-page",
        "--strict",
        "--distance-mm",
        "150",
        "1",
        "--mark-height",
        "7",
    )
    said = run("calibrate", "a.png", "b.png", "--gauge", "g.toml", *more).stdout.splitlines()
    assert said[0].endswith("brown lens, no distortion")
    assert said[3] == "another image would help: the left"
    assert said[-1] == "written: c.json"
    assert len(page) == 1
    assert called[1][1] == {"plate": 1, "distance_mm": (150.0, 1.0), "mark_height_mm": 7.0, "strict": True}
    run("calibrate", "a.png", "--gauge", "g.toml", "--plate", "p.png", "--no-page")
    assert called[2][0][0] == (Path("p.png"), Path("a.png"))
    assert called[2][1]["plate"] == 0


def test_dots_are_counted_with_their_array_and_drawn_where_asked(stub: Any) -> None:
    stub("calibration.detection.image.read_image", "image")
    dots = SimpleNamespace(
        centers_px=np.zeros((3, 2)),
        covariance_px2=np.tile(0.0002 * np.eye(2), (3, 1, 1)),
        diameter_px=np.array([9.0, 10.06, 30.0]),
    )
    dots = type("Dots", (), {**vars(dots), "__len__": lambda _: 3})()
    lattice = type("Lattice", (), {"dot": np.array([0, 1]), "__len__": lambda _: 2})()
    found: Called = stub("calibration.assignment.array_in_image.find_array", (dots, lattice))
    stub("calibration.assignment.lattice.array_size", ("square", 17, 13))
    drawn: Called = stub("evaluator.report.pages.calibration.write_annotated")
    said = "3 dots found, 2 assigned to a square array of 17 × 13, diameter 9.5 px, centres to 0.014 px\n"
    assert run("dots", "a.png").stdout == f"a.png: {said}"
    assert drawn == []
    assert run("dots", "a.png", "--annotate", "there").stdout == f"a.png: {said}written: there/a-dots.png\n"
    assert drawn[0][0] == ("image", dots, lattice, Path("there/a-dots.png"))
    found.result = (dots, [])
    assert run("dots", "a.png", "b.png").stdout.splitlines()[1] == (
        "b.png: 3 dots found, none assigned: they do not form a regular array"
    )


def test_the_studio_opens_a_folder_and_the_browser_unless_told_not_to(
    stub: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("uvicorn", reason="the studio's libraries are not installed (turnscope[studio])")
    import webbrowser

    served: Called = stub("evaluator.studio.server.serve")
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", lambda link: opened.append(link) or True)
    run("studio", str(tmp_path))
    folder, port, tell = served[0][0]
    assert (folder, port) == (tmp_path, 0)
    tell("http://x")
    assert opened == ["http://x"]
    run("studio", str(tmp_path), "--port", "81", "--no-browser")
    served[1][0][2]("http://y")
    assert (served[1][0][1], opened) == (81, ["http://x"])
    assert "no such folder" in str(run("studio", str(tmp_path / "none")).exception)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "tomlkit" else name)
    assert str(run("studio", str(tmp_path)).exception).startswith("the studio needs tomlkit; install with: pip install")


def test_mistakes_are_mended_where_asked(stub: Any) -> None:
    from evaluator.workflow import DiagnosisResult

    content = {"verdict": "none", "reason": "so", "effects": []}
    stub("evaluator.workflow.diagnose", DiagnosisResult(Path("e.toml"), Path("out"), content, True))
    stub("evaluator.cli.experiment.diagnose.say_doubts")  # there is no file
    mended: Called = stub(
        "evaluator.workflow.write_mended", SimpleNamespace(changes=["r1: turned"], path=Path("m.toml"))
    )
    assert run("diagnose", "e.toml", "-q", "--write-mended").stderr == "r1: turned\nm.toml\n"
    assert mended[0][0] == (Path("e.toml"), Path("out"))
    assert run("diagnose", "e.toml", "-q").stderr == ""


CLOSED = """
import os, sys
from evaluator.cli import failures, main

def run(_):
    assert os.open(os.devnull, os.O_RDONLY) > 2
    print("to nobody", file=sys.stderr)
    print("to nobody", flush=True)
    return 7

failures.run_safely, sys.argv = run, ["turnscope"]
main()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="its shell cannot close a stream")
def test_a_program_without_standard_streams_writes_its_messages_into_no_file() -> None:
    line = ("sh", "-c", 'exec "$0" -c "$1" <&- >&- 2>&-', sys.executable, CLOSED)
    assert subprocess.run(line, check=False).returncode == 7
