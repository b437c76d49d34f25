"""How long work tells how far it is, without knowing who listens."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[int, int], None]
"""Called with (done, total) as work advances."""


def no_progress(done: int, total: int) -> None:
    """Nobody listens."""
    del done, total
