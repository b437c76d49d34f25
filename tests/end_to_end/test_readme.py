"""What the README shows runs as it stands."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
EXAMPLES = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), flags=re.DOTALL)


def test_there_are_three_examples() -> None:
    assert len(EXAMPLES) >= 3


@pytest.mark.parametrize("number", range(len(EXAMPLES)))
def test_example_runs_and_prints(number: int, capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(EXAMPLES[number], f"README example {number + 1}", "exec"), {})  # noqa: S102 - our own README
    assert capsys.readouterr().out.strip()


@pytest.mark.parametrize("package", ["calibration", "simulator", "evaluator"])
def test_every_public_name_is_there_and_importing_the_package_is_light(package: str) -> None:
    code = (
        f"import sys, {package}; assert not {{'numpy', 'pandas', 'numba'}} & set(sys.modules);"
        f"[getattr({package}, name) for name in {package}.__all__]"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
