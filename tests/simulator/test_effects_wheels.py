"""Laws of effects of motors, wheels and friction, worked out on paper, with their signs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from simulator.command import Command
from simulator.dynamics.model import compile_robot
from simulator.dynamics.wheel import COS_STEER, GRIP_X, GRIP_Y, SIN_STEER, STEEP_X, STEEP_Y
from simulator.robot import Robot, load_robot
from simulator.run import State
from simulator.simulation import simulate
from simulator.steady import steady_turn
from tests.simulator.effect_probe import affected, contacts, wheel_loads, with_effects

PER_RPM = 2 * math.pi * 0.5 / 60  # surface speed of a wheel of 0.5 mm, mm/s
WEIGHT_SHARE_UN, DRIVING_UN, DRIVEN_UN = 1225.0, 22050.0, 2450.0


@pytest.fixture(scope="module")
def barrel() -> Robot:
    return load_robot("barrel")


def surface_speeds(robot: Robot, run_index: int = 0) -> np.ndarray:
    """Left and right, mm/s per rpm."""
    return np.array(compile_robot(robot, run_index)[0]["speed"])


def test_speed_mismatch_is_the_ratio_left_over_right_at_the_same_mean(barrel: Robot) -> None:
    left, right = surface_speeds(affected(barrel, "drive-speed-mismatch", left_over_right=1.5))
    assert left / right == pytest.approx(1.5)
    assert (left + right) / 2 == pytest.approx(PER_RPM)


def test_speed_scale_is_a_factor_of_both_speeds(barrel: Robot) -> None:
    assert surface_speeds(affected(barrel, "drive-speed-scale", factor=0.9)) == pytest.approx([0.9 * PER_RPM] * 2)


def test_speed_drift_counts_runs_from_0_and_never_reverses(barrel: Robot) -> None:
    robot = affected(barrel, "speed-drift", per_run=-0.02)
    found = [surface_speeds(robot, run)[0] / PER_RPM for run in (0, 1, 10, 1000)]
    assert found == pytest.approx([1.0, 0.98, 0.8, 0.01])


def test_mismatch_scale_and_drift_multiply(barrel: Robot) -> None:
    robot = affected(affected(barrel, "drive-speed-scale", factor=0.9), "speed-drift", per_run=0.1)
    robot = affected(robot, "drive-speed-mismatch", left_over_right=3.0)
    assert surface_speeds(robot, 2) == pytest.approx(PER_RPM * 0.9 * 1.2 * np.array([1.5, 0.5]))


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_motor_that_pulls_a_load_turns_slower_and_one_that_is_pushed_faster(barrel: Robot, way: float) -> None:
    """Straight on at 30 rpm against 2 mN, each wheel pulls 1 mN at 0.5 mm: 500 µN·mm, at 0.01 rpm each, 5 rpm."""
    robot = affected(affected(barrel, "motor-droop", rpm_per_uN_mm=0.01), "tether-pull", x_mN=-2.0 * way, y_mN=0.0)
    slow = steady_turn(affected(barrel, "tether-pull", x_mN=-2.0 * way, y_mN=0.0), 30.0 - 5.0 * way, 30.0 - 5.0 * way)
    turn = steady_turn(robot, 30.0, 30.0)
    assert turn.wheels.longitudinal_force_mN[:2] == pytest.approx([way, way], rel=1e-6)
    assert turn.u_mm_s == pytest.approx(slow.u_mm_s, rel=1e-9)


def test_command_lag_waits_and_then_closes_the_gap_exponentially(barrel: Robot) -> None:
    """Nothing before the dead time, 1 - 1/e one time constant after it, 1 - 1/e² two."""
    robot = affected(barrel, "command-lag", dead_time_s=0.2, time_constant_s=0.3)
    command = Command.constant(30.0, 30.0, start_s=0.1)
    speed = simulate(robot, command, np.array([0.0, 0.29, 0.6, 0.9])).u_mm_s / (30 * PER_RPM)
    assert speed == pytest.approx([0.0, 0.0, 1 - math.exp(-1), 1 - math.exp(-2)], abs=2e-3)


def test_lags_add_up_where_two_act(barrel: Robot) -> None:
    from simulator.dynamics.model import record_of
    from simulator.effects.catalogue import EFFECTS
    from simulator.effects.draft import Draft

    parts = {
        "command-lag": ({"dead_time_s": 0.2, "time_constant_s": 0.3}, {"dead_time_s": 0.1, "time_constant_s": 0.1}),
        "motor-droop": ({"rpm_per_uN_mm": 0.01}, {"rpm_per_uN_mm": 0.02}),
        "axle-compliance": ({"deg_per_mN": 1.0}, {"deg_per_mN": -0.4}),
        "wheel-toe": ({"left_deg": 1.0, "right_deg": 2.0}, {"left_deg": 3.0, "right_deg": -1.0}),
    }
    for id_, (one, other) in parts.items():
        act, draft = EFFECTS[id_].act, Draft(barrel)
        assert act is not None
        act(draft, one)
        act(draft, other)
        whole = affected(barrel, id_, **{name: one[name] + other[name] for name in one})
        found, expected = record_of(draft)[0], compile_robot(whole)[0]
        for name in ("dead_time", "lag", "droop", "compliance", "steer"):
            assert found[name] == pytest.approx(expected[name]), id_


def test_speed_ripple_is_a_sine_of_the_wheels_angle_from_its_phase(barrel: Robot) -> None:
    """At 60 rpm a revolution a second: a quarter of it after 0.25 s. sin 30, sin 120, sin 210, sin 300 degrees."""
    robot = affected(barrel, "speed-ripple", amplitude=0.1, phase_deg=30.0)
    quarters = simulate(robot, Command.constant(60.0, 60.0), np.array([0.0, 1.0, 1.25, 1.5, 1.75])).u_mm_s[1:]
    sines = np.array([0.5, math.sqrt(0.75), -0.5, -math.sqrt(0.75)])
    assert quarters / (60 * PER_RPM) == pytest.approx(1 + 0.1 * sines, abs=1e-3)


def test_dead_band_ends_at_the_command_of_its_size(barrel: Robot) -> None:
    robot = affected(barrel, "dead-band", rpm=10.0)
    rest, moves = (simulate(robot, Command.constant(rpm, rpm), np.array([0.0, 1.0])).x_mm[-1] for rpm in (-9.9, -10.0))
    assert rest == 0
    assert moves == pytest.approx(-10 * PER_RPM, rel=1e-3)


def test_of_two_dead_bands_the_wider_holds(barrel: Robot) -> None:
    from simulator.effects.catalogue import EFFECTS
    from simulator.effects.draft import Draft

    act, draft = EFFECTS["dead-band"].act, Draft(barrel)
    assert act is not None
    for rpm in (3.0, 7.0, 5.0):
        act(draft, {"rpm": rpm})
    assert draft.dead_band_rpm == 7.0


def test_a_limited_drive_goes_no_faster_than_its_limit_and_as_told_below_it(barrel: Robot) -> None:
    robot = affected(barrel, "speed-limit", wheel_rpm=20.0)
    speeds = [steady_turn(robot, rpm, rpm).u_mm_s / PER_RPM for rpm in (12.0, 30.0, -30.0)]
    assert speeds == pytest.approx([12.0, 20.0, -20.0], rel=1e-6)


@pytest.mark.parametrize("limited", [{"ahead_rpm_s": 60.0}, {"wheel_rpm_s": 60.0}])
def test_a_drive_of_limited_acceleration_is_late_by_half_the_time_that_its_speed_takes_and_no_slower(
    limited: dict[str, float], barrel: Robot
) -> None:
    """30 rpm at 60 rpm/s take half a second, in which the way of a quarter of a second is lost."""
    robot = affected(barrel, "acceleration-limit", **limited)
    late, told = (
        simulate(item, Command.constant(30.0, 30.0), np.array([0.0, 2.0, 3.0])).x_mm for item in (robot, barrel)
    )
    assert told[1] - late[1] == pytest.approx(0.25 * 30 * PER_RPM, rel=1e-3)
    assert late[2] - late[1] == pytest.approx(30 * PER_RPM, rel=1e-4)


def test_of_two_accelerations_the_lower_holds(barrel: Robot) -> None:
    from simulator.effects.catalogue import EFFECTS
    from simulator.effects.draft import Draft

    act, draft = EFFECTS["acceleration-limit"].act, Draft(barrel)
    assert act is not None
    for wheel, ahead, turn in ((80.0, 40.0, 1e6), (1e6, 50.0, 20.0)):
        act(draft, {"wheel_rpm_s": wheel, "ahead_rpm_s": ahead, "turn_rpm_s": turn})
    assert draft.ramps_s_per_rpm == (1 / 40, 1 / 20, 1 / 80)


def test_a_steady_turn_is_that_of_the_sides_as_the_drive_mixes_them(barrel: Robot) -> None:
    """A quarter of the right command added to the left: 24 and 16 rpm told are 28 and 16 turned."""
    mixed = with_effects(
        barrel, {"id": "free-form", "channel": "left_drive", "basis": "right_command", "coefficient": 0.25}
    )
    found, expected = steady_turn(mixed, 24.0, 16.0), steady_turn(barrel, 28.0, 16.0)
    assert found.yaw_rate_rad_s == pytest.approx(expected.yaw_rate_rad_s, rel=1e-6)


def test_of_two_limits_the_lower_holds(barrel: Robot) -> None:
    from simulator.effects.catalogue import EFFECTS
    from simulator.effects.draft import Draft

    act, draft = EFFECTS["speed-limit"].act, Draft(barrel)
    assert act is not None
    for wheel, ahead, turn in ((30.0, 9.0, 1e6), (25.0, 12.0, 8.0), (40.0, 1e6, 1e6)):
        act(draft, {"wheel_rpm": wheel, "ahead_rpm": ahead, "turn_rpm": turn})
    assert draft.limits_rpm == (25.0, 9.0, 8.0)


def test_magnet_imbalance_moves_attraction_from_the_right_driving_wheel_to_the_left(barrel: Robot) -> None:
    """Three to one of twice 22050 µN: 33075 and 11025, on top of the weight; the rear pair keeps its own."""
    loads = wheel_loads(affected(barrel, "magnet-imbalance", left_over_right=3.0))
    assert loads - WEIGHT_SHARE_UN == pytest.approx([33075.0, 11025.0, DRIVEN_UN, DRIVEN_UN])


def test_magnet_strength_scales_the_attraction_of_each_axle_and_not_the_weight(barrel: Robot) -> None:
    loads = wheel_loads(affected(barrel, "magnet-strength", driving_factor=0.5, driven_factor=3.0))
    assert loads - WEIGHT_SHARE_UN == pytest.approx([0.5 * DRIVING_UN] * 2 + [3 * DRIVEN_UN] * 2)
    both = affected(affected(barrel, "magnet-strength", driving_factor=0.5), "magnet-imbalance", left_over_right=3.0)
    assert wheel_loads(both) - WEIGHT_SHARE_UN == pytest.approx([33075.0 / 2, 11025.0 / 2, DRIVEN_UN, DRIVEN_UN])


def test_friction_level_scales_the_limit_of_the_force_and_leaves_the_slope(barrel: Robot) -> None:
    nominal, changed = compile_robot(barrel)[0], compile_robot(affected(barrel, "friction-level", factor=1.5))[0]
    for axis in "xy":
        assert changed[f"grip_{axis}"] == pytest.approx(1.5 * nominal[f"grip_{axis}"])
        slope = nominal[f"grip_{axis}"] * nominal[f"steep_{axis}"]
        assert changed[f"grip_{axis}"] * changed[f"steep_{axis}"] == pytest.approx(slope)


def test_toe_turns_each_driving_wheel_counter_clockwise(barrel: Robot) -> None:
    """A wheel that is turned to the left of its motion is pushed to the left, one turned to the right, to the right."""
    robot = affected(barrel, "wheel-toe", left_deg=3.0, right_deg=-2.0)
    found = contacts(robot, velocity=(2.0, 0.0, 0.0))
    assert np.degrees(np.arctan2(found[SIN_STEER], found[COS_STEER])) == pytest.approx([3.0, -2.0, 0.0, 0.0])
    alike = affected(barrel, "wheel-toe", left_deg=3.0, right_deg=3.0)
    run = simulate(alike, Command.constant(30.0, 30.0), np.array([0.0, 0.1]))
    assert run.yaw_rate_rad_s[-1] > 0


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_axles_turn_toward_the_force_on_them(barrel: Robot, way: float) -> None:
    """Pulled to the right in straight motion, wheels are pushed to the left: the angle is that of slip and force."""
    robot = affected(affected(barrel, "axle-compliance", deg_per_mN=2.0), "tether-pull", x_mN=0.0, y_mN=-0.5)
    turn = steady_turn(robot, 30.0 * way, 30.0 * way)
    u, v = turn.u_mm_s - turn.yaw_rate_rad_s * 2.0, turn.v_mm_s + turn.yaw_rate_rad_s * 2.0
    # Of the front left wheel; a wheel's slip angle is counted from the way it rolls.
    steer = math.degrees(math.atan2(way * v, way * u)) - way * math.degrees(turn.wheels.slip_angle_rad[0])
    force = turn.wheels.lateral_force_mN[:2].sum()
    assert force > 0
    assert steer == pytest.approx(2.0 * force, rel=1e-6)


@pytest.mark.parametrize("lag_s", [1e-3, 0.04])
def test_axles_that_yield_start_with_motors_that_lag(barrel: Robot, lag_s: float) -> None:
    """Once the motors have reached their speed, the robot is on the path of prompt motors, late by their lag."""
    time = np.arange(0, 2, 0.02)
    prompt = affected(barrel, "axle-compliance", deg_per_mN=1.5)
    lagging = affected(prompt, "command-lag", dead_time_s=0.0, time_constant_s=lag_s)
    found = simulate(lagging, Command.constant(30, 36, 0.4), time)
    early = simulate(prompt, Command.constant(30, 36, 0.4 + lag_s), time)
    for quantity in ("x_mm", "y_mm", "heading_rad"):
        np.testing.assert_allclose(getattr(found, quantity)[-20:], getattr(early, quantity)[-20:], atol=2e-3)
    assert found.x_mm[-1] > 2


def test_friction_gradient_is_that_of_the_place_of_each_wheel(barrel: Robot) -> None:
    """At (10, 20) looking along +y, the wheels are at x 10 ∓ 2 (left, right) and y 20 ± 2 (front, rear)."""
    robot = affected(barrel, "friction-gradient", per_mm_x=0.01, per_mm_y=-0.003)
    found = contacts(robot, (10.0, 20.0, math.pi / 2))
    factor = np.array([1 + 0.08 - 0.066, 1 + 0.12 - 0.066, 1 + 0.08 - 0.054, 1 + 0.12 - 0.054])
    for grip, steep in ((GRIP_X, STEEP_X), (GRIP_Y, STEEP_Y)):
        assert found[grip] == pytest.approx(factor)
        assert found[grip] * found[steep] == pytest.approx([1.0] * 4)


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize(("direction_deg", "factor"), [(0.0, 0.8), (90.0, 1.2), (135.0, 1.0), (60.0, 1.1)])
def test_friction_grain_is_largest_where_contacts_slide_along_it(
    barrel: Robot, way: float, direction_deg: float, factor: float
) -> None:
    """Rear wheels sliding along ±y of the plate: 1 + 0.2·cos 2(90° - direction)."""
    robot = affected(barrel, "friction-grain", amplitude=0.2, direction_deg=direction_deg)
    found = contacts(robot, velocity=(5.0, 0.1 * way, 0.0), rpm=(60.0, 60.0))
    assert found[GRIP_Y, 2:] == pytest.approx([factor, factor])


def test_friction_grain_lies_in_the_plate_and_turns_under_the_robot(barrel: Robot) -> None:
    """A driving wheel that spins on the spot slides backward; looking to 50°, along the grain of 50° (or 230°)."""
    robot = affected(barrel, "friction-grain", amplitude=0.2, direction_deg=50.0)
    for heading_deg, factor in ((50.0, 1.2), (140.0, 0.8), (80.0, 1.1)):
        found = contacts(robot, (0.0, 0.0, math.radians(heading_deg)), rpm=(60.0, 60.0))
        assert found[GRIP_X, :2] == pytest.approx([factor, factor])


def test_friction_by_place_and_by_direction_multiply(barrel: Robot) -> None:
    """At (10, 0) friction is 1.5 times as large, and along the grain 1.2 times."""
    graded = affected(barrel, "friction-gradient", per_mm_x=0.05, per_mm_y=0.0)
    robot = affected(graded, "friction-grain", amplitude=0.2, direction_deg=0.0)
    found = contacts(robot, (8.0, 0.0, 0.0), rpm=(60.0, 60.0))  # front wheels 2 mm ahead, spinning on the spot
    assert found[GRIP_X, :2] == pytest.approx([1.5 * 1.2] * 2)


@pytest.mark.parametrize(("direction_deg", "factor"), [(90.0, 1.2), (0.0, 0.8)])
def test_grain_acts_on_driven_wheels_along_their_axle_the_only_way_in_which_they_slide(
    barrel: Robot, direction_deg: float, factor: float
) -> None:
    # Straight along x under a pull to the left; the light rear gives way, along y as long as the heading stays.
    pulled = affected(barrel, "tether-pull", x_mN=0.0, y_mN=2.0)
    headings = [
        float(
            simulate(robot, Command.constant(30.0, 30.0), np.linspace(0.0, 0.3, 4), State(0.0, 0.0, 0.0)).heading_rad[
                -1
            ]
        )
        for robot in (
            pulled,
            affected(pulled, "friction-level", factor=factor),
            affected(pulled, "friction-grain", amplitude=0.2, direction_deg=direction_deg),
        )
    ]
    nominal, everywhere, grain = headings
    # The driving wheels slide a little along x too, so the grain does somewhat less than the level of friction.
    assert 0.5 < (grain - nominal) / (everywhere - nominal) < 1.0
