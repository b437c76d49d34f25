"""Undo and redo of what the studio wrote, file by file, as long as nobody else has written since."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import Literal

from evaluator.errors import InputError
from evaluator.workflow import replace_text, version_of

MOST_STEPS = 200  # of one file


@dataclass
class _Steps:
    """Texts to go back to and forward to."""

    undo: list[str] = field(default_factory=list)
    redo: list[str] = field(default_factory=list)


class History:
    """The texts that files had before the studio changed them."""

    def __init__(self) -> None:
        """Nothing was changed yet."""
        self._steps: dict[Path, _Steps] = {}
        self._lock = Lock()

    def record(self, path: Path, change: Callable[[], object]) -> None:
        """Make a change, and remember what was there before it."""
        with self._lock:
            before = path.read_text(encoding="utf-8")
            change()
            steps = self._steps.setdefault(path, _Steps())
            steps.undo = [*steps.undo, before][-MOST_STEPS:]
            steps.redo = []

    def step(self, path: Path, version: str, way: Literal["undo", "redo"]) -> None:
        """Go one step back or forward. Raises ChangedMeanwhileError, and InputError where there is no step."""
        with self._lock:
            steps = self._steps.setdefault(path, _Steps())
            source, target = (steps.undo, steps.redo) if way == "undo" else (steps.redo, steps.undo)
            if not source:
                raise InputError(f"there is nothing to {way}")
            before = path.read_text(encoding="utf-8")
            if version_of(path) == version:
                target.append(before)
            replace_text(path, version, source[-1])
            source.pop()

    def count(self, path: Path) -> dict[str, int]:
        """How many steps there are each way."""
        steps = self._steps.get(path, _Steps())
        return {"undo": len(steps.undo), "redo": len(steps.redo)}
