"""What motors do of a command: dead time, dead band and lag against a motor that is stepped through it."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from simulator.dynamics.model import compile_robot
from tests.simulator.dynamics.touching import barrel
from tests.simulator.effect_probe import affected
from tests.simulator.plain import plain

STEP_S = 1e-3
PER_RPM = 2 * math.pi / 60
# A step, a ramp through zero, a step at once with its end, a long rest at the last value.
KNOTS = np.array(
    [
        *([0.5, 10.0, -6.0], [1.0, 10.0, -6.0], [1.0, 30.0, -20.0], [2.0, -30.0, -4.0], [2.5, -3.0, 12.0]),
        *([2.5, 8.0, 12.0], [3.2, 8.0, 12.0]),
    ]
)
TIMES_S, SEEN_S = np.arange(0.0, 8.0, STEP_S), np.arange(0.1, 8.0, 0.097)
NO_MIX = np.zeros(8)
NO_LIMITS = np.full(3, 1e6)
NO_RAMPS = np.zeros(3)


def model_of(
    lag: float = 0.0,
    dead_band: float = 0.0,
    dead_time: float = 0.0,
    mix: np.ndarray = NO_MIX,
    limits: np.ndarray = NO_LIMITS,
    ramps: np.ndarray = NO_RAMPS,
) -> SimpleNamespace:
    return SimpleNamespace(lag=lag, dead_band=dead_band, dead_time=dead_time, mix=mix, limits=limits, ramps=ramps)


def driven(model: Any, begin: float, end: float, times: np.ndarray, knots: np.ndarray = KNOTS) -> np.ndarray:
    """Left and right rpm and angle (n, 4) from the segments, which follow each other without a gap."""
    motors = plain("motors")
    segments = motors.command_segments(knots, begin, end, model)
    assert segments[0, motors.BEGIN] == begin
    assert segments[-1, motors.END] == end
    np.testing.assert_array_equal(segments[1:, motors.BEGIN], segments[:-1, motors.END])
    rows = np.searchsorted(segments[:, motors.END], times, side="left")
    return np.array([motors.drive_at(segments[row], time, model.lag) for row, time in zip(rows, times, strict=True)])


def stepped(model: Any, begin: float, end: float, knots: np.ndarray = KNOTS) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) and rpm and angles (n, 4) of motors that follow the command in steps of a millisecond."""
    count = round((end + 2.0) / STEP_S)
    middle = -2.0 + STEP_S * (np.arange(count) + 0.5)
    told = [np.interp(middle - model.dead_time, *jumps_apart(knots, side)) for side in (0, 1)]
    both, sizes = np.array(told), np.abs(told)
    rpm, angle = [], []
    for side in (0, 1):
        weights = model.mix[4 * side : 4 * side + 4]
        value = both[side] + weights[:2] @ both + weights[2:] @ sizes
        value = np.where(np.abs(value) < model.dead_band, 0.0, value)
        if model.lag:
            keep = math.exp(-STEP_S / model.lag)
            value = lfilter([1 - keep], [1, -keep], value, zi=[keep * value[0]])[0]
        rpm.append(value)
        turned = PER_RPM * STEP_S * np.cumsum(value)
        angle.append(turned - np.interp(begin, middle + STEP_S / 2, turned))
    return middle + STEP_S / 2, np.array([*rpm, *angle]).T


def jumps_apart(knots: np.ndarray, side: int) -> tuple[np.ndarray, np.ndarray]:
    return knots[:, 0] + 1e-9 * np.arange(len(knots)), knots[:, 1 + side]


@pytest.mark.parametrize("begin", [0.0, 1.4])
@pytest.mark.parametrize("dead_time", [0.0, 0.25])
@pytest.mark.parametrize("dead_band", [0.0, 7.0])
@pytest.mark.parametrize("lag", [0.0, 0.01, 0.3])
def test_motors_follow_a_command_as_stepped_ones_do(
    lag: float, dead_band: float, dead_time: float, begin: float
) -> None:
    model = model_of(lag, dead_band, dead_time)
    times, expected = stepped(model, begin, 4.5)
    chosen = times > begin
    times, expected = times[chosen][7::97], expected[chosen][7::97]
    found = driven(model, begin, 4.5, times)
    reach = 0.1 if lag != 0.01 else 0.6  # a step late by a millisecond is a tenth of a lag of ten
    near_jump = np.abs(times[:, None] - dead_time - KNOTS[:, 0]).min(axis=1) < 2 * STEP_S
    np.testing.assert_allclose(found[~near_jump, :2], expected[~near_jump, :2], atol=reach)
    np.testing.assert_allclose(found[:, 2:], expected[:, 2:], atol=0.02)


def test_sides_that_mix_add_what_either_is_told_and_its_size() -> None:
    mix = np.array([0.1, 0.2, 0.3, -0.05, -0.2, 0.05, 0.0, 0.4])
    knots = np.array([[0.0, 10.0, -20.0], [9.0, 10.0, -20.0]])
    found = driven(model_of(mix=mix), 0.0, 2.0, np.array([1.0]), knots)[0]
    assert found[:2] == pytest.approx([10 + 1 - 4 + 3 - 1, -20 - 2 - 1 + 0 + 8])
    assert found[2:] == pytest.approx(PER_RPM * found[:2])


@pytest.mark.parametrize(
    ("limits", "told", "turned"),
    [
        ((20.0, 1e6, 1e6), (30.0, -10.0), (20.0, -10.0)),  # the left wheel alone
        ((1e6, 5.0, 1e6), (30.0, -10.0), (25.0, -15.0)),  # 10 ± 20: the common part becomes 5
        ((1e6, 1e6, 15.0), (30.0, -10.0), (25.0, -5.0)),  # half of the difference becomes 15
        ((1e6, 1e6, 15.0), (-10.0, 30.0), (-5.0, 25.0)),
        ((18.0, 5.0, 15.0), (-30.0, 10.0), (-18.0, 10.0)),  # -5 ∓ 15 is -20 and 10; the wheel then -18
        ((40.0, 40.0, 40.0), (30.0, -10.0), (30.0, -10.0)),
    ],
)
def test_limits_hold_what_is_common_then_the_difference_then_each_wheel(
    limits: tuple[float, float, float], told: tuple[float, float], turned: tuple[float, float]
) -> None:
    knots = np.array([[0.0, *told]])
    found = driven(model_of(limits=np.array(limits)), 0.0, 2.0, np.array([1.0]), knots)[0]
    assert found[:2] == pytest.approx(turned)


@pytest.mark.parametrize(("lag", "dead_time"), [(0.0, 0.0), (0.3, 0.25)])
@pytest.mark.parametrize("ramps", [(0.02, 0.0), (0.0, 0.01), (0.03, 0.08), (1e-4, 2e-4)])
def test_a_drive_follows_as_fast_as_its_acceleration_lets_it(
    ramps: tuple[float, float], lag: float, dead_time: float
) -> None:
    """Against common part and half difference that take one step at a time toward what they are told.

    Told to change sides, to stop half way, to ramp faster and slower than they may.
    """
    model = model_of(lag, dead_time=dead_time, ramps=np.array([*ramps, 0.0]))
    told = np.array([np.interp(TIMES_S, *jumps_apart(KNOTS, side)) for side in (0, 1)])
    parts = []
    for goal, ramp in zip((told.sum(axis=0) / 2, (told[1] - told[0]) / 2), ramps, strict=True):
        most, now = STEP_S / ramp if ramp else math.inf, goal[0]
        parts.append([now := now + min(max(value - now, -most), most) for value in goal])
    common, half = np.array(parts)
    knots = np.column_stack([TIMES_S, common - half, common + half])
    expected = driven(model_of(lag, dead_time=dead_time), 0.0, 8.0, SEEN_S, knots)
    found = driven(model, 0.0, 8.0, SEEN_S)
    np.testing.assert_allclose(found[:, 2:], expected[:, 2:], atol=0.03)
    np.testing.assert_allclose(found[-1, :2], KNOTS[-1, 1:], atol=1e-6)


def test_a_drive_takes_as_long_to_turn_as_its_acceleration_makes_it() -> None:
    """From rest to 10 and 30 rpm: 20 in common at 40 rpm/s take half a second, a difference of 10 at 5 rpm/s two."""
    model = model_of(ramps=np.array([1 / 40, 1 / 5, 0.0]))
    knots = np.array([[1.0, 0.0, 0.0], [1.0, 10.0, 30.0]])
    found = driven(model, 0.0, 9.0, np.array([1.0, 1.25, 2.0, 3.0, 8.0]), knots)[:, :2]
    assert found == pytest.approx(np.array([[0, 0], [8.75, 11.25], [15, 25], [10, 30], [10, 30]]))


@pytest.mark.parametrize(("ramps", "begun"), [((1 / 40, 0.0, 0.0), (-10.0, 10.0)), ((0.0, 1 / 40, 0.0), (20.0, 20.0))])
def test_a_part_without_a_limit_jumps_with_the_command_and_the_robot_rests_before_it(
    ramps: tuple[float, float, float], begun: tuple[float, float]
) -> None:
    """It jumped at the beginning of time: a robot whose speed ahead alone is limited turned until its command began."""
    knots = np.array([[1.0, 0.0, 0.0], [1.0, 10.0, 30.0]])
    found = driven(model_of(ramps=np.array(ramps)), 0.0, 9.0, np.array([0.0, 0.99, 1.0 + 1e-9, 8.0]), knots)
    assert found[:, :2] == pytest.approx(np.array([[0, 0], [0, 0], begun, [10, 30]]), abs=1e-4)
    assert found[1, 2:] == pytest.approx(0.0)  # no wheel has turned


@pytest.mark.parametrize("ramps", [(0.0, 0.0, 0.02), (0.03, 0.08, 0.05), (0.0, 0.01, 1e-4)])
def test_motors_ramp_each_wheel_after_the_drive_has_ramped_both(ramps: tuple[float, float, float]) -> None:
    told = np.array([np.interp(TIMES_S, *jumps_apart(KNOTS, side)) for side in (0, 1)])
    if ramps[:2] != (0.0, 0.0):
        own = driven(model_of(ramps=np.array([*ramps[:2], 0.0])), 0.0, 8.0, TIMES_S[TIMES_S > 0])
        told = np.vstack([own[:1, :2], own[:, :2]]).T
    wheels = []
    for goal in told:
        most, now = STEP_S / ramps[2], goal[0]
        wheels.append([now := now + min(max(value - now, -most), most) for value in goal])
    expected = driven(model_of(), 0.0, 8.0, SEEN_S, np.column_stack([TIMES_S, *wheels]))
    found = driven(model_of(ramps=np.array(ramps)), 0.0, 8.0, SEEN_S)
    np.testing.assert_allclose(found[:, 2:], expected[:, 2:], atol=0.03)
    np.testing.assert_allclose(found[-1, :2], KNOTS[-1, 1:], atol=1e-6)


def test_a_drive_limits_what_it_has_mixed() -> None:
    """Both sides 10 rpm, doubled by the mixing, are 20: beyond a limit of 15."""
    mix, limits = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]), np.array([15.0, 1e6, 1e6])
    found = driven(model_of(mix=mix, limits=limits), 0.0, 2.0, np.array([1.0]), np.array([[0.0, 10.0, 10.0]]))[0]
    assert found[:2] == pytest.approx([15.0, 15.0])


def test_command_on_the_edge_of_the_dead_band_moves_and_below_it_does_not() -> None:
    knots = np.array([[0.0, 5.0, -4.999], [9.0, 5.0, -4.999]])
    assert driven(model_of(dead_band=5.0), 0.0, 1.0, np.array([0.5]), knots)[0, :2].tolist() == [5.0, 0.0]


@pytest.mark.parametrize("dead_band", [5.0, 0.5])
def test_ramp_is_silent_exactly_while_it_is_in_the_dead_band(dead_band: float) -> None:
    """From -20 to 20 rpm within 4 s, 10 rpm a second: silent for a tenth of a second on either side per rpm."""
    knots = np.array([[0.0, -20.0, 20.0], [4.0, 20.0, -20.0]])
    into, out = 2.0 - 0.1 * dead_band, 2.0 + 0.1 * dead_band
    times = np.array([0.5, into - 1e-3, into + 1e-3, out - 1e-3, out + 1e-3, 3.5, 5.0])
    found = driven(model_of(dead_band=dead_band), 0.0, 6.0, times, knots)
    assert found[:, 0] == pytest.approx([-15, -dead_band - 0.01, 0, 0, dead_band + 0.01, 15, 20])
    assert found[:, 1] == pytest.approx(-found[:, 0])
    assert found[3, 2] == pytest.approx(-PER_RPM * into * (20 + dead_band) / 2)  # the mean of the way down
    assert found[6, 2] == pytest.approx(PER_RPM * 20)  # up as far as down, and a second at 20 rpm


def test_lag_closes_the_gap_exponentially_and_is_over_after_36_time_constants() -> None:
    motors = plain("motors")
    knots = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 30.0, -10.0], [9.0, 30.0, -10.0]])
    found = driven(model_of(lag=0.1), 0.0, 8.0, np.array([0.9, 1.1, 1.2]), knots)
    assert found[:, 0] == pytest.approx([0.0, 30 * (1 - math.exp(-1)), 30 * (1 - math.exp(-2))])
    assert found[2, 3] == pytest.approx(-10 * PER_RPM * (0.2 - 0.1 * (1 - math.exp(-2))))
    segments = motors.command_segments(knots, 0.0, 8.0, model_of(lag=0.1))
    ends = segments[:, motors.END]
    assert ends == pytest.approx([1.0, 1.0 + 3.6, 8.0])
    assert segments[:, motors.STEADY].tolist() == [1.0, 0.0, 1.0]


@pytest.mark.parametrize(("lag", "moving"), [(0.0, [1, 0, 1]), (0.5, [1, 0, 0])])
def test_steady_segments_are_those_in_which_neither_side_changes(lag: float, moving: list[int]) -> None:
    motors = plain("motors")
    knots = np.array([[0.0, 5.0, 5.0], [1.0, 5.0, 5.0], [2.0, 5.0, 9.0], [3.0, 5.0, 9.0]])
    segments = motors.command_segments(knots, 0.5, 2.8, model_of(lag=lag))
    assert segments[:, motors.STEADY].tolist() == moving


def test_motors_that_have_been_told_one_command_for_long_turn_by_it_limited_and_above_the_dead_band() -> None:
    robot = affected(affected(barrel(), "dead-band", rpm=12.0), "speed-limit", wheel_rpm=50.0)
    held = plain("motors").held_drive
    model = compile_robot(robot)[0]
    assert held(11.0, -13.0, model) == (0.0, -13.0)
    assert held(80.0, -49.0, model) == (50.0, -49.0)


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize(
    ("off", "slope", "ramp", "rate", "time_s"),
    [
        (0.0, 3.0, 0.0, 3.0, 0.0),  # no ramp: it follows
        (0.0, 3.0, 0.25, 3.0, 0.0),  # a ramp of 4 rpm/s
        (0.0, 5.0, 0.25, 4.0, np.inf),  # which the target leaves behind
        (2.0, 0.0, 0.25, 4.0, 0.5),
        (2.0, 3.0, 0.25, 4.0, 2.0),  # behind a target that moves away by 3 of 4 rpm/s
        (2.0, 5.0, 0.25, 4.0, np.inf),
        (-2.0, 3.0, 0.25, -4.0, 2.0 / 7.0),
    ],
)
def test_a_motor_nears_its_target_as_fast_as_its_ramp_lets_it_and_follows_it_from_there(
    off: float, slope: float, ramp: float, rate: float, time_s: float, way: float
) -> None:
    assert plain("motors")._nearing(way * off, 1e-9, way * slope, ramp) == pytest.approx((way * rate, time_s))
