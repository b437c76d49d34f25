"""Run the command line as a user does, and see what a user sees."""

from __future__ import annotations

import contextlib
import io
import os
import subprocess
import sys
from pathlib import Path
from unittest import mock

from evaluator.cli.failures import run_safely
from evaluator.cli.group import turnscope as group

ROOT = Path(__file__).parents[2]


def turnscope(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run a command in this process, which saves the imports."""
    command, said, told = ["turnscope", *map(str, arguments)], io.StringIO(), io.StringIO()
    with (
        mock.patch.object(sys, "argv", command),
        contextlib.redirect_stdout(told),
        contextlib.redirect_stderr(said),
    ):
        status = run_safely(group)
    return subprocess.CompletedProcess(command, status, told.getvalue(), said.getvalue())


def turnscope_process(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run a command in a process of its own, as a terminal does."""
    return subprocess.run(
        [sys.executable, "-m", "evaluator", *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
        timeout=420,  # the first command of a fresh clone compiles, beside the other worker
    )


def assert_refused(done: subprocess.CompletedProcess[str], *words: str) -> None:
    """Exit status 2, one line on standard error that holds the words, no traceback."""
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1, done.stderr
    for word in words:
        assert word in lines[0], lines[0]
