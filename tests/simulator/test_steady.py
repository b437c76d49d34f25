"""Steady turns: against integration and over every ratio."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from evaluator.cli.group import turnscope
from simulator.command import Command
from simulator.effects.entry import EffectEntry
from simulator.robot import load_robot
from simulator.simulation import simulate
from simulator.steady import steady_map, steady_turn, steady_turns


@pytest.mark.parametrize("ratio", [0.9, 0.5, 0.1, 0.0, -0.3, -0.9])
def test_steady_turn_is_where_integration_ends(ratio: float) -> None:
    robot = load_robot("barrel")
    run = simulate(robot, Command.constant(30.0, 30.0 * ratio), np.linspace(0.0, 3.0, 4))
    turn = steady_turn(robot, 30.0, 30.0 * ratio)
    assert turn.stable
    assert run.yaw_rate_rad_s[-1] == pytest.approx(turn.yaw_rate_rad_s, rel=1e-7)
    assert run.u_mm_s[-1] == pytest.approx(turn.u_mm_s, rel=1e-7, abs=1e-9)


@pytest.mark.parametrize(("left_rpm", "right_rpm"), [(14.0, 30.0), (30.0, 14.0), (-14.0, -30.0), (-30.0, -14.0)])
def test_radius_is_positive_where_the_centre_is_to_the_left_forward_and_backward(
    left_rpm: float, right_rpm: float
) -> None:
    turn = steady_turn(load_robot("barrel"), left_rpm, right_rpm)
    left_mm = turn.u_mm_s / turn.yaw_rate_rad_s  # of the instantaneous centre in the body frame
    assert (left_mm > 0) == (abs(right_rpm) > abs(left_rpm))
    assert turn.radius_mm == pytest.approx(np.copysign(turn.speed_mm_s / abs(turn.yaw_rate_rad_s), left_mm))
    again = steady_map(load_robot("barrel"), [left_rpm], [right_rpm / left_rpm])
    assert again.curvature_per_mm[0, 0] == pytest.approx(1 / turn.radius_mm, rel=1e-6)


def test_forces_balance_and_wheels_are_reported() -> None:
    robot = load_robot("barrel")
    turn = steady_turn(robot, 30.0, 12.0)
    x, y = robot.wheel_positions_mm().T
    along, across = 1000 * turn.wheels.longitudinal_force_mN, 1000 * turn.wheels.lateral_force_mN
    inertia = robot.body.mass_g * turn.yaw_rate_rad_s * np.array([turn.v_mm_s, -turn.u_mm_s])
    assert np.abs(np.array([along.sum(), across.sum()]) + inertia).max() < 1e-6
    assert abs((x * across - y * along).sum()) < 1e-6
    assert np.all(turn.wheels.slip_ratio[2:] == 0)


@pytest.mark.parametrize("name", ["tire", "barrel", "column"])
def test_map_is_complete_from_straight_to_opposed_wheels_and_scale_free(name: str) -> None:
    found = steady_map(load_robot(name), [20.0, 50.0], np.linspace(1.0, -0.9, 39))
    assert not np.isnan(found.yaw_rate_rad_s).any()
    if name == "barrel":
        # A law that is normalized by load knows no speed (Figure 14); inertia is what differs.
        assert np.allclose(found.curvature_per_mm[0], found.curvature_per_mm[1], rtol=2e-3, atol=1e-9)
        assert np.all(np.diff(found.curvature_per_mm[0][found.ratio > 0.05]) < 0)


def test_several_balances_of_the_tire_in_opposition_are_found_and_told_apart() -> None:
    turns = steady_turns(load_robot("tire"), 30.0, -9.0)
    assert sum(turn.stable for turn in turns) >= 2
    assert any(not turn.stable for turn in turns)
    assert steady_turn(load_robot("tire"), 30.0, -9.0).stable


def test_straight_line_has_infinite_radius() -> None:
    turn = steady_turn(load_robot("tire"), 60.0, 60.0)
    assert turn.radius_mm == float("inf")
    assert turn.u_mm_s == pytest.approx(np.pi, rel=1e-4)


def test_the_command_writes_every_speed_and_ratio_with_the_radius_of_its_turn(tmp_path: Path) -> None:
    output = tmp_path / "turns.csv"
    arguments = ["steady", "--robot", "barrel", "--left", "20", "--left", "50", "--ratios", "0.8", "0.2", "4"]
    run = CliRunner().invoke(turnscope, [*arguments, "-o", str(output)])
    assert run.exit_code == 0, run.output
    table = pd.read_csv(output)
    assert table["right_rpm"].to_numpy() == pytest.approx([16.0, 12.0, 8.0, 4.0, 40.0, 30.0, 20.0, 10.0])
    turn = steady_turn(load_robot("barrel"), 50.0, 20.0)
    row = table.iloc[6]
    assert row["radius_mm"] == pytest.approx(turn.radius_mm, rel=1e-6)
    assert row["speed_mm_s"] == pytest.approx(turn.speed_mm_s, rel=1e-6)


@pytest.mark.parametrize("across", [1.0, 1.6])
def test_a_turn_on_the_spot_is_stable_where_friction_opposes_sliding_and_as_wide_as_coulomb_says(across: float) -> None:
    """Of the yaw rate without slip track²/(track² + wheelbase²·friction across over that along), on paper."""
    robot = load_robot(Path(__file__).parents[1] / "driven_robot" / "husky.toml")
    sliding = EffectEntry.model_validate({"id": "sliding-friction", "share": 1.0})
    larger = EffectEntry.model_validate({"id": "friction-across", "factor": across})
    turns = [
        steady_turns(robot.model_copy(update={"effect": own}), -48.0, 48.0) for own in ((larger,), (sliding, larger))
    ]
    assert [turn.stable for turn in turns[0]].count(True) == 2  # forward or backward, as the slip angle has it
    (spot,) = turns[1]
    assert spot.stable
    assert spot.u_mm_s == pytest.approx(0.0, abs=1e-3)
    ideal = 2 * 48.0 * np.pi / 30 * 0.165 / 0.555
    assert spot.yaw_rate_rad_s / ideal == pytest.approx(0.555**2 / (0.555**2 + across * 0.512**2), rel=0.02)
