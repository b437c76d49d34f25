"""What turnscope writes it reads again, and writes again in the same bytes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from evaluator.files.csv_tables import write_table
from evaluator.interchange.poses import read_poses
from evaluator.marks import read_marks, write_marks
from simulator.command import Command
from simulator.robot import load_robot
from simulator.simulation import simulate


@pytest.mark.parametrize("seed", range(5))
def test_marks_written_and_read_are_the_same_numbers_gaps_and_words(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    table = pd.DataFrame({"frame": np.arange(40), "time_s": np.cumsum(rng.uniform(1e-4, 10.0, 40))})
    for name in ("green", "gelb é 運転"):
        seen = rng.random(40) > 0.2
        for axis in "xy":
            values = rng.normal(size=40) * 10.0 ** rng.uniform(-12, 8, 40)
            table[f"{name}_{axis}_mm"] = np.where(seen, values, np.nan)
        table[f"{name}_status"] = np.where(seen, "ok", "covered, by a wire")
    write_marks(table, tmp_path / "a.csv")
    read = read_marks(tmp_path / "a.csv")
    write_marks(read, tmp_path / "b.csv")
    pd.testing.assert_frame_equal(read, table, rtol=1e-8, atol=0.0, check_dtype=False)
    assert (tmp_path / "b.csv").read_bytes() == (tmp_path / "a.csv").read_bytes()


def test_a_simulated_run_is_read_as_poses_of_the_same_path(tmp_path: Path) -> None:
    run = simulate(load_robot("barrel"), Command.constant(14.4, 33.3), np.linspace(0.0, 2.0, 61))
    write_table(run.to_table(), tmp_path / "run.csv")
    read = read_poses(tmp_path / "run.csv").table
    np.testing.assert_allclose(read["x_mm"], run.x_mm, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(read["heading_deg"], np.degrees(run.heading_rad), rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_a_log_of_commands_is_read_with_its_jumps(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    times = np.sort(np.repeat(rng.uniform(-5.0, 1e4, 20).round(6), 2))
    sides = rng.uniform(-1e4, 1e4, (2, 40)).round(3)
    write_table(pd.DataFrame({"time_s": times, "left_rpm": sides[0], "right_rpm": sides[1]}), tmp_path / "log.csv")
    read = Command.held(tmp_path / "log.csv")
    np.testing.assert_allclose(read.knots[1::2], np.column_stack([times, *sides]), rtol=1e-8)
