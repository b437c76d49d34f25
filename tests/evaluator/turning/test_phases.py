"""Phases of motions whose times are known, and what each limit of them means."""

from __future__ import annotations

import numpy as np
import pytest

from evaluator.turning.phases import (
    Phases,
    Rates,
    _left_rest,
    _longest,
    _reach,
    _settled,
    _slopes,
    _steady,
    _usual,
    find_phases,
    local_rates,
)

FRAME_S = 1 / 50
SIGMA_MM = 0.01


def noisy(scaled: np.ndarray, seed: int = 0) -> np.ndarray:
    return np.asarray(scaled + SIGMA_MM * np.random.default_rng(seed).normal(size=scaled.shape))


def driven(speed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times and places along x of a robot of this speed, mm/s, in every frame."""
    along = np.concatenate([[0.0], np.cumsum(speed[:-1]) * FRAME_S])
    return FRAME_S * np.arange(len(speed)), np.column_stack([along, 0 * along, 0 * along])


def profile(rest: int = 100, moving: int = 400, after: int = 100) -> np.ndarray:
    return np.concatenate([np.zeros(rest), np.full(moving, 5.0), np.zeros(after)])


def test_times_of_rest_motion_and_stop_are_found_to_a_few_frames() -> None:
    time, scaled = driven(profile())
    phases = find_phases(time, noisy(scaled), SIGMA_MM, start_s=1.5)
    assert phases.start_s == pytest.approx(2.0, abs=0.05)
    assert phases.stop_s == pytest.approx(10.0, abs=0.05)
    assert phases.delay_s == pytest.approx(phases.start_s - 1.5)
    assert 2.0 <= phases.steady_start_s < 2.5
    assert 9.5 < phases.steady_stop_s <= 10.05
    assert phases.reason == ""


@pytest.mark.parametrize(("share", "start_s"), [(0.25, 2.0), (0.15, np.nan)])
def test_a_robot_moves_from_a_fifth_of_its_usual_speed_on(share: float, start_s: float) -> None:
    """It creeps for two seconds before it drives; if that is no motion, it was not seen at rest before its start."""
    speed = np.concatenate([np.zeros(100), np.full(100, share * 5.0), np.full(400, 5.0)])
    time, scaled = driven(speed)
    assert find_phases(time, noisy(scaled), SIGMA_MM).start_s == pytest.approx(start_s, abs=0.05, nan_ok=True)


def test_recording_that_begins_and_ends_in_motion_has_no_start_and_no_stop() -> None:
    time, scaled = driven(profile(0, 300, 0))
    phases = find_phases(time, noisy(scaled), SIGMA_MM)
    assert np.isnan([phases.start_s, phases.stop_s, phases.delay_s]).all()
    assert (phases.steady_start_s, phases.steady_stop_s) == (time[0], time[-1])


def test_steady_turn_is_what_keeps_its_speed_within_a_twentieth() -> None:
    """Speed rises to its usual value over 3 s; the steady turn begins where it comes within 5 % of it."""
    speed = np.concatenate([np.linspace(0, 5, 150), np.full(400, 5.0)])
    time, scaled = driven(speed)
    phases = find_phases(time, scaled, 1e-6)
    assert phases.steady_start_s == pytest.approx(0.95 * 3.0, abs=0.1)


def test_yaw_that_changes_is_not_steady_even_at_constant_speed() -> None:
    time, scaled = driven(np.full(500, 5.0))
    yaw = np.where(np.arange(500) < 150, 0.0, 2.0)
    scaled[:, 2] = np.cumsum(yaw) * FRAME_S
    phases = find_phases(time, scaled, 1e-6)
    assert phases.steady_start_s == pytest.approx(3.0, abs=0.1)


@pytest.mark.parametrize(("reach", "rests"), [(3.5, True), (6.0, False)])
def test_robot_that_moves_less_than_four_sigmas_rests(reach: float, rests: bool) -> None:
    scaled = np.zeros((100, 3))
    scaled[:, 0] = np.where(np.arange(100) < 50, 0.0, reach * SIGMA_MM)
    phases = find_phases(FRAME_S * np.arange(100), scaled, SIGMA_MM)
    assert phases.reason == (f"at rest: moves less than {reach * SIGMA_MM:.2g} mm" if rests else "")


@pytest.mark.parametrize(("frames", "found"), [(4, False), (5, True)])
def test_motion_needs_five_frames_between_the_commands(frames: int, found: bool) -> None:
    time, scaled = driven(np.full(50, 5.0))
    phases = find_phases(time, scaled, 1e-6, start_s=time[10], stop_s=time[10 + frames - 1])
    assert (phases.reason == "") == found
    assert found or phases.reason == "no motion is recorded between the commanded start and stop"


def test_motion_before_the_command_is_none_of_it() -> None:
    time, scaled = driven(np.concatenate([np.full(100, 5.0), np.zeros(100), np.full(200, 5.0)]))
    phases = find_phases(time, scaled, 1e-6, start_s=3.0)
    assert phases.start_s == pytest.approx(4.0, abs=0.1)


def test_name_of_every_frame() -> None:
    phases = Phases(start_s=1.0, steady_start_s=2.0, steady_stop_s=4.0, stop_s=5.0)
    names = phases.names(np.array([0.9, 1.0, 1.9, 2.0, 4.0, 4.1, 5.0, 5.1]))
    assert names.tolist() == ["rest", "transient", "transient", "steady", "steady", "stop", "stop", "rest"]
    open_ended = Phases(steady_start_s=2.0, steady_stop_s=4.0)
    assert open_ended.names(np.array([-9.0, 3.0, 99.0])).tolist() == ["transient", "steady", "stop"]
    assert Phases(steady_start_s=0, steady_stop_s=9, reason="at rest").names(np.ones(2)).tolist() == ["rest", "rest"]


def test_slope_of_a_line_and_of_its_time_across_a_gap() -> None:
    time = np.concatenate([np.arange(20), np.arange(30, 50)]) * FRAME_S
    line = np.column_stack([3 * time, -2 * time, 0 * time])
    rates = local_rates(time, line, 1e-9, np.ones(40, dtype=bool))
    np.testing.assert_allclose(rates.value, np.tile([3.0, -2.0, 0.0], (40, 1)), atol=1e-9)
    curved = np.arange(9.0)[:, None] ** 2
    np.testing.assert_allclose(_slopes(curved, 2)[:, 0], [4, 4, 4, 6, 8, 10, 12, 12, 12])


def test_window_of_a_slope_is_as_long_as_its_precision_asks() -> None:
    time, scaled = driven(np.full(1000, 5.0))
    inside = np.ones(1000, dtype=bool)
    rates = local_rates(time, scaled, SIGMA_MM, inside)
    width = 2 * rates.half_width + 1
    assert rates.sigma == pytest.approx(SIGMA_MM * np.sqrt(12 / (width**3 - width)) / FRAME_S)
    assert rates.sigma <= 0.01 * 5.0
    shorter = 2 * (rates.half_width - 2) + 1
    assert SIGMA_MM * np.sqrt(12 / (shorter**3 - shorter)) / FRAME_S > 0.01 * 5.0
    assert local_rates(time, scaled, 1e-9, inside).half_width == 2
    assert local_rates(time, scaled, 1.0, inside).half_width == 100  # a tenth of the run at most
    assert local_rates(time, scaled, 1.0, inside, longest=7).half_width == 7
    assert local_rates(time, scaled, SIGMA_MM, inside, share=0.1).half_width < rates.half_width


def test_longest_stretch_with_short_holes_filled() -> None:
    flags = np.array([0, 1, 1, 0, 0, 1, 0, 0, 0, 1, 1, 1, 0], dtype=bool)
    assert _longest(flags, 0) == (9, 11)
    assert _longest(flags, 1) == (9, 11)
    assert _longest(flags, 2) == (1, 5)
    assert _longest(flags, 3) == (1, 11)


def test_rest_is_left_with_the_last_frame_near_its_pose() -> None:
    time = np.arange(40.0)
    scaled = np.zeros((40, 3))
    scaled[20:, 0] = 3.9 * SIGMA_MM
    scaled[25:, 0] = 4.1 * SIGMA_MM
    assert _left_rest(time, scaled, SIGMA_MM, 22, 5) == 24.0
    assert np.isnan(_left_rest(time, scaled, SIGMA_MM, 3, 1))  # three frames before it show no rest
    assert _left_rest(time, scaled, SIGMA_MM, 4, 1) == 5.0
    drifting = scaled.copy()
    drifting[:, 0] = 0.01 * np.arange(40)
    assert np.isnan(_left_rest(time, drifting, SIGMA_MM, 30, 5))


def rates_of(speed: np.ndarray, half_width: int = 2, sigma: float = 1e-6) -> Rates:
    return Rates(np.column_stack([speed, 0 * speed, 0 * speed]), sigma, half_width)


@pytest.mark.parametrize(("off", "steady"), [(0.04, True), (0.06, False), (-0.04, True), (-0.06, False)])
def test_frames_within_a_twentieth_of_the_usual_speed_are_steady(off: float, steady: bool) -> None:
    speed = np.full(100, 5.0)
    speed[:20] *= 1 + off
    speed[90:] *= 1 + off
    assert _steady(rates_of(speed), 0, 99) == ((0, 99) if steady else (20, 89))


def test_ripple_and_noise_within_four_of_their_deviations_are_steady() -> None:
    ripple = 5 + 0.5 * np.resize([-1.0, 1.0], 100)
    ripple[:10] = 5 + 0.9 * 4 * 1.4826 * 0.5
    assert _steady(rates_of(ripple), 0, 99) == (0, 99)
    ripple[:10] = 5 + 1.1 * 4 * 1.4826 * 0.5 + 0.5
    assert _steady(rates_of(ripple), 0, 99)[0] == 10
    noisy_speed = np.full(100, 5.0)
    noisy_speed[:10] = 5 + 0.9 * 4 * 0.3
    assert _steady(rates_of(noisy_speed, sigma=0.3), 0, 99) == (0, 99)


def test_a_disturbance_inside_does_not_end_the_steady_turn_and_a_short_lull_does_not_begin_it() -> None:
    near = np.array([0, 1, 1, 0, 1, 1, 1, 0, 1, 1, 1, 1], dtype=bool)
    assert _settled(near, 0, 11, 1) == 1
    assert _settled(near, 0, 11, 2) == 4
    assert _settled(near, 0, 11, 3) == 5  # the middle at the latest
    assert _settled(near, 5, 11, 1) == 5


def test_reach_of_a_run_is_that_between_the_medians_of_its_tenths() -> None:
    line = np.column_stack([np.arange(100.0), np.zeros((100, 2))])
    assert _reach(line) == pytest.approx(90.0)
    assert _reach(line[:6]) == pytest.approx(4.0)  # of three pairs


@pytest.mark.parametrize(("share", "seen"), [(0.7, False), (1.4, True)])
def test_phases_of_a_robot_slower_than_eight_deviations_of_its_speed_are_not_told(share: float, seen: bool) -> None:
    """Of 100 frames the window reaches ten to either side: the slope is known to 0.036 of the noise a frame."""
    deviation = SIGMA_MM * np.sqrt(12 / (21**3 - 21)) / FRAME_S
    speed = np.where(np.arange(100) < 50, 0.0, share * 8 * deviation)
    time, scaled = driven(speed)
    phases = find_phases(time, scaled, SIGMA_MM)
    assert np.isfinite(phases.start_s) == seen
    assert phases.steady_start_s == pytest.approx(1.0 if seen else 0.0, abs=0.25)


@pytest.mark.parametrize("sigma_mm", [0.001, 0.003, 0.01, 0.03, 0.1])
@pytest.mark.parametrize("share", [0.01, 0.05])
def test_window_is_hardly_longer_than_its_precision_asks(sigma_mm: float, share: float) -> None:
    time, scaled = driven(np.full(3000, 5.0))
    found = local_rates(time, scaled, sigma_mm, np.ones(3000, dtype=bool), share=share)
    widths = 2 * np.arange(2, 301) + 1
    enough = sigma_mm * np.sqrt(12 / (widths**3.0 - widths)) / FRAME_S <= share * 5.0
    shortest = 2 + int(np.argmax(enough))
    assert shortest <= found.half_width <= shortest + 1


def test_only_the_second_before_a_start_tells_where_the_robot_rested() -> None:
    """It was pushed to another place long before: sixty frames before the start, it rests."""
    scaled = np.zeros((140, 3))
    scaled[30:, 1] = 20 * SIGMA_MM
    scaled[100:, 0] = SIGMA_MM * 10 * np.arange(40)
    assert _left_rest(np.arange(140.0), scaled, SIGMA_MM, 100, 5) == 100.0
    scaled[60:, 1] = 40 * SIGMA_MM
    assert np.isnan(_left_rest(np.arange(140.0), scaled, SIGMA_MM, 100, 5))


def test_usual_speed_is_that_of_the_middle_half_between_start_and_stop() -> None:
    speed = np.repeat([9.0, 6.0, 5.0, 7.0, 9.0], [10, 22, 24, 34, 10])
    assert _steady(rates_of(speed), 10, 89) == (32, 55)
    assert _steady(rates_of(speed[::-1]), 10, 89) == (44, 67)


@pytest.mark.parametrize(("pushed", "expected"), [(6, 1.0), (20, 1.0), (30, 10.0)])
def test_a_push_is_not_the_usual_speed_of_a_run(pushed: int, expected: float) -> None:
    """A finger moved a robot by a millimetre in 80 ms: the push was its steady turn, at ten times its speed."""
    speed = np.concatenate([np.zeros(30), np.full(70, 1.0), np.full(pushed, 10.0), np.full(30, 1.0)])
    assert _usual(speed, SIGMA_MM, FRAME_S) == expected  # what lasts 0.6 s is no push
    time, scaled = driven(speed)
    phases = find_phases(time, noisy(scaled), SIGMA_MM)
    if pushed == 6:
        assert phases.steady_start_s < 30 * FRAME_S + 0.3
        assert phases.steady_stop_s > time[-1] - 0.3
    assert _usual(np.full(50, 10.0), SIGMA_MM, FRAME_S) == 10.0
    brief = np.concatenate([np.zeros(90), np.full(10, 10.0)])  # at rest, but for a brief run
    assert _usual(brief, SIGMA_MM, FRAME_S) == 10.0
