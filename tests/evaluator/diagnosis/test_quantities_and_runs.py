"""Quantities known to a tolerance, linear views of a run, and what a run has of its own, in closed form."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.likelihood.features import (
    channels_of,
    compression,
)
from evaluator.diagnosis.likelihood.known_to import (
    frame_interval_s,
    mark_shifts,
    predicted_sigmas,
    quantities,
    start_per_run_s,
)
from evaluator.diagnosis.likelihood.linear import random_effects
from evaluator.diagnosis.likelihood.noise.tracking import Noise
from evaluator.diagnosis.likelihood.point import Column, Point
from evaluator.diagnosis.likelihood.problem import Problem
from evaluator.diagnosis.likelihood.run_data import SHARED_UNIT, RunData, Task
from evaluator.diagnosis.likelihood.variants import varied_robot
from evaluator.settings import KnownTo
from simulator.dynamics.terms import pattern_weights
from simulator.robot import load_robot
from tests.evaluator.diagnosis.synthetic import linear_runs


def frames_of(interval_s: float, count: int = 4) -> RunData:
    time = interval_s * np.arange(count)
    marks = np.tile([0.0, 2.0, 0.0, -2.0], (count, 1))
    return RunData("r", 30.0, 20.0, 0.0, None, time, marks, 0)


def test_start_is_known_to_a_frame_and_of_a_run_to_half_a_frame() -> None:
    data = [frames_of(0.02), frames_of(0.04), frames_of(0.04)]
    assert frame_interval_s(data) == pytest.approx(0.04)
    assert start_per_run_s(KnownTo(), data) == pytest.approx(0.02)
    assert start_per_run_s(KnownTo(start_per_run_s=0.005), data) == 0.005
    found = {item.key: item for item in quantities(KnownTo(), load_robot("barrel"), data)}
    assert found["start_common_s"].sigma == pytest.approx(0.04)
    stated = {item.key: item for item in quantities(KnownTo(start_common_s=0.011), load_robot("barrel"), data)}
    assert stated["start_common_s"].sigma == 0.011


def test_quantities_have_the_sigmas_of_a_laboratory_that_says_nothing() -> None:
    robot = load_robot("barrel")
    found = {item.key: item for item in quantities(KnownTo(), robot, [frames_of(0.02)])}
    geometry, radius = robot.known_to, robot.wheels.radius_mm
    expected = {
        "time_base": 1e-4,
        "plane_scale": 1e-3,
        "plate_level_x_deg": geometry.plate_level_deg,
        "plate_level_y_deg": geometry.plate_level_deg,
        "green_x_mm": geometry.mark_position_mm,
        "center_of_gravity_x_mm": geometry.center_of_gravity_mm,
        "wheels.radius_mm": 0.005 * radius,
        "wheel_radius_difference": np.sqrt(2) * 0.005,
        "body.mass_g": 0.02 * robot.body.mass_g,
        "left_wheel_turns": 0.01,
        "right_wheel_turns": 0.01,
        "magnetic_attraction.driving_wheel_mN": 0.05 * robot.magnetic_attraction.driving_wheel_mN,
        "magnetic_attraction.driven_wheel_mN": 0.05 * robot.magnetic_attraction.driven_wheel_mN,
    }
    for key, sigma in expected.items():
        assert found[key].sigma == pytest.approx(sigma), key
    assert len([key for key in found if key.endswith(("_x_mm", "_y_mm")) and key.startswith(("green", "yellow"))]) == 4
    assert found["time_base"].tolerance == pytest.approx(SHARED_UNIT)
    assert found["wheels.radius_mm"].tolerance == pytest.approx(0.005)
    assert found["wheels.radius_mm"].unit == "mm"
    assert found["body.mass_g"].unit == "g"
    sizes = predicted_sigmas(tuple(found.values()))
    assert sizes["time_base"] == pytest.approx(1e-4 / SHARED_UNIT)
    assert set(sizes) == {
        *("start_common_s", "time_base", "wheel_radius_difference", "plate_level_x_deg", "plate_level_y_deg"),
        *("center_of_gravity_x_mm", "center_of_gravity_y_mm", "plane_scale"),
        *("green_x_mm", "green_y_mm", "yellow_x_mm", "yellow_y_mm", "left_wheel_turns", "right_wheel_turns"),
    }
    exact = robot.model_copy(update={"known_to": geometry.model_copy(update={"wheel_radius_mm": 0.0})})
    of_wheels = {"left_wheel_turns", "right_wheel_turns", "wheel_radius_difference"}
    assert not of_wheels & {item.key for item in quantities(KnownTo(), exact, [frames_of(0.02)])}


def test_a_length_without_a_stated_sigma_is_known_as_well_as_callipers_are_right() -> None:
    robot = load_robot("barrel")
    geometry = robot.known_to.model_copy(update={"wheelbase_mm": None, "track_mm": 0.2})
    loose = robot.model_copy(update={"known_to": geometry})
    found = {item.key: item.sigma for item in quantities(KnownTo(), loose, [frames_of(0.02)])}
    assert (found["wheels.wheelbase_mm"], found["wheels.track_mm"]) == pytest.approx((0.02, 0.2))
    held = robot.model_copy(update={"tolerance": {"wheels.track_mm": 0.1}})
    assert "wheels.track_mm" not in {item.key for item in quantities(KnownTo(), held, [frames_of(0.02)])}


def test_nominal_values_are_multiplied_by_one_plus_their_deviation() -> None:
    robot = load_robot("barrel")
    moved = varied_robot(robot, {"slip.lateral_friction": 0.1, "body.mass_g": -0.2, "wheels.radius_mm": 0.0})
    assert moved.slip.lateral_friction == pytest.approx(1.1 * robot.slip.lateral_friction)
    assert moved.body.mass_g == pytest.approx(0.8 * robot.body.mass_g)
    assert moved.wheels == robot.wheels


def test_wheels_of_a_list_whose_places_were_varied_still_have_a_side() -> None:
    """Deviations of a fit are numbers of NumPy, whose comparisons do not subtract."""
    moved = varied_robot(load_robot("four_driven"), {"wheel.y_mm": np.float64(0.01)})
    assert pattern_weights("left-right", moved.wheel) == (1, -1, 1, -1)


class Line:
    """Marks that follow a task in a straight line: what a simulator would give, in closed form."""

    robots = ()

    def __init__(self, data: tuple[RunData, ...]) -> None:
        self.data = data

    def marks(self, tasks: list[Task]) -> list[np.ndarray]:
        found = []
        for task in tasks:
            time, own = self.data[task.run].time_s, task.per_run
            speed = 2.0 * (1 + own[4]) * (1 + task.nominal.get("wheels.radius_mm", 0.0))
            along = own[0] + speed * (time - 0.01 * own[6])
            y = np.full(len(time), own[1] + 0.5 * own[3])
            side = 2 * np.array([-np.sin(own[2]), np.cos(own[2])])
            if task.nominal.get("wheels.radius_mm", 0.0) > 5:
                along = along * np.nan
            found.append(np.column_stack([along + side[0], y + side[1], along - side[0], y - side[1]]))
        return found


def line_problem() -> tuple[Problem, tuple[RunData, ...]]:
    time = np.arange(60) / 20
    along = 1.0 + 2.1 * time
    marks = np.column_stack([along, np.full(60, 5.0), along, np.full(60, 1.0)])
    data = (RunData("r0", 30.0, 30.0, 0.0, None, time, marks, 0),)
    noise = ((Noise(0.01, 0.0, 0.05),) * 4,)
    used = np.ones(60, dtype=bool)
    packed = (compression(time, used, noise[0]),)
    return Problem(data, Line(data), (channels_of(marks),), packed, noise, 2.0), data  # type: ignore[arg-type]


def test_linear_view_of_a_run_predicts_its_features_at_any_parameters() -> None:
    """Of a simulator that is linear but for the product of gains: response less columns times values is the misfit."""
    problem, _ = line_problem()
    point = Point(np.array([[1.0, 3.0, 0.0, 0.0, 0.05, 0.0, 0.0]]))
    column = Column("wheels.radius_mm")
    (view,) = problem.linearized(point, [column])
    own = np.array([1.2, 3.1, 0.0, 0.1, 0.06, 0.0, 0.3])
    direct = problem.compressions[0].features(problem.residuals([Task(0, tuple(own))])[0])
    linear = view.response - view.scatter @ own[3:] - view.start @ (own[:3] - point.per_run[0, :3])
    np.testing.assert_allclose(linear, direct, atol=1e-3 * np.abs(direct).max())
    wide = problem.compressions[0].features(
        problem.residuals([Task(0, tuple(point.per_run[0]), {column.key: 0.01})])[0]
    )
    here = view.response - view.scatter @ point.per_run[0, 3:]
    np.testing.assert_allclose(here - 0.01 * view.common[:, 0], wide, atol=1e-6)
    (again,) = problem.seen_again(replace(point, per_run=own[None]), [view], [0], [column])
    assert again is not None
    np.testing.assert_allclose(again.response - view.scatter @ own[3:], direct, atol=1e-9)


def test_run_that_cannot_be_simulated_has_no_linear_view_and_is_named() -> None:
    problem, _ = line_problem()
    point = Point(np.zeros((1, 7)), {"wheels.radius_mm": 9.0})
    assert problem.attempted(point, [], [0]) == [None]
    with pytest.raises(FloatingPointError, match="run r0 cannot be simulated"):
        problem.linearized(point, [])
    edge = Point(np.zeros((1, 7)), {"wheels.radius_mm": 5.0 - 1e-9})
    (view,) = problem.attempted(edge, [Column("wheels.radius_mm")], [0])
    assert view is not None
    assert (view.common == 0).all()  # what cannot be simulated offers nothing


def test_own_numbers_of_a_run_settle_where_the_measured_line_lies() -> None:
    problem, _ = line_problem()
    wide = np.array([10.0, 10.0, 10.0, 1e-4])
    point, value = random_effects.settled(problem, Point(np.zeros((1, 7))), [0], wide)
    assert point.per_run[0, :2] == pytest.approx([1.0, 3.0], abs=0.01)
    assert point.per_run[0, 4] == pytest.approx(0.05, abs=1e-3)
    assert value < 1e-2
    tight = np.array([1e-6, 1e-6, 1e-6, 1e-4])
    held, worse = random_effects.settled(problem, Point(np.zeros((1, 7))), [0], tight)
    assert abs(held.per_run[0, 4]) < 1e-6
    assert worse > 10.0
    starts = random_effects.place_starts(problem, Point(np.zeros((1, 7))), [0])
    assert starts.per_run[0, 3:] == pytest.approx(np.zeros(4))
    assert starts.per_run[0, 0] == pytest.approx(1.0 + 0.1 * 1.475, abs=0.02)  # in the middle of the run it lies right


def test_value_and_goal_of_a_runs_own_numbers_are_those_of_the_penalised_least_squares() -> None:
    (run,) = linear_runs(count=1)
    tau = np.array([0.05, 0.02, 0.02, 1.0])
    own = np.concatenate([np.zeros(3), tau * [1.0, -1.0, 0.5, 2.0]])
    left = run.response - run.scatter @ own[3:]
    assert random_effects._per_run_value(run, own, None) == pytest.approx(left @ left)
    assert random_effects._per_run_value(run, own, tau) == pytest.approx(left @ left + 1 + 1 + 0.25 + 4)
    goal = random_effects._per_run_goal(run, np.zeros(7), tau)
    design = np.column_stack([run.start, run.scatter])
    best = np.linalg.solve(design.T @ design + np.diag([0, 0, 0, *tau**-2.0]), design.T @ run.response)
    np.testing.assert_allclose(goal, best, rtol=1e-8)


@pytest.mark.parametrize(("horizon_s", "start_s", "counting"), [(np.inf, 0.0, 59), (1.0, 0.0, 20), (1.0, 0.5, 30)])
def test_frames_count_within_the_horizon_after_the_start(horizon_s: float, start_s: float, counting: int) -> None:
    problem, data = line_problem()
    channels = problem.channels[0].copy()
    channels[3] = np.nan
    changed = replace(problem, horizon_s=horizon_s, data=(replace(data[0], start_s=start_s),), channels=(channels,))
    assert changed.counting_frames(0).sum() == counting


def test_steps_of_derivatives_are_those_of_their_kind() -> None:
    term: Any = SimpleNamespace(coordinates=(SimpleNamespace(step=2.0, absent=1.0),), absent=(1.0,))
    assert Column("wheels.radius_mm").step == 5e-4
    assert Column("body.mass_g").step == 5e-3
    assert Column("time_base").step == pytest.approx(0.05 * SHARED_UNIT)
    assert Column("effect", 0, term).step == pytest.approx(0.4)
    assert Column("effect", 0, term, to=(7.0,)).step == 1.0
    assert (Column("effect", 0, term).absent, Column("time_base").absent) == (1.0, 0.0)
    point = Point(np.zeros((1, 7)), {"time_base": 0.3}, {"effect": (4.0,)})
    assert point.value(Column("effect", 0, term)) == 3.0
    assert point.moved(Column("effect", 0, term), 0.5).terms["effect"] == (4.5,)
    assert point.moved(Column("effect", 0, term, to=(7.0,)), 0.5).terms["effect"] == (7.0,)
    assert point.moved(Column("time_base"), 0.5).nominal["time_base"] == pytest.approx(0.8)
    assert Point(np.zeros((1, 7))).moved(Column("effect", 0, term), 0.5).terms["effect"] == (1.5,)
    assert Point(np.zeros((1, 7))).value(Column("effect", 0, term)) == 0.0


def test_marks_lie_off_by_what_was_found_and_exact_ones_by_nothing() -> None:
    robot = load_robot("barrel")
    assert mark_shifts(robot, {"yellow_x_mm": 0.25, "wheels.radius_mm": 1.0}) == (0.0, 0.0, 0.25, 0.0)


def test_points_that_stand_for_poses_are_not_called_marks() -> None:
    run = frames_of(0.02)
    names = [item.name for item in quantities(KnownTo(), load_robot("barrel"), [run])]
    assert "green mark along x of the robot" in names
    of_poses = [replace(run, from_poses=True)]
    names = [item.name for item in quantities(KnownTo(), load_robot("barrel"), of_poses) if "tracked" in item.name]
    assert names == [f"tracked point {point} of 2 along {axis} of the robot" for point in (1, 2) for axis in "xy"]
    mixed = quantities(KnownTo(), load_robot("barrel"), [run, *of_poses])
    assert not any("tracked" in item.name for item in mixed)
