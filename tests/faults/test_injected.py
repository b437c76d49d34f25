"""Whatever fails in the middle of a batch: what was there stays whole, and the next run gives the identical result."""

from __future__ import annotations

import contextlib
import errno
import io
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from evaluator.errors import InputError, UnwritableError
from evaluator.files import write_image, write_text
from evaluator.workflow import analyze
from tests.end_to_end.commands import ROOT
from tests.evaluator.synthetic import circling_marks, write_experiment
from tests.faults.kills import contents, is_torn

MOST_CALLS = 400  # far more than a small batch makes
LEAST_STATES = 10  # a batch of one run writes eight files: some of them, none of them, all of them, and their folders
KILLS = 20


def small_batch(folder: Path, runs: int = 2) -> Path:
    """Short runs."""
    marks = [circling_marks(5.0 + k, seconds=0.75, seed=k) for k in range(runs)]
    return write_experiment(folder, [(f"r0{k}", 14.4, 33.3, table) for k, table in enumerate(marks)])


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
    "new file": (Path, "touch", errno.ENOSPC),
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


@pytest.fixture(scope="module")
def one_run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, bytes]]:
    folder = tmp_path_factory.mktemp("one-run")
    experiment = small_batch(folder, runs=1)
    analyze(experiment, folder / "out", workers=1)
    return experiment, contents(folder / "out")


@pytest.mark.parametrize("place", PLACES)
def test_every_single_failure_leaves_whole_files_and_the_next_run_the_identical_result(
    place: str, request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Every result arrives by a rename: those are tried between two runs as well.
    experiment, expected = request.getfixturevalue("whole" if place == "rename" else "one_run")
    owner, name, error = PLACES[place]
    states: set[frozenset[tuple[str, bytes]]] = set()
    for number in range(1, MOST_CALLS):
        out = tmp_path / f"out-{number}"
        failing = Failing(getattr(owner, name), number, error)
        with monkeypatch.context() as patched:
            patched.setattr(owner, name, failing)
            with contextlib.suppress(OSError, InputError):
                analyze(experiment, out, workers=1)
        left = contents(out) if out.exists() else {}
        torn = [file for file in left if is_torn(file, left, expected) and not _is_whole_table(file, left[file])]
        assert torn == [], f"call {number}"
        if (state := frozenset(left.items())) not in states:  # the next run depends on nothing else
            states.add(state)
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


@pytest.mark.skipif(sys.platform == "win32", reason="forks, and sends a signal that Windows does not have")
def test_killed_at_any_change_of_files_the_batch_goes_on_to_the_identical_result(tmp_path: Path) -> None:
    experiment = small_batch(tmp_path, runs=1)
    command = [sys.executable, "-m", "tests.faults.kills", str(experiment), str(tmp_path / "killed")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["wrong"] == []
    assert found["moments"] > found["states"] > LEAST_STATES


@pytest.mark.exam
@pytest.mark.skipif(sys.platform == "win32", reason="sends a signal that Windows does not have")
def test_a_command_killed_at_random_moments_goes_on_to_the_identical_result(
    whole: tuple[Path, dict[str, bytes]], tmp_path: Path
) -> None:
    experiment, expected = whole
    rng, out = np.random.default_rng(22), tmp_path / "out"
    command = [sys.executable, "-m", "evaluator", "analyze", str(experiment), "-o", str(out), "-q", "--workers", "1"]
    began = time.monotonic()
    with _started(command) as process:
        assert process.wait(300) == 0
    lasts_s = time.monotonic() - began
    for number in range(KILLS):
        killed = tmp_path / f"out-{number}"
        command[command.index("-o") + 1] = str(killed)
        with _started(command, start_new_session=True) as process:
            time.sleep(float(rng.uniform(0.3, 1.0)) * lasts_s)
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)  # with the child that reads recordings
        finished = contents(killed) if killed.exists() else {}
        told_apart = {"provenance.json"}  # names the command
        torn = [name for name in finished if name not in told_apart and is_torn(name, finished, expected)]
        assert torn == []
        analyze(experiment, killed, workers=1)
        assert {name: content for name, content in contents(killed).items() if name in expected} == expected


@contextlib.contextmanager
def _started(command: list[str], **options: Any) -> Iterator[subprocess.Popen[bytes]]:
    environment, quiet = {**os.environ, "PYTHONPATH": str(ROOT)}, subprocess.DEVNULL
    with subprocess.Popen(command, env=environment, stdout=quiet, stderr=quiet, **options) as process:
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


@contextlib.contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """Let the system refuse larger files to this process, whoever writes them."""
    resource = pytest.importorskip("resource", reason="this system has no such limit")
    usual = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, usual[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, usual)


def test_a_disk_without_room_is_one_sentence_that_names_the_file_and_loses_nothing(
    one_run: tuple[Path, dict[str, bytes]], tmp_path: Path
) -> None:
    experiment, expected = one_run
    out = tmp_path / "out"
    analyze(experiment, out, workers=1)
    (out / "poses" / "r00.csv").unlink()
    left = contents(out)
    with files_of_at_most(1024), pytest.raises(UnwritableError, match=r"r00\.csv: cannot be written \(file too"):
        analyze(experiment, out, workers=1)
    assert contents(out) == left
    analyze(experiment, out, workers=1)
    assert contents(out) == expected


def test_an_image_for_which_there_is_no_room_is_not_said_to_be_written(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (99, 99), np.uint8)
    with files_of_at_most(4096), pytest.raises(UnwritableError, match=r"a\.png: cannot be written"):
        write_image(noise, tmp_path / "a.png")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_written_is_named_with_the_file_that_was_wanted(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file", encoding="utf-8")
    with pytest.raises(UnwritableError, match=r"out/r00\.csv: cannot be written \(file exists\)"):
        write_text(tmp_path / "out" / "r00.csv", "x")


def test_a_protected_folder_is_named_with_the_file_that_was_wanted_and_not_with_its_temporary_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def protected(path: Path, **_: object) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))

    monkeypatch.setattr(Path, "touch", protected)
    with pytest.raises(UnwritableError, match=r"/r00\.csv: cannot be written \(read-only file system\)"):
        write_text(tmp_path / "r00.csv", "x")


def test_an_interrupt_while_the_temporary_file_is_made_leaves_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    touch = Path.touch

    def interrupted(path: Path, **options: Any) -> None:
        touch(path, **options)
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "touch", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_text(tmp_path / "r00.csv", "x")
    assert list(tmp_path.iterdir()) == []


def test_a_link_is_kept_and_its_target_replaced(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    (tmp_path / "r.csv").symlink_to(tmp_path / "disk" / "r.csv")
    for text in ("first", "second"):
        write_text(tmp_path / "r.csv", text)
        assert (tmp_path / "disk" / "r.csv").read_text(encoding="utf-8") == text
    assert (tmp_path / "r.csv").is_symlink()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no named pipes among its files")
def test_a_device_or_a_pipe_is_not_replaced_by_a_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to(tmp_path / "pipe")
    for name in ("pipe", "link"):
        with pytest.raises(UnwritableError, match=f"{name}: is a folder, a pipe or a device"):
            write_text(tmp_path / name, "x")
    assert (tmp_path / "pipe").is_fifo()
