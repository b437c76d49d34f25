"""Every effect of the contract acts as its file says, is absent where its file says so, and is checked on reading."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from simulator.command import Command
from simulator.dynamics.model import compile_robot
from simulator.effects.catalogue import BUILT_IN, EFFECTS
from simulator.effects.free_form import ID as FREE_FORM
from simulator.observation import marks_of_run
from simulator.robot import Robot, load_robot
from simulator.run import Run, State
from simulator.simulation import simulate
from simulator.steady import steady_turn
from tests.simulator.effect_probe import affected
from tests.simulator.effect_steps import MOVED

TIMES_S = np.linspace(0.0, 3.0, 31)
TURN = Command.steps([(0.0, 33.3, 14.4), (1.5, -20.0, -30.0)])
START = State(3.0, -2.0, 0.7)
CONTRACT = {
    "drive-speed-mismatch": "left_over_right",
    "drive-speed-scale": "factor",
    "motor-droop": "rpm_per_uN_mm",
    "command-lag": "dead_time_s time_constant_s",
    "speed-limit": "wheel_rpm ahead_rpm turn_rpm",
    "acceleration-limit": "ahead_rpm_s turn_rpm_s wheel_rpm_s",
    "friction-across": "factor",
    "sliding-friction": "share",
    "speed-ripple": "amplitude phase_deg",
    "dead-band": "rpm",
    "speed-drift": "per_run",
    "magnet-imbalance": "left_over_right",
    "magnet-strength": "driving_factor driven_factor",
    "friction-level": "factor",
    "wheel-toe": "left_deg right_deg",
    "rolling-drag": "coefficient",
    "scrub-torque": "radius_mm",
    "axle-compliance": "deg_per_mN",
    "mass-offset": "x_mm y_mm",
    "plate-tilt": "angle_deg azimuth_deg",
    "tether-pull": "x_mN y_mN",
    "tether-spring": "stiffness_mN_mm anchor_x_mm anchor_y_mm",
    "viscous-drag": "force_mN_s_mm moment_uN_mm_s",
    "friction-gradient": "per_mm_x per_mm_y",
    "friction-grain": "amplitude direction_deg",
    "stray-magnet": "force_mN x_mm y_mm exponent",
    "mark-offset": "x_mm y_mm angle_deg",
    "plane-scale": "factor",
    "time-base": "factor",
    "camera-tilt": "per_mm_x per_mm_y perspective",
    "rolling-shutter": "x_ms_per_mm y_ms_per_mm",
}


def moved(robot: Robot, command: Command = TURN, run_index: int = 3) -> Run:
    return simulate(robot, command, TIMES_S, START, run_index)


def path(run: Run) -> np.ndarray:
    return np.stack([run.x_mm, run.y_mm, 5 * run.heading_rad])


@pytest.fixture(scope="module")
def barrel() -> Robot:
    return load_robot("barrel")


def test_catalogue_holds_the_effects_and_parameters_of_the_contract_and_the_perspective_of_a_tilted_camera() -> None:
    names = {id_: " ".join(item.name for item in effect.parameters) for id_, effect in BUILT_IN.items()}
    assert {id_: names.get(id_) for id_ in CONTRACT} == CONTRACT


@pytest.mark.parametrize("id_", CONTRACT)
def test_effect_at_its_absent_value_changes_nothing(barrel: Robot, id_: str) -> None:
    robot = affected(barrel, id_, **EFFECTS[id_].absent())
    assert compile_robot(robot, 3).tobytes() == compile_robot(barrel, 3).tobytes()
    assert marks_of_run(robot, moved(barrel)).equals(marks_of_run(barrel, moved(barrel)))


def visible(id_: str) -> dict[str, float]:
    """Parameters of an effect; directions and places matter only where there is a size to point."""
    sizes = {
        "amplitude": 0.1,
        "angle_deg": 2.0,
        "stiffness_mN_mm": 0.02,
        "force_mN": 0.5,
        "rpm": 25.0,
        "dead_time_s": 0.0,
        "wheel_rpm": 25.0,
        "ahead_rpm": 20.0,
        "turn_rpm": 8.0,
        "ahead_rpm_s": 40.0,
        "turn_rpm_s": 20.0,
        "wheel_rpm_s": 55.0,
    }
    base = {item.name: sizes.get(item.name, item.absent) for item in EFFECTS[id_].parameters}
    if id_ == "stray-magnet":  # far enough from the path to pull, not to catch
        base |= {"x_mm": 12.0, "y_mm": 8.0}
    if id_ == "camera-tilt":  # perspective is of second order in the tilt
        base |= {"per_mm_x": 0.01}
    return base


@pytest.mark.parametrize("id_", CONTRACT)
def test_ten_steps_of_every_parameter_of_every_effect_move_the_marks_visibly(barrel: Robot, id_: str) -> None:
    effect, base = EFFECTS[id_], visible(id_)
    measured = 0 if id_ == "time-base" else slice(1, None)  # times, or marks
    for item, expected in zip(effect.parameters, MOVED[id_], strict=True):
        seen = []
        for value in (base[item.name], base[item.name] + 10 * item.step):
            robot = affected(barrel, id_, **(base | {item.name: value}))
            seen.append(marks_of_run(robot, moved(robot)).to_numpy()[:, measured])
        assert 1e3 * np.sqrt(np.mean((seen[1] - seen[0]) ** 2)) == pytest.approx(expected, rel=0.05), item.name


@pytest.mark.parametrize("id_", CONTRACT)
def test_effects_of_the_plate_change_a_motion_begun_elsewhere_and_others_do_not(id_: str, barrel: Robot) -> None:
    absent, base = EFFECTS[id_].absent(), visible(id_)
    grown = {item.name: item.absent + 10 * item.step for item in EFFECTS[id_].parameters}
    robot = affected(barrel, id_, **{name: grown[name] if base[name] == absent[name] else base[name] for name in base})
    seen = []
    for start in (State(0.0, 0.0, 0.0), State(4.0, -3.0, 2.0)):
        table = marks_of_run(robot, simulate(robot, TURN, TIMES_S, start, 3)).to_numpy()[:, 1:3]
        off, cos, sin = table - (start.x_mm, start.y_mm), math.cos(start.heading_rad), math.sin(start.heading_rad)
        seen.append(off @ np.array([[cos, -sin], [sin, cos]]))
    way = seen[1] - seen[0]
    assert (np.abs(way - way[0]).max() > 1e-3) == EFFECTS[id_].of_plate  # a scale about the origin shifts all alike


def test_tilted_plate_pulls_a_resting_robot_nowhere_and_a_rolling_one_downhill(barrel: Robot) -> None:
    robot = affected(barrel, "plate-tilt", angle_deg=10.0, azimuth_deg=90.0)
    resting = simulate(robot, Command.constant(0, 0), TIMES_S)
    assert np.hypot(resting.x_mm, resting.y_mm).max() < 1e-3
    straight = simulate(robot, Command.constant(30, 30), TIMES_S)
    assert straight.y_mm[-1] > 0.005


def test_pull_fixed_in_the_body_makes_forward_and_backward_turns_differ(barrel: Robot) -> None:
    pulled = affected(barrel, "tether-pull", x_mN=1.0, y_mN=0.5)
    forward, backward = (abs(steady_turn(pulled, 33.3 * way, 14.4 * way).radius_mm) for way in (1, -1))
    assert abs(forward / backward - 1) > 0.01


CONTRACT_LAW = {
    "longitudinal_friction": 0.15,
    "lateral_friction": 0.25,
    "friction_decrease": 0.2,
    "longitudinal_shape": 1.0,
    "lateral_shape": 0.8,
    "longitudinal_stiffness": 1.643,
    "lateral_stiffness": 5.113,
}


def test_compliant_axles_make_backward_turns_half_a_percent_tighter(barrel: Robot) -> None:
    # Model notes, checked for the law of the file contract.
    slip = barrel.slip.model_copy(update=CONTRACT_LAW)
    robot = affected(barrel.model_copy(update={"slip": slip}), "axle-compliance", deg_per_mN=1.1)
    forward, backward = (abs(steady_turn(robot, 33.3 * way, 14.4 * way).radius_mm) for way in (1, -1))
    assert backward / forward == pytest.approx(1 - 0.005, abs=0.0005)


@pytest.mark.parametrize("deg_per_mN", [0.3, 1.1, 3.0])
@pytest.mark.parametrize("rpm", [(33.3, 14.4), (-33.3, -14.4), (33.0, 29.0), (60.0, -40.0)])
def test_axles_turn_by_compliance_times_the_lateral_force_on_their_wheels(
    barrel: Robot, deg_per_mN: float, rpm: tuple[float, float]
) -> None:
    robot = affected(barrel, "axle-compliance", deg_per_mN=deg_per_mN)
    robot = affected(robot, "tether-pull", x_mN=0.3, y_mN=0.6)
    turn = steady_turn(robot, *rpm)
    axles = np.array([2.0, 2.0, -2.0, -2.0])
    sides = np.array([2.0, -2.0, 2.0, -2.0])
    u, v = turn.u_mm_s - turn.yaw_rate_rad_s * sides, turn.v_mm_s + turn.yaw_rate_rad_s * axles
    wheels = turn.wheels
    forward = np.where(u < 0, -1.0, 1.0)
    steer = np.arctan2(forward * v, forward * u) - forward * wheels.slip_angle_rad
    force = np.repeat(wheels.lateral_force_mN.reshape(2, 2).sum(axis=1), 2)
    assert np.degrees(steer) == pytest.approx(deg_per_mN * force, rel=1e-6, abs=1e-9)


def test_speed_mismatch_is_a_change_of_one_command_with_the_mean_kept(barrel: Robot) -> None:
    ratio = 1.04
    robot = affected(barrel, "drive-speed-mismatch", left_over_right=ratio)
    factors = np.array([2 * ratio / (1 + ratio), 2 / (1 + ratio)])
    assert np.mean(factors) == pytest.approx(1)
    same = moved(barrel, Command.steps([(0.0, 33.3 * factors[0], 14.4 * factors[1]), (1.5, *(-20.0, -30.0) * factors)]))
    assert np.allclose(path(moved(robot)), path(same), atol=1e-9)


def test_friction_level_alone_leaves_the_stiffness(barrel: Robot) -> None:
    low, high = (compile_robot(affected(barrel, "friction-level", factor=f))[0] for f in (0.5, 2.0))
    for axis in "xy":
        assert np.allclose(low[f"grip_{axis}"] * low[f"steep_{axis}"], high[f"grip_{axis}"] * high[f"steep_{axis}"])


def test_droop_solves_speed_and_force_together(barrel: Robot) -> None:
    droop = 2e-3
    robot = affected(barrel, "motor-droop", rpm_per_uN_mm=droop)
    turn = steady_turn(robot, 33.3, 14.4)
    torque = 1000 * turn.wheels.longitudinal_force_mN[:2] * robot.wheels.radius_mm
    left, right = np.array([33.3, 14.4]) - droop * torque
    assert steady_turn(barrel, left, right).radius_mm == pytest.approx(turn.radius_mm, rel=1e-9)


def test_lag_and_dead_time_delay_the_distance_by_their_sum(barrel: Robot) -> None:
    robot = affected(barrel, "command-lag", dead_time_s=0.1, time_constant_s=0.05)
    command = Command.constant(30.0, 30.0)
    late = (moved(barrel, command).x_mm[-1] - moved(robot, command).x_mm[-1]) / np.cos(START.heading_rad)
    assert late / moved(barrel, command).u_mm_s[-1] == pytest.approx(0.15, abs=2e-4)


def test_ripple_repeats_with_the_wheel_and_averages_out(barrel: Robot) -> None:
    robot = affected(barrel, "speed-ripple", amplitude=0.1, phase_deg=30.0)
    times = np.linspace(0.0, 4.0, 401)  # 60 rpm: one revolution a second
    run = simulate(robot, Command.constant(60.0, 60.0), times)
    speed = run.u_mm_s[100:]
    rolling = 2 * np.pi * 0.5
    assert speed.max() / rolling == pytest.approx(1.1, abs=2e-3)
    assert np.allclose(speed[:100], speed[100:200], atol=1e-4)
    assert (run.x_mm[-1] - run.x_mm[100]) / 3 == pytest.approx(rolling, rel=1e-3)


def test_dead_band_silences_small_commands_and_cuts_ramps_where_they_cross(barrel: Robot) -> None:
    robot = affected(barrel, "dead-band", rpm=10.0)
    assert np.hypot(*path(simulate(robot, Command.constant(9.9, 9.9), TIMES_S))[:2]).max() == 0
    ramp = simulate(robot, Command.ramp(30.0, 30.0, 0.0, 3.0), TIMES_S)
    assert ramp.u_mm_s[9] == 0
    assert ramp.u_mm_s[11] == pytest.approx(11 * 2 * np.pi * 0.5 / 60, rel=1e-2)


def test_drift_grows_with_the_run_index(barrel: Robot) -> None:
    robot = affected(barrel, "speed-drift", per_run=0.01)
    lengths = [simulate(robot, Command.constant(30, 30), TIMES_S, run_index=index).x_mm[-1] for index in (0, 5)]
    assert lengths[1] / lengths[0] == pytest.approx(1.05, rel=1e-3)


def test_time_base_stretches_time_and_plane_scale_stretches_places(barrel: Robot) -> None:
    run = moved(barrel)
    plain = marks_of_run(barrel, run)
    late = marks_of_run(affected(barrel, "time-base", factor=1.02), run)
    wide = marks_of_run(affected(barrel, "plane-scale", factor=1.02), run)
    assert np.allclose(late["time_s"], 1.02 * plain["time_s"])
    assert np.allclose(wide.iloc[:, 1:], 1.02 * plain.iloc[:, 1:])


def test_free_form_term_is_the_named_effect_where_they_mean_the_same(barrel: Robot) -> None:
    named = affected(barrel, "tether-pull", x_mN=0.4, y_mN=0.0)
    free = affected(barrel, FREE_FORM, channel="force_forward", basis="one", coefficient=0.4)
    assert np.array_equal(path(moved(named)), path(moved(free)))


def test_friction_across_all_wheels_is_their_lateral_friction(barrel: Robot) -> None:
    across = affected(barrel, FREE_FORM, channel="friction_across", basis="one", coefficient=0.2)
    lateral = 1.2 * barrel.slip.lateral_friction
    robot = barrel.model_copy(update={"slip": barrel.slip.model_copy(update={"lateral_friction": lateral})})
    assert np.abs(path(moved(across)) - path(moved(robot))).max() < 1e-5


def test_errors_of_the_camera_leave_the_robot_alone_and_move_its_marks(barrel: Robot) -> None:
    run, plain = moved(barrel), marks_of_run(barrel, moved(barrel))
    lens = affected(barrel, FREE_FORM, channel="camera_x", basis="x_r_squared", coefficient=1e-5)
    assert np.array_equal(path(moved(lens)), path(run))
    x, y = plain["green_x_mm"], plain["green_y_mm"]
    assert np.allclose(marks_of_run(lens, run)["green_x_mm"], x + 1e-5 * x * (x**2 + y**2), atol=1e-12)


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ('id = "tilt"\nangle_deg = 1.0', "did you mean plate-tilt?"),
        ('id = "plate-tilt"\nangle = 1.0', "did you mean angle_deg?"),
        ('id = "plate-tilt"\nangle_deg = "steep"', "not a finite number"),
        ('id = "friction-level"\nfactor = -1.0', "at least"),
        ('id = "friction-level"', "it takes factor"),
        (
            'id = "free-form"\nchannel = "forward"\nbasis = "one"\ncoefficient = 1.0',
            "did you mean force_forward?",
        ),
        ('id = "free-form"\nchannel = "moment"\nbasis = "heading"\ncoefficient = 1.0', "did you mean sin_heading?"),
        ('id = "free-form"\nchannel = "moment"\nbasis = "qq"\ncoefficient = 1.0', "it is one of "),
        ('id = "free-form"\nchannel = "moment"\nbasis = "one"\ncoef = 1.0', "did you mean coefficient?"),
        ('id = "free-form"\nchannel = "camera_x"\nbasis = "u"\ncoefficient = 1.0', "does not take basis u"),
        ('id = "free-form"\nchannel = "moment"\nbasis = "x_r_squared"\ncoefficient = 1.0', "does not take basis"),
        ('id = "time-base"\nfactor = 1.0\n[[effect]]\nid = "time-base"\nfactor = 1.1', "defined twice"),
    ],
)
def test_faulty_effect_is_refused_with_the_nearest_remedy(tmp_path: Path, entry: str, said: str) -> None:
    from evaluator.errors import InputError
    from evaluator.files import read_with

    text = (Path(__file__).parents[2] / "simulator" / "robots" / "barrel.toml").read_text(encoding="utf-8")
    path_ = tmp_path / "robot.toml"
    path_.write_text(f"{text}\n[[effect]]\n{entry}\n", encoding="utf-8")
    with pytest.raises(InputError, match="effect") as caught:
        read_with(load_robot, path_)
    assert said in str(caught.value)
