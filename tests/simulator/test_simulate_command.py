from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from tests.end_to_end.commands import turnscope


def test_simulate_writes_the_columns_of_the_contract(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    done = turnscope(
        *("simulate", "--robot", "barrel", "--left", "33.3", "--right", "14.4", "--duration", "2", "-o", str(path))
    )
    assert done.returncode == 0, done.stderr
    table = pd.read_csv(path)
    start = ["time_s", "x_mm", "y_mm", "heading_deg", "u_mm_s", "v_mm_s", "yaw_rate_deg_s"]
    assert list(table.columns[:7]) == start
    assert len(table.columns) == 7 + 16
    assert len(table) == 121
    assert table["heading_deg"].iloc[-1] < 0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--robot", "barel", "--left", "1", "--right", "1", "--duration", "1"], "no such robot"),
        (["--robot", "barrel", "--left", "1", "--duration", "1"], "--right"),
        (["--robot", "barrel", "--left", "1", "--right", "1", "--duration", "-1"], "positive"),
        (["--robot", "nowhere.toml", "--left", "1", "--right", "1", "--duration", "1"], "no such file"),
    ],
)
def test_bad_input_is_one_sentence_and_status_2(tmp_path: Path, arguments: list[str], said: str) -> None:
    done = turnscope("simulate", *arguments, "-o", str(tmp_path / "run.csv"))
    assert done.returncode == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "run.csv").exists()
