"""The command line. Each command's module is imported only when it runs, so that help is instant."""

from __future__ import annotations

import sys

from evaluator.cli.group import turnscope

__all__ = ["main"]


def main() -> None:
    """Run the command line; a user's error is one sentence on standard error and exit status 2."""
    from evaluator.cli.failures import run_safely

    sys.exit(run_safely(turnscope))
