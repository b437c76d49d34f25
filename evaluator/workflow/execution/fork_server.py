"""Loaded by the fork server before the libraries, and by no other process."""

from __future__ import annotations

import sys
from types import TracebackType


def hook(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Print an error that the fork server did not expect.

    Whoever is interrupted while it starts a process sends half of a request, or none. The command that was interrupted
    says so itself.
    """
    if not issubclass(kind, EOFError):
        sys.__excepthook__(kind, error, trace)


sys.excepthook = hook
