"""The five cases of Figures 9 and 10, as the model notes read them."""

from __future__ import annotations

import numpy as np
import pytest

from simulator.command import Command
from simulator.robot import Robot, load_robot
from simulator.simulation import simulate
from simulator.steady import steady_turn

# case: attraction of a driving and a driven wheel in robot weights, radius of the model notes in mm
CASES = {"9a": (0.0, 0.5, 52.52), "9b": (0.25, 0.25, 46.32), "9c": (0.5, 0.0, 17.97), "10a": (0.0, 0.0, 52.05)}
CASES["10c"] = (4.75, 0.0, 15.63)


def attracted(driving: float, driven: float) -> Robot:
    tire = load_robot("tire")
    weight_mN = tire.weight_uN / 1000
    attraction = {"driving_wheel_mN": driving * weight_mN, "driven_wheel_mN": driven * weight_mN}
    return tire.model_copy(update={"magnetic_attraction": tire.magnetic_attraction.model_copy(update=attraction)})


@pytest.mark.parametrize("case", CASES)
def test_published_turns_are_within_0_05_mm_of_the_model_notes(case: str) -> None:
    driving, driven, radius_mm = CASES[case]
    assert steady_turn(attracted(driving, driven), 70.0, 100.0).radius_mm == pytest.approx(radius_mm, abs=0.05)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("case", ["9c", "10a"])
def test_integrated_run_settles_on_the_steady_turn_forward_and_backward(case: str, sign: int) -> None:
    robot = attracted(*CASES[case][:2])
    turn = steady_turn(robot, 70.0 * sign, 100.0 * sign)
    run = simulate(robot, Command.constant(70.0 * sign, 100.0 * sign, start_s=0.1), np.linspace(0.0, 3.0, 61))
    radius_mm = np.hypot(run.u_mm_s[-1], run.v_mm_s[-1]) / run.yaw_rate_rad_s[-1] * sign
    assert radius_mm == pytest.approx(turn.radius_mm, rel=1e-6)
    assert run.x_mm[1] == 0.0
    moved = np.hypot(np.diff(run.x_mm), np.diff(run.y_mm))[-1]
    chord = 2 * turn.radius_mm * np.sin(abs(turn.yaw_rate_rad_s) * 0.05 / 2)
    assert moved == pytest.approx(chord, rel=1e-6)
