"""Commands that read recordings, images and binary tables work in a child process that may die.

The libraries that decode them (FFmpeg, OpenCV, HDF5) are native: a damaged file can crash the process that reads it,
which no `except` answers for. The process that the user started only waits, and says in one sentence what happened.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path

CHILD = "TURNSCOPE_CHILD"  # set in the environment of the child, so that it works itself
READING = frozenset(
    "demo calibrate check-camera dots track turning analyze compare report export diagnose check selftest".split()  # noqa: SIM905
)
ONCE_S = 1.0  # a terminal interrupts parent and child, and the parent passes it on: within so long that is one
WATCHED_S = 0.5  # how often a child looks whether its parent is still there
BAD_INPUT, INTERRUPTED = 2, 130
FIRST_FATAL_ON_WINDOWS = 0xC0000000  # exit codes from here on are exceptions of the system, such as access violations


def needs_child(arguments: Sequence[str]) -> bool:
    """Whether a command line is to be run in a child process; not where it only asks for help."""
    return (
        bool(arguments)
        and arguments[0] in READING
        and CHILD not in os.environ
        and bool(sys.executable)
        and not {"-h", "--help"} & set(arguments)
    )


def run_in_child(arguments: Sequence[str]) -> int:
    """Run a command line in a child process; gives its exit status, 2 with one sentence where it crashed."""
    root = str(Path(__file__).resolve().parents[2])
    # Not "-m": that would import whatever lies in the user's folder under a name that turnscope imports.
    code = (
        f"import sys; sys.argv[0] = {sys.argv[0]!r}; sys.path.append({root!r}); from evaluator.cli import main; main()"
    )
    return wait_for([sys.executable, "-P", "-c", code, *arguments], " ".join(["turnscope", *arguments]))


def wait_for(command: Sequence[str], what: str) -> int:
    """Run a command to its end, passing on interrupts; what: the command in the words of the user."""
    passed_on: list[int] = []

    def pass_on(number: int, frame: object) -> None:
        del frame
        passed_on.append(number)
        if child is not None and sys.platform != "win32":  # there the system tells every process of the console
            child.send_signal(number)

    child: subprocess.Popen[bytes] | None = None
    before = {number: signal.signal(number, pass_on) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        child = subprocess.Popen(command, env={**os.environ, CHILD: str(os.getpid())})  # noqa: S603  # ourselves
        status = child.wait()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if 0 <= status < FIRST_FATAL_ON_WINDOWS:
        return status
    if -status in passed_on:
        return INTERRUPTED
    from evaluator.cli.printable import Printable

    Printable(sys.stderr).write(f"error: {crash_sentence(status, what)}\n")
    return BAD_INPUT


def crash_sentence(status: int, what: str) -> str:
    """What to say of a process that died with this status."""
    names = {-number: number.name for number in signal.Signals}
    cause = names.get(status, f"status {status:#x}")
    if cause == "SIGKILL":
        return (
            f"{what}: the process was killed; if nobody did so, memory ran out: close other programs, use --workers 1"
        )
    return (
        f"{what}: the process that read the files crashed ({cause}); one of them is probably damaged: "
        "give them one by one to find which, and write it anew, for example with ffmpeg -i OLD NEW"
    )


def live_as_child() -> None:
    """In the child: take two interrupts at once as one, and end when the parent is gone."""
    last = -ONCE_S

    def interrupt(number: int, frame: object) -> None:
        nonlocal last
        del number, frame
        again, last = time.monotonic() - last < ONCE_S, time.monotonic()
        if not again:
            raise KeyboardInterrupt

    signal.signal(signal.SIGINT, interrupt)
    threading.Thread(target=_watch, args=(int(os.environ.get(CHILD) or 0),), daemon=True).start()


def _watch(parent: int) -> None:
    while sys.platform == "win32" or os.getppid() == parent:  # Windows does not tell
        time.sleep(WATCHED_S)
    os._exit(1)
