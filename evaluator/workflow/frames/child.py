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
    """A process that is started when it is first asked, and anew after it ended.

    maker: a function of a module; the process calls it with arguments, and what it gives answers every question.
    answer_s: the longest wait for an answer. slow, died: what is said where it takes longer, or ends meanwhile.
    idle_s: without a question for so long it ends; None: never.
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
        """Of the running process."""
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
    """Answer questions until the other end is closed or nothing is asked any more."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interrupt from the terminal is for the studio
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
        except Exception as error:  # noqa: BLE001 - any fault of media is told, and the next question is answered
            answer = False, f"decoding failed ({type(error).__name__}: {error})"
        pipe.send(answer)
