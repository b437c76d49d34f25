"""The numbers that the kernels see of a robot, each worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from simulator.dynamics.layout import Layout
from simulator.dynamics.model import NO_FRICTION, compile_robot, record_of, room_for
from simulator.dynamics.record import EMPTY, LAW, NO_COMMAND, model_type
from simulator.dynamics.statics import Rectangle, wheel_loads
from simulator.effects.draft import Draft
from simulator.errors import SimulationError
from simulator.robot import Robot, load_robot
from tests.simulator.effect_probe import affected
from tests.simulator.layouts import ball, pair, robot_with


def robot_of(**slip: object) -> Robot:
    """Barrel wheels on a body of 0.5 g and 3 g·mm² with a slip law of round numbers."""
    robot = load_robot("barrel")
    law = {
        "longitudinal_friction": 0.5,
        "lateral_friction": 0.4,
        "friction_decrease": 0.1,
        "longitudinal_shape": 1.1,
        "lateral_shape": 1.2,
        "longitudinal_stiffness": 6.0,
        "lateral_stiffness": 8.0,
        **slip,
    }
    body = robot.body.model_copy(update={"mass_g": 0.5, "yaw_inertia_g_mm2": 3.0})
    return robot.model_copy(update={"slip": robot.slip.model_copy(update=law), "body": body})


LOADS = np.array([1225.0 + 22050.0] * 2 + [1225.0 + 2450.0] * 2)  # a quarter of 4900 µN, and the magnets


@pytest.mark.parametrize(("basis", "stiffness_of"), [("load", LOADS), ("weight", np.full(4, 1225.0))])
def test_slip_law_of_a_wheel_is_scaled_by_its_load_or_its_weight(basis: str, stiffness_of: np.ndarray) -> None:
    row = compile_robot(robot_of(stiffness_basis=basis))[0]
    assert row["grip_x"] == pytest.approx(0.5 * LOADS)
    assert row["grip_y"] == pytest.approx(0.4 * LOADS)
    # Force per slip angle at small slip, grip times steepness, is the lateral stiffness.
    assert row["grip_x"] * row["steep_x"] == pytest.approx(8.0 * stiffness_of)
    assert row["grip_y"] * row["steep_y"] == pytest.approx(8.0 * stiffness_of)
    assert row["ratio"] == pytest.approx([0.75] * 4)
    assert row["shape_x"].tolist() == [1.1] * 4
    assert row["shape_y"].tolist() == [1.2] * 4
    assert row["decrease"].tolist() == [0.1] * 4
    assert row["stiffness_follows_load"].tolist() == [float(basis == "load")] * 4


def test_friction_factor_of_an_effect_scales_the_grip_of_its_wheel() -> None:
    draft = Draft(robot_of())
    draft.friction_factor[:] = [1.0, 2.0, 0.5, 1.0]
    assert record_of(draft)[0]["grip_y"] == pytest.approx(0.4 * LOADS * [1.0, 2.0, 0.5, 1.0])
    draft.friction_factor[2] = 0.0
    with pytest.raises(SimulationError, match="every wheel needs a positive friction; the factors are"):
        record_of(draft)


def test_wheels_that_carry_nothing_and_casters_have_no_friction_and_divide_by_nothing() -> None:
    robot = robot_with([*pair(0.0), ball(-3.0, 0.0)], {"center_of_gravity_mm": (-1.0, 0.0)})
    row = compile_robot(robot)[0]
    of_ball = [float(row[name][2]) for name in LAW]
    assert of_ball == list(NO_FRICTION)
    assert [float(row[name][3]) for name in LAW] == [EMPTY.get(name, 0.0) for name in LAW]  # a slot beyond
    assert (row["grip_x"][:2] > 0).all()


def test_mass_matrix_times_its_inverse_is_one_with_the_centre_of_gravity_anywhere() -> None:
    row = compile_robot(affected(robot_of(), "mass-offset", x_mm=0.6, y_mm=-0.4))[0]
    x, y, about = 0.6, -0.4, 3.0 + 0.5 * (0.36 + 0.16)  # parallel axes
    matrix = np.array([[0.5, 0.0, -0.5 * y], [0.0, 0.5, 0.5 * x], [-0.5 * y, 0.5 * x, about]])
    assert row["inverse_mass"] @ matrix == pytest.approx(np.eye(3), abs=1e-12)
    assert row["inertia"] == pytest.approx(about)
    assert (row["mass"], row["gravity_x"], row["gravity_y"]) == pytest.approx((0.5, x, y))


def test_motors_turn_their_wheels_by_the_circumference_a_revolution() -> None:
    robot = robot_of()
    draft, per_rpm = Draft(robot), 2 * math.pi * 0.5 / 60
    draft.speed_factor = np.array([1.1, 0.8])
    draft.droop_rpm_per_uN_mm, draft.dead_band_rpm, draft.dead_time_s, draft.lag_s = 0.01, 3.0, 0.2, 0.3
    draft.compliance_rad_per_mN = 0.02
    row = record_of(draft)[0]
    assert row["by_left"] == pytest.approx([1.1 * per_rpm, 0.0, 0.0, 0.0])
    assert row["by_right"] == pytest.approx([0.0, 0.8 * per_rpm, 0.0, 0.0])
    assert row["speed"] == pytest.approx([1.1 * per_rpm, 0.8 * per_rpm])
    assert row["droop"][:2] == pytest.approx([per_rpm * 0.01 * 0.5] * 2)  # mm/s per rpm, rpm per µN·mm, mm
    assert [float(row[name]) for name in ("dead_band", "dead_time", "lag")] == [3.0, 0.2, 0.3]
    assert row["compliance"] == pytest.approx(2e-5)  # rad per µN
    assert row["limits"].tolist() == [1e6] * 3  # none
    assert row["sliding"] == 0.0
    assert row["side"].tolist() == [0, 1, NO_COMMAND, NO_COMMAND]
    assert row["driving"].tolist() == [1, 1, 0, 0]


@pytest.mark.parametrize(("factor", "unit"), [(1.0, 1.0), (4.0, 2.0), (16.0, 4.0)])
def test_lengths_of_a_robot_count_in_its_unit(factor: float, unit: float) -> None:
    """Four times as large is a unit of length of 4 mm, which is one of time of 2 s, and of force of 1 µN."""
    robot = robot_with([*pair(2.0 * factor, 2.0 * factor), *pair(-2.0 * factor, 2.0 * factor, driven=False)])
    body = robot.body.model_copy(update={"mass_g": 0.5, "yaw_inertia_g_mm2": 3.0})
    robot = affected(robot.model_copy(update={"body": body}), "mass-offset", x_mm=0.6, y_mm=-0.4)
    draft = Draft(robot)
    draft.droop_rpm_per_uN_mm, draft.dead_band_rpm, draft.dead_time_s, draft.lag_s = 0.01, 3.0, 0.2, 0.3
    draft.limits_rpm = (30.0, 20.0, 10.0)
    from simulator.dynamics.model import apply_effects

    apply_effects(draft, robot.effect)
    row, length = record_of(draft)[0], unit * unit
    assert row["time_unit"] == unit
    assert row["wheel_x"] == pytest.approx(np.array([2.0, 2.0, -2.0, -2.0]) * factor / length)
    assert row["wheel_y"] == pytest.approx(np.array([2.0, -2.0, 2.0, -2.0]) * factor / length)
    assert (row["gravity_x"], row["gravity_y"]) == pytest.approx((0.6 / length, -0.4 / length))
    about = 3.0 + 0.5 * 0.52
    assert row["inertia"] == pytest.approx(about / length**2)
    assert row["inverse_mass"][2, 2] == pytest.approx(length**2 / 3.0)
    # Per rpm of the kernels' minute, and of the torque of the wheel's real radius.
    assert row["by_left"][0] == pytest.approx(2 * math.pi * 0.5 / 60 / length)
    assert row["droop"][0] == pytest.approx(2 * math.pi * 0.5 / 60 * 0.01 * 0.5 / unit)
    assert [float(row[name]) for name in ("dead_band", "dead_time", "lag")] == pytest.approx(
        [3.0 * unit, 0.2 / unit, 0.3 / unit]
    )
    assert row["limits"] == pytest.approx([30.0 * unit, 20.0 * unit, 10.0 * unit])


def test_compliant_axles_are_the_two_of_the_wheels_that_grip() -> None:
    robot = robot_with([*pair(3.0), *pair(-1.0, driven=False), ball(-3.0, 0.0)])
    row = compile_robot(affected(robot, "axle-compliance", deg_per_mN=1.0))[0]
    assert row["axle"][:5].tolist() == [0, 0, 1, 1, 2]
    assert row["axle_x"] == pytest.approx([3.0, -1.0])
    assert row["general"] == 1
    three = robot_with([*pair(3.0), *pair(0.0, driven=False), *pair(-3.0, driven=False)])
    with pytest.raises(SimulationError, match="needs two axles; found wheels at 3 positions of x"):
        compile_robot(affected(three, "axle-compliance", deg_per_mN=1.0))
    toed = compile_robot(affected(robot_of(), "wheel-toe", left_deg=0.0, right_deg=1.0))[0]
    assert (toed["general"], toed["steer"][1]) == (1, pytest.approx(math.radians(1.0)))


def test_batches_have_room_for_the_robot_with_the_most_wheels_in_fours() -> None:
    two = robot_with([*pair(0.0), ball(-3.0, 0.0)], {"center_of_gravity_mm": (-1.0, 0.0)})
    six = robot_with([*pair(3.0), *pair(0.0, driven=False), *pair(-3.0, driven=False)])
    assert [room_for(robots) for robots in ([two], [six], [two, six], [load_robot("barrel")])] == [4, 8, 8, 4]
    row = compile_robot(two, slots=8)[0]
    assert row.dtype == model_type(8)
    assert row["wheels"] == 3
    assert row["grip_x"][3:].tolist() == [0.0] * 5
    assert row["rest_speed"] == 1e-4
    assert compile_robot(two, rest_speed_mm_s=1e-3)[0]["rest_speed"] == 1e-3


def test_layout_tells_driven_from_rolling_wheels_and_both_from_balls() -> None:
    layout = Layout.of(robot_with([*pair(0.0), *pair(-2.0, driven=False, attraction_mN=3.0), ball(-3.0, 0.0)]))
    kinds = {name: getattr(layout, name).tolist() for name in ("left", "right", "driving", "rolling")}
    assert kinds == {
        "left": [True, False, False, False, False],
        "right": [False, True, False, False, False],
        "driving": [True, True, False, False, False],
        "rolling": [False, False, True, True, False],
    }
    assert layout.attraction_uN.tolist() == [0.0, 0.0, 3000.0, 3000.0, 0.0]
    assert layout.rectangle is None


SQUARE = np.array([[5.0, 4.0], [5.0, 1.0], [1.0, 4.0], [1.0, 1.0]])


@pytest.mark.parametrize(
    ("places", "found"),
    [
        (SQUARE, True),
        (SQUARE[:3], False),
        (np.vstack([SQUARE[:3], [[1.0, 0.9]]]), False),
        (np.array([[0.0, 2.0], [0.0, -2.0], [0.0, 1.0], [0.0, -1.0]]), False),
        (np.vstack([SQUARE, [[3.0, 2.0]]]), False),
    ],
)
def test_rectangle_is_four_corners_along_the_axes_and_nothing_else(places: np.ndarray, found: bool) -> None:
    assert (Rectangle.of(places) is not None) == found
    if found:
        rectangle = Rectangle.of(places)
        assert rectangle is not None
        assert (rectangle.middle, rectangle.sides) == ((3.0, 2.5), (4.0, 3.0))
        assert rectangle.corners == ((1, 1), (1, -1), (-1, 1), (-1, -1))


def test_magnets_hold_a_robot_on_three_of_four_supports_where_removing_one_by_one_ends_without_a_balance() -> None:
    places = np.array([[-0.098, -0.158], [-0.710, -0.255], [0.194, -1.162], [-1.869, 0.526]])
    share, load = wheel_loads("robot", places, 1104.0, (-0.030, 0.020), np.full(4, 229.0))
    assert load == pytest.approx([1715.0, 22.7, 53.0, 0.0], abs=3.0)
    assert share.sum() == pytest.approx(1104.0)
    assert share @ (places - [-0.030, 0.020]) == pytest.approx([0.0, 0.0], abs=1e-6)


def test_a_support_that_lifted_off_presses_again_where_the_body_sinks_there() -> None:
    """Of a square with the weight over the left side and a sixth support far right, both right supports are lifted.

    Forces balance about both axes, none pulls, and each support on the ground sinks: the answer is unique.
    """
    places = np.array([[2.0, 2.0], [-2.0, 2.0], [2.0, -2.0], [-2.0, -2.0], [0.0, -9.0], [0.0, 2.5]])
    share, load = wheel_loads("robot", places, 1000.0, (0.0, 2.2), np.zeros(6))
    assert load == pytest.approx(share)
    assert (load >= 0).all()
    assert load.sum() == pytest.approx(1000.0)
    assert load @ (places - [0.0, 2.2]) == pytest.approx([0.0, 0.0], abs=1e-6)
    resting = load > 0
    plane = np.linalg.lstsq(np.column_stack([np.ones(resting.sum()), places[resting]]), load[resting], rcond=None)[0]
    sunk = np.column_stack([np.ones(6), places]) @ plane
    assert (sunk[~resting] <= 1e-6).all()
    assert load[resting] == pytest.approx(sunk[resting])


def test_the_moment_of_inertia_is_that_of_a_uniform_box_unless_it_is_stated() -> None:
    robot = load_robot("barrel")
    body = robot.body.model_copy(update={"length_mm": 6.0, "width_mm": 2.0, "mass_g": 0.5, "yaw_inertia_g_mm2": None})
    x, y = np.meshgrid(*(length * ((np.arange(1000) + 0.5) / 1000 - 0.5) for length in (6.0, 2.0)))
    assert robot.model_copy(update={"body": body}).yaw_inertia_g_mm2 == pytest.approx(
        0.5 * np.mean(x**2 + y**2), rel=1e-4
    )
    stated = body.model_copy(update={"yaw_inertia_g_mm2": 3.0})
    assert robot.model_copy(update={"body": stated}).yaw_inertia_g_mm2 == 3.0
