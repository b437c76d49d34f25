"""Undo and redo of the studio's changes, as long as nobody else has changed the files since.

A change may touch several files (a robot and the experiment that names it): it is undone as one.
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

MOST_BYTES = 200_000_000  # of texts and images remembered: the oldest changes go first
Touches = Callable[[Path], bool]


@dataclass(frozen=True)
class _Change:
    """What a change was, in words, and what its files held before and after it; None where there was no file."""

    number: int
    words: str
    before: dict[Path, bytes | None]
    after: dict[Path, bytes | None]

    @property
    def size(self) -> int:
        return sum(len(content or b"") for content in (*self.before.values(), *self.after.values()))


class History:
    """What files held before the studio changed them."""

    def __init__(self) -> None:
        """Nothing was changed yet."""
        self._count = 0
        self._done: list[_Change] = []
        self._undone: list[_Change] = []
        self._lock = Lock()

    def record(self, files: Sequence[Path], words: str, change: Callable[[], object]) -> None:
        """Make a change to some files, and remember what they held before; words: "the colours of the marks"."""
        with self._lock:
            before = {path: _content(path) for path in files}
            change()
            self._note(words, before)

    def watch(self, files: Sequence[Path], words: str) -> Callable[[], None]:
        """Remember what some files hold now; what is given is to be called after somebody, a job say, changed them."""
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
        """Take the last change back, or make it again, that touched files of a kind; gives what it was, in words.

        number: of the change that is meant, as `next_steps` gave it. Raises ChangedMeanwhileError where that is not the
        last one any more or somebody else has written since, InputError where there is no change.
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
        """Number and words of what would be undone and redone; None where there is nothing."""
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
