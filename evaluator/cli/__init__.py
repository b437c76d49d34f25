"""The command line. Each command's module is imported only when it runs, so that help is instant."""

from __future__ import annotations

import gc
import os
import sys

__all__ = ["main"]

# Python collects garbage after every 700 new objects. Imports and compilation create a hundred thousand permanent ones;
# examining them again and again took an eighth of the processor time of a short command.
NEW_OBJECTS = 50_000


def main() -> None:
    """Run the command line; a user's error is one sentence on standard error and exit status 2."""
    _open_closed_streams()
    from evaluator.cli.guard import CHILD, live_as_child, needs_child, run_in_child

    if needs_child(sys.argv[1:]):
        sys.exit(run_in_child(sys.argv[1:]))
    if CHILD in os.environ:
        live_as_child()
        del os.environ[CHILD]  # processes started from here are not children of that parent
    gc.set_threshold(NEW_OBJECTS)
    from evaluator.cli.failures import run_safely
    from evaluator.cli.group import turnscope

    sys.exit(run_safely(turnscope))


def _open_closed_streams() -> None:
    """Open the standard streams that are closed, as those of a service may be, on the null device.

    Otherwise the next file that is opened gets the number of one, and messages of native libraries are written into it.
    """
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(number, True)  # workers need them, too
    os.close(number)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115, PTH123  # open to the end
