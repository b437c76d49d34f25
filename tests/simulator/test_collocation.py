"""Long steps along the slow manifold, against solvers of others and against short steps."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from simulator.command import Command
from simulator.dynamics.model import compile_robot
from simulator.effects.entry import EffectEntry
from simulator.integrator.batch import integrate_one
from simulator.integrator.run_kernel import DONE, MOST_STEPS
from simulator.robot import Robot
from simulator.simulation import simulate
from tests.simulator.effect_probe import with_effects
from tests.simulator.reference import Array, Pace, Pull, Rates, integrated, plain_rates

TIMES_S = np.linspace(0.0, 2.0, 121)
LEFT, RIGHT = 33.3, 14.4
Solver = Callable[[Rates], Array]


def scipy_solver(rates: Rates) -> Array:
    # Its LSODA gives up where motors start gently from rest; CyRK's does not.
    return integrated([(0.0, TIMES_S[-1], rates)], TIMES_S, rtol=1e-8, atol=1e-10, method="Radau")


def cyrk_solver(rates: Rates) -> Array:
    cyrk = pytest.importorskip("CyRK", reason="CyRK is not installed (pip install cyrk)")

    def of_lists(time: float, state: Array) -> Array:
        return np.array(rates(time, state))

    found = cyrk.pysolve_ivp(
        of_lists, (0.0, TIMES_S[-1]), np.zeros(6), method="LSODA", t_eval=TIMES_S, rtol=1e-10, atol=1e-12
    )
    assert found.success
    return np.array(found.y).T


def descent(robot: Robot) -> Pull:
    force = robot.weight_uN * math.sin(math.radians(4.0))
    angle = math.radians(40.0)
    return lambda _x, _y, _heading: (force * math.cos(angle), force * math.sin(angle))


def spring(_robot: Robot) -> Pull:
    return lambda x, y, _heading: (30.0 * (20.0 - x), 30.0 * (-10.0 - y))


def ripple(time: float, rpm: float) -> float:
    return 1.0 + 0.03 * math.sin(2 * math.pi * rpm / 60 * time + math.radians(25.0))


def lag(time: float, _rpm: float) -> float:
    return 1.0 - math.exp(-time / 0.05)


CASES: dict[str, tuple[dict[str, object], Callable[[Robot], Pull] | None, Pace | None]] = {
    "plate-tilt": ({"angle_deg": 4.0, "azimuth_deg": 40.0}, descent, None),
    "tether-spring": ({"stiffness_mN_mm": 0.03, "anchor_x_mm": 20.0, "anchor_y_mm": -10.0}, spring, None),
    "speed-ripple": ({"amplitude": 0.03, "phase_deg": 25.0}, None, ripple),
    "command-lag": ({"dead_time_s": 0.0, "time_constant_s": 0.05}, None, lag),
}


@pytest.mark.parametrize("solver", [scipy_solver, cyrk_solver])
@pytest.mark.parametrize("id_", CASES)
@pytest.mark.parametrize("name", ["tire", "barrel"])
def test_runs_with_effects_agree_with_independent_solvers(solver: Solver, id_: str, name: str) -> None:
    values, pull, pace = CASES[id_]
    robot = with_effects(name, {"id": id_, **values})
    truth = solver(plain_rates(robot, LEFT, RIGHT, pull=pull(robot) if pull else None, pace=pace))
    # The lag begins with the motors at rest: what they do before the first knot.
    command = Command.steps([(-1.0, 0.0, 0.0), (0.0, LEFT, RIGHT)])
    run = simulate(robot, command, TIMES_S, tolerance_mm=1e-8)
    assert np.abs(np.stack([run.x_mm, run.y_mm, run.heading_rad], axis=1) - truth[:, :3]).max() < 3e-6
    moving = np.stack([run.u_mm_s, run.v_mm_s, run.yaw_rate_rad_s], axis=1)[6:]
    assert np.abs(moving - truth[6:, 3:]).max() < 1e-5


@pytest.mark.parametrize(
    "effect",
    [
        {"id": "plate-tilt", "angle_deg": 4.0, "azimuth_deg": 40.0},
        {"id": "friction-gradient", "per_mm_x": 0.004, "per_mm_y": -0.002},
        {"id": "friction-grain", "amplitude": 0.05, "direction_deg": 20.0},
        {"id": "stray-magnet", "force_mN": 0.1, "x_mm": 10.0, "y_mm": 15.0},
    ],
    ids=lambda item: str(item["id"]),
)
def test_half_a_run_over_a_varying_plate_is_one_step_beyond_those_of_the_start(effect: dict[str, object]) -> None:
    times = np.linspace(0.0, 10.0, 601)
    model = compile_robot(with_effects("barrel", effect))[0]
    command = Command.steps([(0.0, LEFT, RIGHT), (5.0, -LEFT, -RIGHT)])
    states, steps = states_and_steps(model, command, times, 1e-6)
    assert steps < 55  # 48 to 51, of which two starts take 45
    # Outputs within the long steps are as good as their ends.
    truth, _ = states_and_steps(model, command, times, 1e-10)
    assert np.abs(states - truth)[:, :2].max() < 5e-6
    assert np.abs(states - truth)[10:300, 3:].max() < 1e-6


def test_a_revolution_of_wheels_with_run_out_takes_few_steps() -> None:
    """Five and a half revolutions; from a constant guess of the velocity, 172 steps."""
    times = np.linspace(0.0, 10.0, 601)
    model = compile_robot(with_effects("barrel", {"id": "speed-ripple", "amplitude": 0.2, "phase_deg": 0.0}))[0]
    states, steps = states_and_steps(model, Command.constant(33.3, 22.0, 0.5), times, 1e-6)
    assert steps < 80
    truth, _ = states_and_steps(model, Command.constant(33.3, 22.0, 0.5), times, 1e-10)
    assert np.abs(states - truth)[:, :2].max() < 5e-6


def test_wheel_that_turns_over_on_a_varying_plate_is_stepped_over_and_collocation_goes_on() -> None:
    # The right command goes through zero halfway; there friction bends within microseconds.
    robot = with_effects("barrel", {"id": "plate-tilt", "angle_deg": 4.0, "azimuth_deg": 40.0})
    command = Command(np.array([0.0, 2.0]), np.array([30.0, 30.0]), np.array([-20.0, 20.0]))
    model = compile_robot(robot)[0]
    states, ramp = states_and_steps(model, command, TIMES_S, 1e-8)
    truth, _ = states_and_steps(model, command, TIMES_S, 1e-10)
    assert np.abs(states - truth)[:, :2].max() < 1e-6
    _, steps = states_and_steps(model, command, 6 * TIMES_S, 1e-8)
    assert steps < ramp + 4  # short steps alone take 48 more for the next 10 s


def states_and_steps(model: Any, command: Command, times_s: np.ndarray, tolerance_mm: float) -> tuple[np.ndarray, int]:
    """States (n, 6) of a run from rest, and how many steps it took."""
    out = np.empty((len(times_s), 6))
    done, steps, _ = integrate_one(model, command.knots, np.zeros(6), times_s.copy(), out, tolerance_mm, MOST_STEPS)
    assert done == DONE
    return out, steps


def test_robot_whose_wheels_begin_to_turn_against_each_other_leaves_rest_at_once() -> None:
    # Case 152 of seed 2 of a study over random effects: the rounding of rest holds the robot for an instant.
    robot = with_effects(
        "barrel", {"id": "tether-spring", "stiffness_mN_mm": 1e-3, "anchor_x_mm": 20, "anchor_y_mm": 12}
    )
    drag = EffectEntry.model_validate({"id": "rolling-drag", "coefficient": 0.018})
    robot = robot.model_copy(update={"effect": (*robot.effect, drag)})
    command = Command.constant(-90.0, 28.5, 0.3)
    runs = [simulate(robot, command, TIMES_S, tolerance_mm=tolerance) for tolerance in (1e-6, 1e-9)]
    assert np.abs(runs[0].x_mm - runs[1].x_mm).max() < 1e-5
    assert np.abs(runs[0].y_mm - runs[1].y_mm).max() < 1e-5
