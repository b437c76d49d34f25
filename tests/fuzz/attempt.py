"""Run a command on a spoilt file in this process, and say what is wrong with how it ended."""

from __future__ import annotations

import contextlib
import io
import os
import random
import shutil
import signal
import sys
import tempfile
import traceback
import warnings
from collections.abc import Collection, Iterator
from pathlib import Path

from evaluator.cli.failures import run_safely
from evaluator.cli.group import turnscope
from tests.fuzz.entries import OUT, Entry

LIMIT_S = 30.0  # of processor time, for a file of some kilobytes
WAITS = 20.0  # times as long by the clock: a process may get a twentieth of a busy processor, and is no fault of a file
LONGEST_SENTENCE = 20_000  # characters: a file may have many faults


class HangError(BaseException):
    """The command took longer than its limit; no Exception, so that nothing answers for it."""


def attempt(entry: Entry, content: bytes, valid: Path, *, strict: bool = False, limit_s: float = LIMIT_S) -> str:
    """Put content in place of the entry's file in a copy of the valid folder and run the command.

    Gives "" where it ends with results or one sentence, else what went wrong. strict: only results will do.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "in"
        shutil.copytree(valid, folder)
        (folder / entry.name).write_bytes(content)
        return ended(entry, folder, limit_s, (0,) if strict else (0, 1, 2))


def ended(entry: Entry, folder: Path, limit_s: float, wanted: Collection[int]) -> str:
    """Run the command in a folder; gives "" where it ends as wanted, else what went wrong."""
    return status_and_fault(entry, folder, limit_s, wanted)[1]


def status_and_fault(
    entry: Entry, folder: Path, limit_s: float, wanted: Collection[int] = (0, 1, 2)
) -> tuple[int | None, str]:
    """Exit status, None where there is none, and what was wrong, "" if nothing."""
    arguments = [part.replace(OUT, str(folder.parent / "out")) for part in entry.arguments]
    said, told = io.StringIO(), io.StringIO()
    try:
        with (
            limited(limit_s),
            _inside(folder, arguments),
            contextlib.redirect_stderr(said),
            contextlib.redirect_stdout(told),
            warnings.catch_warnings(),
        ):
            warnings.simplefilter("error" if "PYTEST_CURRENT_TEST" in os.environ else "ignore")
            status = run_safely(turnscope)
    except HangError:
        return None, f"no end within {limit_s:g} s\n{traceback.format_exc(limit=-6)}"
    except BaseException as error:  # noqa: BLE001  # whatever escapes is what we look for
        return None, f"{type(error).__name__}: {error}\n{''.join(traceback.format_exception(error)[-12:])}"
    return status, _fault(status, wanted, said.getvalue(), told.getvalue())


def _fault(status: int, wanted: Collection[int], said: str, told: str) -> str:
    if "Traceback" in said or "Traceback" in told:
        return f"a traceback is shown: {said}{told}"
    if status not in wanted:
        return f"exit status {status}: {said}"
    lines = [line for line in said.strip().splitlines() if line]
    if status == 2 and not lines and not told:
        return "exit status 2 without a sentence"
    if any(ord(character) < 32 or ord(character) in (127, 0x9B) for line in lines for character in line):
        return f"control characters reach the terminal: {said!r}"
    if len(said) > LONGEST_SENTENCE:
        return f"{len(said)} characters are said: {said[:300]}"
    return ""


@contextlib.contextmanager
def _inside(folder: Path, arguments: list[str]) -> Iterator[None]:
    here, before = Path.cwd(), sys.argv
    os.chdir(folder)
    sys.argv = ["turnscope", *arguments]
    try:
        yield
    finally:
        os.chdir(here)
        sys.argv = before


@contextlib.contextmanager
def limited(limit_s: float) -> Iterator[None]:
    """Raise HangError after this processor time, or after WAITS times as long by the clock."""

    def hang(number: int, frame: object) -> None:
        del number, frame
        raise HangError

    timers = {signal.SIGVTALRM: (signal.ITIMER_VIRTUAL, limit_s), signal.SIGALRM: (signal.ITIMER_REAL, WAITS * limit_s)}
    before = {number: signal.signal(number, hang) for number in timers}
    for timer, seconds in timers.values():
        signal.setitimer(timer, seconds)
    try:
        yield
    finally:
        for number, (timer, _) in timers.items():
            signal.setitimer(timer, 0)
            signal.signal(number, before[number])


def spoilt(entry: Entry, valid: Path, rng: random.Random) -> bytes:
    """The entry's valid file with one of its mutations."""
    content = (valid / entry.name).read_bytes()
    return rng.choice(entry.mutations)(rng, content)
