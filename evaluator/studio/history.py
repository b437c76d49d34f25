"""Undo and redo of the studio's changes, unless the files have been changed by others since.

A change of several files (a robot and the experiment that names it) is undone as a unit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any, Literal

from evaluator.errors import InputError
from evaluator.files import write_bytes
from evaluator.workflow import ChangedMeanwhileError

MOST_BYTES = 200_000_000  # of stored texts and images; the oldest changes are dropped first
Touches = Callable[[Path], bool]


@dataclass(frozen=True)
class _Change:
    """Description of a change, and contents of its files before and after it; None for a missing file."""

    number: int
    words: str
    before: dict[Path, bytes | None]
    after: dict[Path, bytes | None]

    @property
    def size(self) -> int:
        return sum(len(content or b"") for content in (*self.before.values(), *self.after.values()))


class History:
    """Contents of files before and after the changes of the studio."""

    def __init__(self) -> None:
        """No changes yet."""
        self._count = 0
        self._done: list[_Change] = []
        self._undone: list[_Change] = []
        self._lock = Lock()

    def record(self, files: Sequence[Path], words: str, change: Callable[[], object]) -> None:
        """Make a change to files, and store their previous contents; words: such as "the colours of the marks"."""
        with self._lock:
            before = {path: _content(path) for path in files}
            change()
            self._note(words, before)

    def watch(self, files: Sequence[Path], words: str) -> Callable[[], None]:
        """Store the present contents of files; call the returned function after a job or the like has changed them."""
        before = {path: _content(path) for path in files}

        def changed() -> None:
            with self._lock:
                self._note(words, before)

        return changed

    def _note(self, words: str, before: dict[Path, bytes | None]) -> None:
        after = {path: _content(path) for path in before}
        if after == before:
            return
        self._count += 1
        self._done.append(_Change(self._count, words, before, after))
        self._undone = [other for other in self._undone if not before.keys() & other.before.keys()]
        while len(self._done) > 1 and sum(one.size for one in self._done) > MOST_BYTES:
            del self._done[0]

    def step(self, touches: Touches, way: Literal["undo", "redo"], number: int) -> str:
        """Undo or redo the last change of the files selected by touches; return its description.

        number: of the intended change, from `next_steps`. Raises ChangedMeanwhileError if it is no longer the last one
        or the files have been changed by others, InputError if there is no change.
        """
        with self._lock:
            source, target = (self._done, self._undone) if way == "undo" else (self._undone, self._done)
            found = _last(source, touches)
            if found is None:
                raise InputError(f"there is nothing to {way}")
            if found.number != number:
                raise ChangedMeanwhileError(f"something was changed meanwhile, in another tab: look before you {way}")
            there, wanted = (found.after, found.before) if way == "undo" else (found.before, found.after)
            for path, content in there.items():
                if _content(path) != content:
                    raise ChangedMeanwhileError(
                        f"{path.name} was changed since, on another screen or by another program; to {way} this "
                        "would lose that change"
                    )
            for path, content in wanted.items():
                path.unlink(missing_ok=True) if content is None else write_bytes(path, content)
            source.remove(found)
            target.append(found)
            return found.words

    def next_steps(self, touches: Touches) -> dict[str, Any]:
        """Number and description of the changes that would be undone and redone; None if there is none."""
        with self._lock:
            found = {"undo": _last(self._done, touches), "redo": _last(self._undone, touches)}
        return {way: change and {"number": change.number, "words": change.words} for way, change in found.items()}


def _last(changes: list[_Change], touches: Touches) -> _Change | None:
    return next((one for one in reversed(changes) if any(map(touches, one.before))), None)


def _content(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except FileNotFoundError:
        return None
