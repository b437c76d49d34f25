"""What only POSIX has stands in few places, and the core runs where it is missing, as on Windows."""

from __future__ import annotations

import ast
import errno
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MODULES = {"fcntl", "grp", "posix", "pty", "pwd", "resource", "syslog", "termios", "tty"}
NAMES = {
    *("fork", "forkpty", "geteuid", "getuid", "killpg", "mkfifo", "sched_getaffinity", "setsid", "pthread_kill"),
    *("SIGALRM", "SIGPROF", "SIGKILL", "SIGHUP", "SIGUSR1", "SIGUSR2", "alarm", "setitimer", "sigwaitinfo"),
}
# Where the operating system is dealt with; each asks first whether it has what is used.
KEEPERS = {
    "evaluator/workflow/execution/machine.py",
    "evaluator/files/time_limit.py",
    "calibration/compilation/cache.py",
}

HIDDEN = f"""
import importlib.abc, os, signal, sys

class Hidden(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        caller = sys._getframe(1)
        while caller and "importlib" in caller.f_code.co_filename:
            caller = caller.f_back
        ours = caller is not None and caller.f_code.co_filename.startswith({str(ROOT)!r} + os.sep)
        if ours and name in {sorted(MODULES)!r}:
            raise ModuleNotFoundError(name)
        return None

import numpy, numba, pandas, cv2, av, click, pydantic  # theirs is not ours to judge
for name in {sorted(MODULES)!r}:
    sys.modules.pop(name, None)
sys.meta_path.insert(0, Hidden())
for name in {sorted(NAMES)!r}:
    for module in (os, signal):
        if hasattr(module, name):
            delattr(module, name)
"""
CORE = """
import evaluator, simulator, calibration
from evaluator.recording import open_recording
from evaluator.tracking import track
from evaluator.turning import measure_turning
from evaluator.workflow import analyze
from evaluator.workflow.execution import machine
from evaluator.files import write_text
from pathlib import Path
import evaluator.cli.guard, evaluator.cli.failures, evaluator.cli.group
for command in evaluator.cli.group.COMMANDS:
    evaluator.cli.group.turnscope.get_command(None, command)
assert machine.available_cores() >= 1
write_text(Path("whole.txt"), "whole")
assert Path("whole.txt").read_text() == "whole"
print("done")
"""


def test_the_core_works_without_what_only_posix_has(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", HIDDEN + CORE],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.strip() == "done", done.stderr


def test_what_only_posix_has_stands_where_the_operating_system_is_dealt_with() -> None:
    offenders = []
    for room in ("calibration", "simulator", "evaluator"):
        for path in (ROOT / room).rglob("*.py"):
            place = path.relative_to(ROOT).as_posix()
            if place not in KEEPERS:
                offenders += [f"{place}: {name}" for name in _posix_names(path)]
    assert offenders == []


def _posix_names(path: Path) -> set[str]:
    found: set[str] = set()
    text = path.read_text(encoding="utf-8")
    if not any(name in text for name in MODULES | NAMES):  # most files; to parse takes longer
        return found
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names} & MODULES
        elif isinstance(node, ast.ImportFrom):
            found |= {node.module or ""} & MODULES
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in ("os", "signal"):
            found |= {node.attr} & NAMES
    return found


@pytest.mark.parametrize("names", ["ascii", "iso8859-1"])
def test_a_file_name_that_the_locale_cannot_write_is_one_sentence(names: str, monkeypatch: pytest.MonkeyPatch) -> None:
    from evaluator.cli.failures import sentence_of

    with pytest.raises(UnicodeEncodeError) as caught:
        "runs/運転.csv".encode(names)
    monkeypatch.setattr(sys, "getfilesystemencoding", lambda: names)
    said = str(sentence_of(caught.value))
    assert said.startswith(f"'運転' cannot be in a file's name under this locale ({names})")
    monkeypatch.undo()
    assert sentence_of(caught.value) is None  # under UTF-8 it is a defect


def test_a_file_on_another_drive_is_named_by_its_whole_path(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    from evaluator.files import named_from

    path = tmp_path / "videos" / "r01.mp4"
    assert named_from(tmp_path / "experiment", path) == "../videos/r01.mp4"

    def on_another_drive(*_: object) -> str:
        raise ValueError("path is on mount 'D:', start on mount 'C:'")

    monkeypatch.setattr(os.path, "relpath", on_another_drive)
    assert named_from(tmp_path / "experiment", path) == path.resolve().as_posix()


def test_a_table_that_is_open_in_a_spreadsheet_on_windows_is_said_to_be(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    from evaluator.errors import UnwritableError
    from evaluator.files import write_text

    def refused(temporary: Path, path: Path) -> None:
        raise PermissionError(errno.EACCES, "Access is denied", str(temporary), 5, str(path))

    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setattr(time, "sleep", lambda _: None)
    monkeypatch.setattr(Path, "replace", refused)
    with pytest.raises(UnwritableError, match=r"turning\.csv: cannot be written .*; close it in other programs"):
        write_text(tmp_path / "turning.csv", "x")
    assert list(tmp_path.iterdir()) == []


def test_a_table_that_a_scanner_on_windows_has_open_for_a_moment_is_written(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    from evaluator.files import write_text

    refusals, replace = iter(range(3)), Path.replace

    def refused_at_first(temporary: Path, path: Path) -> None:
        if next(refusals, None) is not None:
            raise PermissionError(errno.EACCES, "Access is denied", str(temporary), 5, str(path))
        replace(temporary, path)

    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setattr(time, "sleep", lambda _: None)
    monkeypatch.setattr(Path, "replace", refused_at_first)
    write_text(tmp_path / "turning.csv", "x")
    assert [path.name for path in tmp_path.iterdir()] == ["turning.csv"]
