"""What a script of three lines calls, from its first line to its last, once."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from tests.evaluator.diagnosis.hidden import write_hidden
from tests.waiting import HANGS_S

ANALYSIS = """
from evaluator import analyze
print("begun")
done = analyze({experiment!r}, {out!r}, workers=2)
print(len(done.turning))
"""
# As where there is no fork server. What the processes do is small: to import what an analysis needs takes most of it.
SPAWNED = """
import evaluator.workflow.execution.machine as machine
from evaluator.workflow.execution.answers import answers_of
machine.PROCESSES = machine.Spawning()
print("begun")
with answers_of(abs, [-1, 2], workers=2, when_killed=print) as answers:
    print(len(dict(answers)))
"""


def said_by(script: Path, text: str) -> tuple[str, str]:
    script.write_text(text, encoding="utf-8")
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=HANGS_S, check=False)
    return done.stdout, done.stderr


def test_processes_do_not_run_a_script_without_a_guard_again(tmp_path: Path) -> None:
    experiment = write_hidden(tmp_path, {}, commands=[(30.0, 15.0)] * 2, seconds=2.0)
    text = ANALYSIS.format(experiment=str(experiment), out=str(tmp_path / "out"))
    assert said_by(tmp_path / "study.py", text) == ("begun\n2\n", "")


def test_processes_that_are_spawned_do_not_run_it_again_either(tmp_path: Path) -> None:
    assert said_by(tmp_path / "study.py", SPAWNED) == ("begun\n2\n", "")
