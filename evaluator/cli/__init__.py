"""The command line. Each command's module is imported only when it runs, so that help is instant."""

from __future__ import annotations

import gc
import os
import sys

__all__ = ["main"]

# Python looks for garbage after every 700 new objects; imports and compiling make a hundred thousand that stay, and
# looking through them again and again took an eighth of the processor time of a short command.
NEW_OBJECTS = 50_000


def main() -> None:
    """Run the command line; a user's error is one sentence on standard error and exit status 2."""
    from evaluator.cli.guard import CHILD, live_as_child, needs_child, run_in_child

    if needs_child(sys.argv[1:]):
        sys.exit(run_in_child(sys.argv[1:]))
    if CHILD in os.environ:
        live_as_child()
        del os.environ[CHILD]  # what this process starts in its turn is no child of that parent
    gc.set_threshold(NEW_OBJECTS)
    from evaluator.cli.failures import run_safely
    from evaluator.cli.group import turnscope

    sys.exit(run_safely(turnscope))
