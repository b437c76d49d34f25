from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from click.testing import CliRunner

from evaluator.cli.turning import turning
from evaluator.marks import write_marks

from .synthetic import arc_poses, marks_of, straight_poses


def test_command_says_and_writes_the_radius_of_every_table(tmp_path: Path) -> None:
    paths = [tmp_path / "circle.csv", tmp_path / "straight.csv"]
    for path, poses in zip(paths, (arc_poses(5.0, 360, 200), straight_poses(30.0, 200)), strict=True):
        write_marks(marks_of(poses, 0.005, np.random.default_rng(0)), path)
    output = tmp_path / "turning.csv"
    arguments = [*map(str, paths), "--robot", "barrel", "--left-rpm", "33", "--right-rpm", "14", "-o", str(output)]
    run = CliRunner().invoke(turning, arguments, catch_exceptions=False)
    assert run.exit_code == 0
    assert "radius 5.00" in run.output
    assert "straight: curvature" in run.output
    table = pd.read_csv(output).set_index("run")
    assert table.loc["circle", "radius_low_mm"] < 5.0 < table.loc["circle", "radius_high_mm"]
    assert np.isnan(table.loc["straight", "radius_mm"])
    assert np.isfinite(table.loc["circle", "front_left_slip_ratio"])
