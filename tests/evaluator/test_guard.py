"""A native crash of what reads files costs one sentence, and an interrupt reaches the child once."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from evaluator.cli.guard import CHILD, crash_sentence, needs_child, wait_for
from tests.end_to_end.commands import ROOT, turnscope_process
from tests.waiting import HANGS_S


@pytest.mark.skipif(sys.platform == "win32", reason="sends a signal")
@pytest.mark.parametrize("name", ["SIGSEGV", "SIGABRT", "SIGKILL"])
def test_a_process_that_crashes_is_one_sentence_and_status_2(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    dying = f"import os, signal; os.kill(os.getpid(), signal.{name})"
    assert wait_for([sys.executable, "-c", dying], "turnscope track a.mp4") == 2
    said = capsys.readouterr().err
    assert said.startswith("error: turnscope track a.mp4: the process ")
    assert len(said.splitlines()) == 1


LOOPING = """
import re, sys
from evaluator.files import time_limit
if sys.argv[1] == "watched":
    time_limit.mark_as_watched()
with time_limit.limited(float(sys.argv[3])):  # of a loop in native code, which no thread interrupts
    re.match("(a+)+$", "a" * int(sys.argv[2]) + "b")
print("read")
"""


@pytest.mark.skipif(sys.platform == "win32", reason="has no such timer")
def test_a_reader_that_does_not_return_ends_in_one_sentence(capfd: pytest.CaptureFixture[str]) -> None:
    what = "turnscope turning a.h5"
    assert wait_for([sys.executable, "-c", LOOPING, "watched", "60", "0.2"], what) == 2
    assert capfd.readouterr().err == (
        "error: turnscope turning a.h5: a file could not be read within 20 s of processor time, it is probably "
        "damaged: give the files one by one to find which, and write it anew\n"
    )
    assert wait_for([sys.executable, "-c", LOOPING, "watched", "3", "30"], what) == 0
    assert wait_for([sys.executable, "-c", LOOPING, "by itself", "20", "0.001"], what) == 0  # longer: in a notebook
    assert capfd.readouterr().out == "read\nread\n"


def test_the_child_passes_its_status_on() -> None:
    assert wait_for([sys.executable, "-c", "raise SystemExit(1)"], "") == 1


def test_an_access_violation_of_windows_is_a_crash() -> None:
    assert "0xc0000005" in crash_sentence(0xC0000005, "turnscope dots a.png")


def test_only_commands_that_read_media_have_a_child(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(CHILD, raising=False)
    assert needs_child(["track", "a.mp4"])
    assert needs_child(["--sandbox", "track", "track", "a.mp4"])
    assert needs_child(["--sandbox=.", "track", "a.mp4"])
    assert not needs_child(["--sandbox", "track", "simulate"])
    assert not needs_child(["--sandbox", "track"])
    assert not needs_child(["track", "--help"])
    assert not needs_child(["simulate"])
    assert not needs_child([])
    monkeypatch.setenv(CHILD, "1")
    assert not needs_child(["track", "a.mp4"])


def test_what_lies_in_the_folder_of_the_user_is_not_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "numpy.py").write_text("raise SystemExit('imported')\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    command = [sys.executable, "-P", "-c", "from evaluator.cli import main; main()", "dots", "none.png"]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, env={**os.environ, "PYTHONPATH": str(ROOT)}
    )
    assert "none.png: no such file" in done.stderr
    assert done.returncode == 2


@pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_child_ends_with_its_parent(tmp_path: Path, number: signal.Signals) -> None:
    os.mkfifo(tmp_path / "endless.mp4")  # opening it waits for a writer, who never comes
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    environment.pop(CHILD, None)
    command = [sys.executable, "-m", "evaluator", "track", "endless.mp4", "-o", "m.csv"]
    with subprocess.Popen(command, cwd=tmp_path, env=environment, stderr=subprocess.PIPE) as parent:
        children = _wait_for_child(parent.pid)
        parent.send_signal(number)
        parent.wait(HANGS_S)
        end = time.monotonic() + HANGS_S
        while any(_is_alive(child) for child in children):
            assert time.monotonic() < end
            time.sleep(0.1)


def _wait_for_child(pid: int) -> list[int]:
    end = time.monotonic() + HANGS_S
    while time.monotonic() < end:
        text = Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="utf-8")
        if text:
            time.sleep(1.0)  # until it is on its way
            return [int(child) for child in text.split()]
        time.sleep(0.05)
    raise AssertionError("no child was started")


def _is_alive(pid: int) -> bool:
    try:
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text(encoding="utf-8")
    except OSError:
        return False


def test_an_image_is_read_in_a_child_with_the_words_of_the_command(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(b"no image")
    done = turnscope_process("dots", tmp_path / "a.png")
    assert done.returncode == 2
    assert "not a readable image" in done.stderr
    assert turnscope_process("dots").stderr.startswith("Usage: ")
