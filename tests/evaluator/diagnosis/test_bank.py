"""The blind bank draws what it says: shifts of the marks, and more runs of the same robot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from evaluator.settings import load_experiment
from tests.bank.draw import Drawn, draw, repeated


@pytest.fixture
def late(tmp_path: Path) -> Drawn:
    """An experiment whose clock is wrong."""
    return draw(np.random.default_rng(4), "single", tmp_path / "late", "time-base")


def test_a_wrong_clock_shifts_marks_by_how_far_the_robot_gets_in_the_seconds_it_errs(late: Drawn) -> None:
    share = late.label["effects"]["time-base"]["factor"] - 1
    run = load_experiment(late.folder / "experiment.toml").run[0]  # straight
    assert run.marks is not None
    marks = pd.read_csv(run.marks).to_numpy()
    speed = np.hypot(*(marks[-1, 1:3] - marks[marks[:, 0] > run.start_s][0, 1:3]))
    speed /= marks[-1, 0] - run.start_s
    shift = np.hypot(*late.label["shifts"]["time-base"][0][-1, :2])
    assert shift == pytest.approx(speed * abs(share) * marks[-1, 0], rel=0.02)


def test_a_proposed_run_is_made_by_the_same_robot_and_appended(late: Drawn) -> None:
    run = {"left_rpm": 30.0, "right_rpm": 20.0, "heading_deg": 90.0, "x_mm": 4.0, "y_mm": 1.0, "duration_s": 5.0}
    before = load_experiment(late.folder / "experiment.toml").run
    wider = repeated(np.random.default_rng(1), late, [{**run, "times": 2}])
    after = load_experiment(late.folder / "experiment.toml").run
    assert len(after) == len(before) + 2
    assert after[-1].marks is not None
    first = pd.read_csv(after[-1].marks).iloc[0]
    assert np.hypot((first["green_x_mm"] + first["yellow_x_mm"]) / 2 - 4.0, first["green_y_mm"] - 1.0) < 6.0
    assert (after[-1].left_rpm, after[-1].right_rpm) == (30.0, 20.0)
    assert len(wider.label["shifts"]["time-base"]) == len(after)
