"""A child process that answers requests, so that damaged media crash at most that process."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from threading import Lock
from typing import Any

from calibration.errors import CalibrationError
from evaluator.errors import InputError
from evaluator.workflow.execution.machine import PROCESSES

Answer = Callable[..., Any]


@dataclass
class Child:
    """A process that is started by the first request, and again after it ended.

    maker: a function of a module that is called in the process with arguments and returns the function that answers
    requests. answer_s: timeout of an answer. slow, died: messages if an answer takes longer, or if the process dies.
    idle_s: time without requests after which the process ends; None: never.
    """

    maker: Callable[..., Answer]
    arguments: tuple[Any, ...]
    answer_s: float
    slow: str
    died: str
    idle_s: float | None = None
    _lock: Lock = field(default_factory=Lock)
    _process: Any = None
    _pipe: Connection | None = None

    def start(self) -> None:
        """Start the process before the first request."""
        with self._lock:
            self._running()

    def ask(self, *question: Any) -> Any:
        """Answer of the process to a request. Raises InputError."""
        with self._lock:
            pipe = self._running()
            try:
                pipe.send(question)
                if not pipe.poll(self.answer_s):
                    self._end()
                    raise InputError(self.slow)
                good, answer = pipe.recv()
            except (EOFError, OSError) as error:
                self._end()
                raise InputError(self.died) from error
        if not good:
            raise InputError(answer)
        return answer

    def close(self) -> None:
        """End the process."""
        with self._lock:
            self._end()

    @property
    def process_id(self) -> int | None:
        """Id of the running process."""
        return None if self._process is None else self._process.pid

    def _running(self) -> Connection:
        if self._pipe is None or not self._process.is_alive():
            self._end()
            self._pipe, theirs = PROCESSES.Pipe()
            arguments = (theirs, self.idle_s, self.maker, self.arguments)
            self._process = PROCESSES.Process(target=_serve, args=arguments, daemon=True, name="turnscope media")
            self._process.start()
            theirs.close()
        return self._pipe

    def _end(self) -> None:
        if self._pipe is not None:
            self._pipe.close()
            self._process.kill()
            self._process.join()
        self._pipe = self._process = None


def _serve(pipe: Connection, idle_s: float | None, maker: Callable[..., Answer], arguments: tuple[Any, ...]) -> None:
    """Answer requests until the other end is closed or the process is idle."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the studio handles an interrupt from the terminal
    answers = maker(*arguments)
    while pipe.poll(idle_s):
        try:
            question = pipe.recv()
        except EOFError:
            return
        try:
            answer = True, answers(*question)
        except (InputError, CalibrationError) as error:
            answer = False, str(error)
        except Exception as error:  # noqa: BLE001 - any fault of media is reported, and further requests are answered
            answer = False, f"decoding failed ({type(error).__name__}: {error})"
        pipe.send(answer)
