"""What a script of three lines calls, from its first line to its last, once."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.waiting import HANGS_S

# What the processes do is small: to import what an analysis needs would take most of the time.
BY_DEFAULT = """
from evaluator.workflow.execution.answers import answers_of
print("begun")
with answers_of(abs, [-1, 2], workers=2, when_killed=print) as answers:
    print(len(dict(answers)))
"""
SPAWNED = (
    """
import evaluator.workflow.execution.machine as machine
machine.PROCESSES = machine.Spawning()  # as where there is no fork server
"""
    + BY_DEFAULT
)


def said_by(script: Path, text: str) -> tuple[str, str]:
    script.write_text(text, encoding="utf-8")
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=HANGS_S, check=False)
    return done.stdout, done.stderr


@pytest.mark.parametrize("text", [BY_DEFAULT, SPAWNED])
def test_processes_do_not_run_a_script_without_a_guard_again(text: str, tmp_path: Path) -> None:
    assert said_by(tmp_path / "study.py", text) == ("begun\n2\n", "")
