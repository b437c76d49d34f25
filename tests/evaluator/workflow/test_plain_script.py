"""What a script of three lines calls, from its first line to its last, once."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.evaluator.diagnosis.hidden import write_hidden
from tests.waiting import HANGS_S

SCRIPT = """
from evaluator import analyze
print("begun")
done = analyze({experiment!r}, {out!r}, workers=2)
print(len(done.turning))
"""


@pytest.mark.parametrize("method", ["forkserver", "spawn"])
def test_processes_do_not_run_a_script_without_a_guard_again(tmp_path: Path, method: str) -> None:
    experiment = write_hidden(tmp_path, {}, commands=[(30.0, 15.0)] * 2, seconds=2.0)
    script = tmp_path / "study.py"
    text = SCRIPT.format(experiment=str(experiment), out=str(tmp_path / "out"))
    elsewhere = "import evaluator.workflow.execution.machine as m; m._POOLING = m.SPAWNING\n" * (method == "spawn")
    script.write_text(elsewhere + text, encoding="utf-8")
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=HANGS_S, check=False)
    assert (done.stdout, done.stderr) == ("begun\n2\n", "")
