"""Runs of several motions: every phase is found and measured, and the whole has no numbers that mean nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from evaluator.cli.measurement.turning import turning as command
from evaluator.marks import write_marks

from .synthetic import FRAME_S, arc_poses, marks_of, measured, resting, straight_poses, winding_poses

STEP_MM = 0.1


def square(side_mm: float, corner_mm: float, sides: int = 4) -> np.ndarray:
    side = np.zeros(round(side_mm / STEP_MM))
    corner = np.full(round(corner_mm * np.pi / 2 / STEP_MM), 1 / corner_mm)
    return winding_poses(np.concatenate([side, corner] * sides), STEP_MM)


@pytest.mark.parametrize("side_mm", [10.0, 20.0, 60.0])
def test_corners_of_a_square_are_found_and_each_is_measured(side_mm: float) -> None:
    run = measured(square(side_mm, 5.0))
    assert [phase.kind for phase in run.phases if phase.kind != "transient"] == ["straight", "turn"] * 4
    for phase in run.phases:
        if phase.kind == "turn":
            assert phase.radius_mm == pytest.approx(5.0, rel=0.02)
            assert phase.turned_deg == pytest.approx(90, abs=6)
        if phase.kind == "straight":
            assert np.isnan(phase.radius_mm)
        if phase.kind != "transient":
            assert phase.speed_mm_s == pytest.approx(STEP_MM / FRAME_S, rel=0.01)


def test_run_of_several_motions_has_no_whole_radius_and_no_whole_speed_but_a_reason() -> None:
    run = measured(square(20.0, 5.0))
    assert run.radius_status == "several motions (4 straight, 4 turn): no single radius or speed; see the phases"
    assert np.isnan([run.radius_mm, run.steady_radius_mm, run.speed_mm_s, run.yaw_rate_deg_s]).all()


def test_interval_of_a_corner_holds_its_radius_as_often_as_it_says() -> None:
    turns = [phase for seed in range(10) for phase in measured(square(20.0, 5.0), seed=seed).phases]
    turns = [phase for phase in turns if phase.kind == "turn"]
    held = sum(phase.radius_low_mm <= 5.0 <= phase.radius_high_mm for phase in turns)
    assert len(turns) == 40
    assert held >= 33  # binomial (40, 0.95): below once in 1,000


def test_turns_to_both_sides_and_forward_and_back_are_different_motions() -> None:
    both = measured(winding_poses(np.r_[np.full(150, 0.2), np.full(150, -0.2)], STEP_MM))
    assert "several motions (2 turn)" in both.radius_status
    turns = [phase.turned_deg for phase in both.phases if phase.kind == "turn"]
    assert turns[0] > 100
    assert turns[1] < -100
    there = arc_poses(5.0, 180, 200)
    back = measured(np.concatenate([there, there[::-1]]))
    assert "several motions (2 turn)" in back.radius_status
    assert [phase.speed_mm_s > 0 for phase in back.phases if phase.kind == "turn"] == [True, False]


def test_rest_and_turn_on_the_spot_are_kinds_of_their_own() -> None:
    rested = measured(resting(arc_poses(5.0, 360, 300), 60, 60))
    assert [phase.kind for phase in rested.phases] == ["rest", "turn", "rest"]
    assert rested.phases[1].start_s == pytest.approx(60 * FRAME_S, abs=0.1)
    assert rested.radius_status == "ok"
    (spot,) = measured(arc_poses(1e-4, 720, 400)).phases
    assert spot.kind == "spot"
    assert abs(spot.speed_mm_s) < 0.05


@pytest.mark.parametrize(
    ("radius_mm", "turned_deg", "frames", "sigma_mm", "correlation"),
    [(5.0, 180, 120, 0.01, 0.8), (100.0, 15, 120, 0.01, 0.0), (5.0, 80, 120, 0.1, 0.0), (2.5, 720, 600, 0.05, 0.9)],
)
def test_noise_makes_no_phases(
    radius_mm: float,
    turned_deg: float,
    frames: int,
    sigma_mm: float,
    correlation: float,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stop_there = "evaluator.turning.measure.several_motions"  # the fits after it take five times as long
    monkeypatch.setattr(stop_there, lambda *_: "its phases are enough")
    for seed in range(8):
        run = measured(arc_poses(radius_mm, turned_deg, frames), sigma_mm, seed, correlation)
        assert [phase.kind for phase in run.phases if phase.kind != "rest"] == ["turn"]


def test_radius_that_changes_little_by_little_is_one_motion() -> None:
    run = measured(winding_poses(np.linspace(0.33, 0.125, 600), STEP_MM))
    assert {phase.kind for phase in run.phases} == {"turn"}
    assert run.radius_status.startswith("varies")


def test_straight_run_with_a_short_turn_at_its_end_is_straight_unless_the_turn_is_one_to_speak_of() -> None:
    little = np.r_[np.zeros(600), np.full(20, 0.1)]  # 11 degrees in 3 % of the run
    assert "several" not in measured(winding_poses(little, STEP_MM)).radius_status
    corner = np.r_[np.zeros(600), np.full(60, 0.2)]  # 69 degrees in 9 %
    assert "several motions (1 straight, 1 turn)" in measured(winding_poses(corner, STEP_MM)).radius_status


def test_command_prints_and_writes_the_phases(tmp_path: Path) -> None:
    write_marks(marks_of(square(20.0, 5.0), 0.01, np.random.default_rng(0)), tmp_path / "square.csv")
    write_marks(marks_of(straight_poses(30.0, 200), 0.01, np.random.default_rng(0)), tmp_path / "line.csv")
    paths = [str(tmp_path / name) for name in ("square.csv", "line.csv")]
    output = tmp_path / "phases.csv"
    result = CliRunner().invoke(command, [*paths, "--robot", "barrel", "--phases", str(output)])
    assert result.output.count(": turn, radius 5.0") + result.output.count(": turn, radius 4.99") == 4
    table = pd.read_csv(output)
    assert list(table) == [
        *("run", "start_s", "stop_s", "kind", "radius_mm", "radius_low_mm", "radius_high_mm"),
        *("speed_mm_s", "turned_deg"),
    ]
    assert table[table["run"] == "line"]["kind"].tolist() == ["straight"]
