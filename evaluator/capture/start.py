"""Start signals sent to or received from the motors, with the time on the computer's clock."""

from __future__ import annotations

import shlex
import subprocess
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TextIO

from evaluator.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence


@dataclass(frozen=True)
class Ready:
    """A prepared signal: how to send it, its time by time.perf_counter in s (None before), and why it failed, if so."""

    send: Callable[[], None] = lambda: None
    moment: Callable[[], float | None] = lambda: None
    fault: Callable[[], str] = lambda: ""


Signal = Callable[[], Ready]  # prepares it: opens ports, finds programs


def line_on(stream: TextIO) -> Signal:
    """Start signal: a line on a text stream."""

    def prepare() -> Ready:
        seen: list[float] = []

        def wait() -> None:
            if stream.readline():
                seen.append(time.perf_counter())

        threading.Thread(target=wait, daemon=True).start()
        return Ready(moment=lambda: seen[0] if seen else None)

    return prepare


def program(command: str) -> Signal:
    """Start signal: the start of a program of the user that starts the motors. Raises InputError if there is none."""

    def prepare() -> Ready:
        import shutil

        words: Sequence[str] = shlex.split(command)
        if not words or shutil.which(words[0]) is None:
            raise InputError(f"--start-program {command}: no such program; give its path and its arguments")

        started: list[subprocess.Popen[bytes]] = []

        def run() -> None:
            started.append(subprocess.Popen(words, stdin=subprocess.DEVNULL))  # noqa: S603  # the user's own program

        def fault() -> str:
            status = started[0].poll() if started else None
            return f"{command} ended with status {status}; did it start the motors?" if status else ""

        return replace(_once(run), fault=fault)

    return prepare


def serial_command(port: str, text: str, baud: int = 115200) -> Signal:
    """Start signal: the time at which the last byte of a command was passed to a serial port.

    Raises InputError if the port cannot be opened or pyserial is missing.
    """

    def prepare() -> Ready:
        try:
            import serial  # type: ignore[import-untyped, import-not-found, unused-ignore]
        except ImportError as error:
            raise InputError("--start-serial needs pyserial: pip install 'turnscope[record]'") from error
        try:
            opened = serial.Serial(port, baud, timeout=1)
        except (OSError, ValueError) as error:
            raise InputError(f"--start-serial {port}: cannot be opened ({error})") from error

        def send() -> None:
            opened.write(text.encode().decode("unicode_escape").encode("latin-1"))
            opened.flush()

        return _once(send)

    return prepare


def _once(action: Callable[[], Any]) -> Ready:
    """Do the action on the first call; its time is the middle of its execution."""
    done: list[float] = []

    def send() -> None:
        if not done:
            before = time.perf_counter()
            action()
            done.append((before + time.perf_counter()) / 2)

    return Ready(send, lambda: done[0] if done else None)
