"""Whatever fails in the middle of a batch: what was there stays whole, and the next run gives the identical result."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from evaluator.errors import InputError
from evaluator.workflow import analyze
from tests.end_to_end.commands import ROOT
from tests.evaluator.synthetic import circling_marks, write_experiment

MOST_CALLS = 400  # far more than a small batch makes


def small_batch(folder: Path) -> Path:
    """Two short runs."""
    runs = [(f"r0{k}", 14.4, 33.3, circling_marks(5.0 + k, seconds=0.75, seed=k)) for k in range(2)]
    return write_experiment(folder, runs)


def contents(folder: Path) -> dict[str, bytes]:
    """Every file below a folder."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


class Failing:
    """A function that fails at its nth call, as a full disk does; `reached`: whether there was one."""

    def __init__(self, original: Callable[..., Any], number: int, error: int) -> None:
        self.original, self.number, self.error, self.calls = original, number, error, 0

    def __call__(self, *args: Any, **options: Any) -> Any:
        self.calls += 1
        if self.calls == self.number:
            raise OSError(self.error, os.strerror(self.error), str(args[0]) if args else None)
        return self.original(*args, **options)

    def __get__(self, owner: object, kind: object = None) -> Callable[..., Any]:
        return (lambda *args, **options: self(owner, *args, **options)) if owner is not None else self

    @property
    def reached(self) -> bool:
        return self.calls >= self.number


# What a batch does to files: (object, name, error of the system).
PLACES = {
    "rename": (Path, "replace", errno.EIO),
    "new file": (tempfile, "mkstemp", errno.ENOSPC),
    "new folder": (Path, "mkdir", errno.EROFS),
    "open": (Path, "open", errno.EIO),
    "write text": (Path, "write_text", errno.ENOSPC),
    "read text": (Path, "read_text", errno.EIO),
    "read bytes": (Path, "read_bytes", errno.EIO),
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, bytes]]:
    folder = tmp_path_factory.mktemp("whole")
    experiment = small_batch(folder)
    analyze(experiment, folder / "out", workers=1)
    return experiment, contents(folder / "out")


@pytest.mark.parametrize("place", PLACES)
def test_every_single_failure_leaves_whole_files_and_the_next_run_the_identical_result(
    place: str, whole: tuple[Path, dict[str, bytes]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment, expected = whole
    owner, name, error = PLACES[place]
    for number in range(1, MOST_CALLS):
        out = tmp_path / f"out-{number}"
        failing = Failing(getattr(owner, name), number, error)
        with monkeypatch.context() as patched:
            patched.setattr(owner, name, failing)
            with contextlib.suppress(OSError, InputError):
                analyze(experiment, out, workers=1)
        left = contents(out) if out.exists() else {}
        torn = [file for file in left if left[file] != expected.get(file) and not _is_whole_table(file, left[file])]
        assert torn == [], f"call {number}"
        analyze(experiment, out, workers=1)
        assert contents(out) == expected, f"call {number}"
        if not failing.reached:
            return
    raise AssertionError(f"more than {MOST_CALLS} calls")


def _is_whole_table(name: str, content: bytes) -> bool:
    """Whether a file is a whole table of the runs: one of them then has a reason instead of numbers."""
    if name not in ("turning.csv", "pooled.csv"):
        return False
    table = pd.read_csv(io.BytesIO(content))
    return content.endswith(b"\n") and len(table) >= 1 and bool(table.notna().any(axis=1).all())


@pytest.mark.skipif(sys.platform == "win32", reason="sends a signal that Windows does not have")
def test_killed_at_random_moments_the_batch_goes_on_to_the_identical_result(
    whole: tuple[Path, dict[str, bytes]], tmp_path: Path
) -> None:
    experiment, expected = whole
    rng, out = np.random.default_rng(22), tmp_path / "out"
    command = [sys.executable, "-m", "evaluator", "analyze", str(experiment), "-o", str(out), "-q", "--workers", "1"]
    for _ in range(4):
        with _started(command) as process:
            time.sleep(float(rng.uniform(0.3, 3.0)))
            process.send_signal(signal.SIGKILL)
    time.sleep(1.0)  # until a child has seen that its parent is gone
    finished = contents(out) if out.exists() else {}
    assert {name for name in finished if not Path(name).name.startswith(".")} <= set(expected)
    told_apart = {"provenance.json"}  # names the command
    assert all(finished[name] == expected[name] for name in finished if name in expected and name not in told_apart)
    analyze(experiment, out, workers=1)
    assert {name: content for name, content in contents(out).items() if name in expected} == expected


@contextlib.contextmanager
def _started(command: list[str]) -> Iterator[subprocess.Popen[bytes]]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        yield process


def test_two_processes_on_one_output_folder_leave_the_result_of_one(
    whole: tuple[Path, dict[str, bytes]], tmp_path: Path
) -> None:
    experiment, expected = whole
    command = [
        sys.executable,
        "-m",
        "evaluator",
        "analyze",
        str(experiment),
        "-o",
        str(tmp_path),
        "-q",
        "--workers",
        "1",
    ]
    with _started(command) as one, _started(command) as other:
        assert one.wait(300) == 0
        assert other.wait(300) == 0
    found = contents(tmp_path)
    assert {name: found[name] for name in found if name != "provenance.json"} == {
        name: expected[name] for name in expected if name != "provenance.json"
    }


def test_an_output_folder_that_cannot_be_written_is_one_sentence(
    whole: tuple[Path, dict[str, bytes]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from evaluator.cli.failures import run_safely
    from evaluator.cli.group import turnscope

    (tmp_path / "out").write_text("a file where the folder should be", encoding="utf-8")
    monkeypatch.setattr(
        "sys.argv", ["turnscope", "analyze", str(whole[0]), "-o", str(tmp_path / "out"), "--workers", "1"]
    )
    assert run_safely(turnscope) == 2
    said = capsys.readouterr().err.strip()
    assert len(said.splitlines()) == 1
    assert str(tmp_path / "out") in said
    assert (tmp_path / "out").read_text(encoding="utf-8").startswith("a file")
