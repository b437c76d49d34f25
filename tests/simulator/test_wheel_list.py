"""Robots of any layout: [[wheel]] lists, their units, and what a robot of another size or handedness does."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
from pydantic import ValidationError

from simulator.command import Command
from simulator.dynamics.model import compile_robot
from simulator.effects.entry import EffectEntry
from simulator.errors import SimulationError
from simulator.robot import Robot, load_robot, shipped_robot_text, shipped_robots
from simulator.run import Run
from simulator.simulation import simulate, simulate_batch
from simulator.steady import steady_turn, steady_turns
from tests.simulator.effect_probe import affected, body_force
from tests.simulator.layouts import ball, listed, pair, robot_with
from tests.simulator.reference import integrated, plain_rates

TIMES_S = np.linspace(0.0, 3.0, 61)
THERE_AND_BACK = Command.steps([(0.0, 33.3, 14.4), (1.5, -33.3, -14.4)])
LAYOUTS = ("barrel", "two_driven_caster", "four_driven", "six_driven")


def states(run: Run) -> np.ndarray:
    return np.stack([run.x_mm, run.y_mm, run.heading_rad, run.u_mm_s, run.v_mm_s, run.yaw_rate_rad_s], axis=1)


@pytest.mark.parametrize(
    ("effect", "values"),
    [
        (None, {}),
        ("mass-offset", {"x_mm": 0.4, "y_mm": -0.3}),
        ("rolling-drag", {"coefficient": 0.02}),
        ("axle-compliance", {"deg_per_mN": 0.3}),
    ],
)
def test_wheels_are_short_for_a_list_of_four(effect: str | None, values: dict[str, float]) -> None:
    robot = load_robot("barrel")
    if effect:
        robot = affected(robot, effect, **values)
    short, long = simulate(robot, THERE_AND_BACK, TIMES_S), simulate(listed(robot), THERE_AND_BACK, TIMES_S)
    assert np.array_equal(states(short), states(long))
    assert short.to_table().equals(long.to_table())


@pytest.mark.parametrize(("name", "scale"), [("six_driven", 1.0), ("four_driven", 256.0)])
def test_motion_is_that_of_the_equations_integrated_by_scipy(name: str, scale: float) -> None:
    robot, halves = load_robot(name), [(0.0, 1.5, 33.3, 14.4), (1.5, 3.0, -33.3, -14.4)]
    pieces = [(begin, end, plain_rates(robot, left, right, 1e-4 * scale**0.5)) for begin, end, left, right in halves]
    truth = integrated(pieces, TIMES_S, 1e-10, 1e-11 * scale)
    found = states(simulate(robot, THERE_AND_BACK, TIMES_S))
    assert np.abs(found[:, :2] - truth[:, :2]).max() < 1e-6 * scale
    assert np.abs(found[:, 2] - truth[:, 2]).max() < 1e-6


@pytest.mark.parametrize("name", LAYOUTS)
def test_symmetric_layouts_drive_straight(name: str) -> None:
    run = simulate(load_robot(name), Command.constant(30.0, 30.0), TIMES_S)
    assert run.x_mm[-1] == pytest.approx(np.pi * load_robot(name).driving_radius_mm * 3.0, rel=2e-2)
    assert abs(run.y_mm[-1]) < 1e-9 * run.x_mm[-1]


@pytest.mark.parametrize("name", ["two_driven_caster", "four_driven", "six_driven"])
def test_the_mirrored_robot_makes_the_mirrored_run(name: str) -> None:
    robot = load_robot(name)
    crooked = robot.model_copy(update={"wheel": (_moved(robot, 0, 1.1), *robot.wheel[1:])})
    swapped = {"left": "right", "right": "left", "none": "none"}
    wheels = [
        wheel.model_copy(update={"y_mm": -wheel.y_mm, "driven_by": swapped[wheel.driven_by]}) for wheel in crooked.wheel
    ]
    mirrored = crooked.model_copy(update={"wheel": tuple(wheels)})
    run = states(simulate(crooked, Command.constant(33.3, 14.4), TIMES_S))
    other = states(simulate(mirrored, Command.constant(14.4, 33.3), TIMES_S))
    sign = np.array([1, -1, -1, 1, -1, -1])
    assert np.allclose(run, other * sign, rtol=1e-6, atol=1e-6 * np.abs(run).max())


def _moved(robot: Robot, number: int, factor: float) -> object:
    wheel = robot.wheel[number]
    return wheel.model_copy(
        update={"x_mm": wheel.x_mm + 0.1 * robot.extent_mm[1], "radius_mm": factor * wheel.radius_mm}
    )


def _grown(robot: Robot, length: float, mass: float) -> Robot:
    """The robot with lengths, and masses and forces, times these; gravity stays."""
    wheels, body, attraction = robot.wheels, robot.body, robot.magnetic_attraction
    assert wheels is not None
    grown = {
        "wheels": {name: length * value for name, value in wheels.model_dump().items()},
        "magnetic_attraction": {name: mass * value for name, value in attraction.model_dump().items()},
        "body": {
            "mass_g": mass * body.mass_g,
            **{name: length * getattr(body, name) for name in ("length_mm", "width_mm", "height_mm")},
        },
    }
    return Robot.model_validate({**robot.model_dump(exclude_none=True), **grown})


@pytest.mark.parametrize(
    ("length", "within"), [(4.0, 0.0), (1 / 4.0, 0.0), (4096.0, 0.0), (10.0, 1e-6), (1000.0, 1e-6)]
)
def test_a_robot_of_another_size_moves_alike(length: float, within: float) -> None:
    robot, time = load_robot("barrel"), length**0.5
    small = states(simulate(robot, THERE_AND_BACK, TIMES_S))
    command = Command.steps([(0.0, 33.3 / time, 14.4 / time), (1.5 * time, -33.3 / time, -14.4 / time)])
    large = states(simulate(_grown(robot, length, 64.0), command, TIMES_S * time))
    like = large / np.array([length, length, 1.0, time, time, 1 / time])
    assert np.allclose(like, small, rtol=0, atol=within * np.abs(small).max())


def test_effects_act_alike_on_a_robot_of_another_size() -> None:
    robot, length, time = load_robot("barrel"), 16.0, 4.0
    small: list[dict[str, object]] = [
        {"id": "tether-spring", "stiffness_mN_mm": 0.1, "anchor_x_mm": 3.0, "anchor_y_mm": 5.0},
        {"id": "friction-gradient", "per_mm_x": 0.01, "per_mm_y": -0.02},
        {"id": "viscous-drag", "force_mN_s_mm": 0.05, "moment_uN_mm_s": 30.0},
        {"id": "command-lag", "dead_time_s": 0.1, "time_constant_s": 0.2},
        {"id": "dead-band", "rpm": 2.0},
        {"id": "scrub-torque", "radius_mm": 0.1},
        {"id": "motor-droop", "rpm_per_uN_mm": 1e-3},
        {"id": "mass-offset", "x_mm": 0.4, "y_mm": 0.2},
    ]
    large: list[dict[str, object]] = [
        {"id": "tether-spring", "stiffness_mN_mm": 0.1 / length, "anchor_x_mm": 48.0, "anchor_y_mm": 80.0},
        {"id": "friction-gradient", "per_mm_x": 0.01 / length, "per_mm_y": -0.02 / length},
        {"id": "viscous-drag", "force_mN_s_mm": 0.05 * time / length, "moment_uN_mm_s": 30.0 * time * length},
        {"id": "command-lag", "dead_time_s": 0.4, "time_constant_s": 0.8},
        {"id": "dead-band", "rpm": 0.5},
        {"id": "scrub-torque", "radius_mm": 1.6},
        {"id": "motor-droop", "rpm_per_uN_mm": 1e-3 / time / length},
        {"id": "mass-offset", "x_mm": 6.4, "y_mm": 3.2},
    ]
    runs = []
    for base, effects, scale in ((robot, small, 1.0), (_grown(robot, length, 1.0), large, time)):
        acted = base.model_copy(update={"effect": tuple(EffectEntry.model_validate(item) for item in effects)})
        command = Command.constant(33.3 / scale, 14.4 / scale)
        runs.append(states(simulate(acted, command, TIMES_S * scale)))
    like = runs[1] / np.array([length, length, 1.0, time, time, 1 / time])
    assert np.allclose(like, runs[0], rtol=0, atol=1e-9)


@pytest.mark.parametrize("length", [1 / 16.0, 1.9, 2.1, 16.0])  # the units of the kernels change at 2
def test_a_stray_magnet_pulls_a_robot_of_any_size_by_the_same_law(length: float) -> None:
    """The point is (3, 4) mm away and 2 mm deep: at √29 mm, 10 mm/√29 counts to the third power."""
    magnet = {"force_mN": 0.5, "x_mm": 8.0, "y_mm": 3.0, "exponent": 3.0}
    robot = affected(_grown(load_robot("barrel"), length, 1.0), "stray-magnet", **magnet)
    unit_mm = compile_robot(robot)[0]["time_unit"] ** 2
    pull = 500.0 * (10.0 / 29**0.5) ** 3 / 29**0.5
    assert body_force(robot, (5.0 / unit_mm, -1.0 / unit_mm, 0.0)) == pytest.approx([3 * pull, 4 * pull, 0.0])


def test_steady_turns_are_those_that_runs_end_on() -> None:
    for name in LAYOUTS:
        robot = load_robot(name)
        turn = steady_turn(robot, 33.3, 14.4)
        end = states(simulate(robot, Command.constant(33.3, 14.4), TIMES_S * 3))[-1]
        assert [turn.u_mm_s, turn.v_mm_s, turn.yaw_rate_rad_s] == pytest.approx(end[3:], rel=1e-6, abs=1e-6)
        assert any(other.stable for other in steady_turns(robot, 33.3, 14.4))
        assert turn.wheels.slip_ratio.shape == (len(robot.wheel_names),)


def test_two_driven_wheels_and_a_ball_turn_as_they_roll() -> None:
    # Nothing but inertia resists: wheels that hardly slip set the turn, R = B/2·(n_L + n_R)/(n_R - n_L).
    turn = steady_turn(load_robot("two_driven_caster"), 33.3, 14.4)
    assert turn.radius_mm == pytest.approx(2.0 * (33.3 + 14.4) / (14.4 - 33.3), rel=1e-4)
    assert turn.wheels.lateral_force_mN[2] == turn.wheels.longitudinal_force_mN[2] == 0.0


def test_casters_carry_load_without_friction() -> None:
    robot = robot_with([*pair(0.0), ball(-3.0, 0.0)], {"center_of_gravity_mm": [-1.0, 0.0]})
    model = compile_robot(robot)
    grip = model["grip_y"][0]
    each = robot.slip.lateral_friction * robot.weight_uN / 3
    assert grip == pytest.approx([each, each, 0.0, 0.0])
    assert model["grip_x"][0, 2:].tolist() == [0.0, 0.0]


def test_a_wheel_may_have_a_slip_law_of_its_own() -> None:
    slip = load_robot("barrel").slip.model_dump() | {"lateral_friction": 0.1, "longitudinal_friction": 0.1}
    first, *others = [*pair(2.0), *pair(-2.0)]
    common = compile_robot(robot_with([first, *others]))[0]
    own = compile_robot(robot_with([{**first, "slip": slip}, *others]))[0]
    assert own["grip_y"][0] == pytest.approx(0.1 * robot_with([first, *others]).weight_uN / 4)
    assert own["grip_y"][1:].tolist() == common["grip_y"][1:].tolist()


def test_columns_of_a_run_bear_the_names_of_the_wheels() -> None:
    table = simulate(load_robot("six_driven"), THERE_AND_BACK, TIMES_S).to_table()
    assert "middle_left_slip_ratio" in table
    assert "rear_right_lateral_force_mN" in table
    assert len(table.columns) == 7 + 6 * 4


def test_wheels_of_other_names_and_in_another_order_make_the_same_run() -> None:
    robot = listed(load_robot("barrel"))
    renamed = tuple(wheel.model_copy(update={"name": f"w{k}"}) for k, wheel in enumerate(robot.wheel or ()))
    other = robot.model_copy(update={"wheel": renamed[::-1]})
    here, there = (simulate(one, THERE_AND_BACK, TIMES_S) for one in (robot, other))
    assert there.wheel_names == ("w3", "w2", "w1", "w0")
    np.testing.assert_allclose(states(there), states(here), rtol=1e-7, atol=1e-7)


def test_robots_of_different_layouts_make_one_batch() -> None:
    robots = [load_robot(name) for name in LAYOUTS]
    batch = simulate_batch(robots, [THERE_AND_BACK], TIMES_S)
    for number, robot in enumerate(robots):
        alone = states(simulate(robot, THERE_AND_BACK, TIMES_S))
        size = np.abs(alone).max(axis=0)
        assert np.abs(batch.states[number] - alone).max(axis=0) == pytest.approx(np.zeros(6), abs=1e-6 * size.max())


def test_effects_follow_the_wheels_that_are_driven() -> None:
    six = load_robot("six_driven")
    toe = compile_robot(affected(six, "wheel-toe", left_deg=2.0, right_deg=-1.0))[0]["steer"][:6]
    assert np.degrees(toe) == pytest.approx([2.0, -1.0] * 3)
    loads = [
        compile_robot(robot)[0]["grip_y"][:6] for robot in (six, affected(six, "magnet-strength", driving_factor=2.0))
    ]
    assert loads[1] - loads[0] == pytest.approx(np.full(6, 22050 * six.slip.lateral_friction))
    draggy = robot_with([*pair(2.0), *pair(-2.0, driven=False), ball(-4.0, 0.0)])
    drag = compile_robot(affected(draggy, "rolling-drag", coefficient=0.1))[0]
    assert drag["wheel_terms"] == 2
    assert np.flatnonzero(drag["pattern"][:2].sum(axis=0)).tolist() == [2, 3]
    with pytest.raises(SimulationError, match="3 positions of x"):
        compile_robot(affected(six, "axle-compliance", deg_per_mN=0.1))


def test_units_are_those_of_the_suffix() -> None:
    text = shipped_robot_text("barrel")
    for old, new in (
        ("mass_g = 0.5", "mass_kg = 0.0005"),
        ("length_mm = 5.0", "length_m = 0.005"),
        ("wheelbase_mm = 4.0", "wheelbase_m = 0.004"),
        ("driving_wheel_mN = 22.05", "driving_wheel_N = 0.02205"),
        ("green_mm = [-1.55, 1.83]", "green_m = [-0.00155, 0.00183]"),
    ):
        assert old in text
        text = text.replace(old, new)
    band = '\n[[effect]]\nid = "dead-band"\nrad_s = 0.5\n[[effect]]\nid = "tether-pull"\nx_N = 0.001\n'
    robot, barrel = Robot.model_validate(tomllib.loads(text + band)), load_robot("barrel")
    for table in ("body", "wheels", "magnetic_attraction", "marks"):
        found, wanted = getattr(robot, table).model_dump(), getattr(barrel, table).model_dump()
        assert found == {name: value if value is None else pytest.approx(value) for name, value in wanted.items()}
    assert robot.effect[0].given["rpm"] == pytest.approx(0.5 * 60 / (2 * np.pi))
    assert robot.effect[1].given["x_mN"] == pytest.approx(1.0)


def test_a_value_in_two_units_is_an_error() -> None:
    text = shipped_robot_text("barrel").replace("mass_g = 0.5", "mass_g = 0.5\nmass_kg = 0.0005")
    with pytest.raises(ValidationError, match="mass_g and mass_kg are both given"):
        Robot.model_validate(tomllib.loads(text))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"name": "right_2"}, "the name right_2 is used for two"),
        ({"driven_by": "none"}, 'no .*driven_by = "left"'),
        ({"support": "ball"}, 'a ball is driven by "none"'),
        ({"name": "left,2"}, "should match pattern"),
    ],
)
def test_faults_of_a_list_are_named(change: dict[str, object], message: str) -> None:
    first, *others = [*pair(2.0), *pair(-2.0, driven=False)]
    with pytest.raises(ValidationError, match=message):
        robot_with([{**first, **change}, *others])


def test_wheels_and_a_list_of_wheels_exclude_each_other() -> None:
    content = load_robot("barrel").model_dump(exclude_none=True)
    with pytest.raises(ValidationError, match=r"both \[wheels\] and \[\[wheel\]\]"):
        Robot.model_validate({**content, "wheel": pair(2.0)})
    del content["wheels"]
    with pytest.raises(ValidationError, match=r"neither \[wheels\] nor \[\[wheel\]\]"):
        Robot.model_validate(content)
    with pytest.raises(ValidationError, match="attraction_mN"):
        Robot.model_validate({**content, "wheel": [*pair(2.0), *pair(-2.0)]})


@pytest.mark.parametrize("name", shipped_robots())
def test_every_shipped_robot_runs_and_turns_to_the_slower_side(name: str) -> None:
    run = simulate(load_robot(name), Command.constant(33.3, 14.4), TIMES_S)
    assert run.yaw_rate_rad_s[-1] < 0 < run.u_mm_s[-1]


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("slip.lateral_frction", "did you mean slip.lateral_friction"),
        ("wheels.radius_mm", "not a number of this robot"),
    ],
)
def test_a_tolerance_of_nothing_is_an_error(key: str, message: str) -> None:
    text = f'{shipped_robot_text("six_driven")}\n[tolerance]\n"{key}" = 0.05\n'
    with pytest.raises(ValidationError, match=message):
        Robot.model_validate(tomllib.loads(text))
