"""Commands that read recordings, images and binary tables run in a child process, which may crash.

The libraries that decode them (FFmpeg, OpenCV, HDF5) are native: a damaged file can crash the process that reads it,
and `except` does not catch this. The process that the user started waits, and reports a crash in one sentence.
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

CHILD = "TURNSCOPE_CHILD"  # environment variable that identifies the child
READING = frozenset(
    "demo calibrate check-camera dots track turning analyze compare report export diagnose check selftest".split()  # noqa: SIM905
)
ONCE_S = 1.0  # interrupts within this time are one: a terminal interrupts parent and child, and the parent forwards it
WATCHED_S = 0.5  # interval at which a child checks whether its parent still runs
BAD_INPUT, INTERRUPTED = 2, 130  # exit statuses, as of other programs on Unix
FIRST_FATAL_ON_WINDOWS = 0xC0000000  # larger exit codes are exceptions of the system, such as access violations


def needs_child(arguments: Sequence[str]) -> bool:
    """Whether a command line runs in a child process; a request for help does not."""
    if arguments and arguments[0].startswith("--sandbox"):
        arguments = arguments[1 if "=" in arguments[0] else 2 :]
    return (
        bool(arguments)
        and arguments[0] in READING
        and CHILD not in os.environ
        and bool(sys.executable)
        and not {"-h", "--help"} & set(arguments)
    )


def run_in_child(arguments: Sequence[str]) -> int:
    """Run a command line in a child process; returns its exit status, 2 with one sentence if it crashed."""
    root = str(Path(__file__).resolve().parents[2])
    # Not "-m": that would import whatever lies in the user's folder under a name that turnscope imports.
    code = (
        f"import sys; sys.argv[0] = {sys.argv[0]!r}; sys.path.append({root!r}); from evaluator.cli import main; main()"
    )
    return wait_for([sys.executable, "-P", "-c", code, *arguments], " ".join(["turnscope", *arguments]))


def wait_for(command: Sequence[str], what: str) -> int:
    """Run a command to its end and forward interrupts; what: the command as the user typed it."""
    passed_on: list[int] = []

    def pass_on(number: int, frame: object) -> None:
        del frame
        passed_on.append(number)
        if child is not None and sys.platform != "win32":  # Windows interrupts every process of the console
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
    """Message for a process that crashed with this status."""
    names = {-number: number.name for number in signal.Signals}
    cause = names.get(status, f"status {status:#x}")
    if cause == "SIGKILL":
        return (
            f"{what}: the process was killed; if nobody did so, memory ran out: close other programs, use --workers 1"
        )
    if cause == "SIGPROF":
        from evaluator.files.time_limit import LONGEST_S

        return (
            f"{what}: a file could not be read within {LONGEST_S:g} s of processor time, it is probably damaged: "
            "give the files one by one to find which, and write it anew"
        )
    return (
        f"{what}: the process that read the files crashed ({cause}); one of them is probably damaged: "
        "give them one by one to find which, and write it anew, for example with ffmpeg -i OLD NEW"
    )


def live_as_child() -> None:
    """In the child: treat two interrupts at once as one, and end when the parent has ended."""
    last = -ONCE_S

    def interrupt(number: int, frame: object) -> None:
        nonlocal last
        del number, frame
        again, last = time.monotonic() - last < ONCE_S, time.monotonic()
        if not again:
            raise KeyboardInterrupt

    # here, because a parent and a call for help need none of what the room of files imports: a tenth of a second
    from evaluator.files.time_limit import mark_as_watched

    mark_as_watched()
    signal.signal(signal.SIGINT, interrupt)
    threading.Thread(target=_watch, args=(int(os.environ.get(CHILD) or 0),), daemon=True).start()


def _watch(parent: int) -> None:
    while sys.platform == "win32" or os.getppid() == parent:  # Windows keeps the number of an ended parent
        time.sleep(WATCHED_S)
    os._exit(1)
