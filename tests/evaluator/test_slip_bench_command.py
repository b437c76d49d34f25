"""turnscope slip-bench from the shell."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from evaluator.cli.failures import run_safely
from evaluator.cli.group import turnscope
from simulator.robot import load_robot
from simulator.slip.bench import virtual_bench


def test_slip_bench_turns_a_recording_into_forces_law_and_images(tmp_path: Path) -> None:
    virtual_bench(load_robot("column").slip, np.random.default_rng(2)).to_csv(tmp_path / "bench.csv", index=False)
    run = CliRunner().invoke(turnscope, ["slip-bench", str(tmp_path / "bench.csv"), "-o", str(tmp_path / "out")])
    assert run.exit_code == 0, run.output
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "forces.csv", "slip.toml", "slip-a.svg", "slip-b.svg", "index.html",
    }  # fmt: skip
    forces = pd.read_csv(tmp_path / "out" / "forces.csv")
    assert len(forces) == 8 * 17
    assert "longitudinal friction" in run.output


@pytest.mark.parametrize("text", ["", "a,b\n1,2\n", "slip_angle_deg\n"])
def test_what_is_no_recording_leaves_one_sentence_and_no_files(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "bench.csv"
    path.write_text(text)
    monkeypatch.setattr("sys.argv", ["turnscope", "slip-bench", str(path), "-o", str(tmp_path / "out")])
    assert run_safely(turnscope) == 2
    message = capsys.readouterr().err
    assert message.startswith(f"error: {path}: ")
    assert message.count("\n") == 1
    assert not (tmp_path / "out").exists()
