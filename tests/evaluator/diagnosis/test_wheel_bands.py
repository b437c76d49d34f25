"""Wheels that turn faster than the slow modes: their ripple is part of the fit, and no noise."""

from __future__ import annotations

import numpy as np
import pytest

from evaluator.diagnosis.likelihood.features import channel_noise, compression, residual_spectra
from evaluator.diagnosis.likelihood.noise.tracking import Noise
from evaluator.diagnosis.likelihood.noise.wheel_bands import wheel_bands, within
from simulator.command import Command

TIME_S = np.arange(240) / 60
AHEAD = np.zeros(240)


def test_a_band_lies_about_the_turns_a_second_of_each_wheel() -> None:
    bands = wheel_bands(Command([0.0], [300.0], [-480.0]), TIME_S, AHEAD)
    resolution_hz = 2 / TIME_S[-1]
    np.testing.assert_allclose(bands, [(5 - resolution_hz, 5 + resolution_hz), (8 - resolution_hz, 8 + resolution_hz)])


def test_a_robot_that_turns_shifts_the_frequency_by_its_own() -> None:
    turning = (2 * np.pi * 1.5 * TIME_S + np.pi) % (2 * np.pi) - np.pi  # as an angle is measured
    turning[50:60] = np.nan
    ((low, high),) = wheel_bands(Command([0.0], [300.0], [300.0]), TIME_S, turning)
    assert (low + high) / 2 == pytest.approx(5.0)
    assert (high - low) / 2 == pytest.approx(2 / TIME_S[-1] + 1.5)


def test_each_speed_of_a_command_has_its_band_within_the_recording() -> None:
    command = Command([0.5, 2.5, 2.5, 9.0], [240.0, 240.0, 600.0, 600.0], [0.0, 0.0, 30.0, 30.0])
    bands = wheel_bands(command, TIME_S, AHEAD)
    rest = TIME_S[-1] - 2.5
    np.testing.assert_allclose(bands, [(4 - 1.0, 4 + 1.0), (10 - 2 / rest, 10 + 2 / rest)])  # 30 rpm: 0.7 turns


def test_a_wheel_has_a_band_from_one_turn_on() -> None:
    for rpm, count in ((14.5, 0), (15.5, 1)):  # 0.96 and 1.03 turns in 3.98 s
        assert len(wheel_bands(Command([0.0], [rpm], [0.0]), TIME_S, AHEAD)) == count


def test_a_robot_whose_heading_is_never_seen_shifts_nothing() -> None:
    assert wheel_bands(Command([0.0], [300.0], [300.0]), TIME_S, AHEAD + np.nan) == wheel_bands(
        Command([0.0], [300.0], [300.0]), TIME_S, AHEAD
    )


def test_a_ramp_covers_the_speeds_between_its_ends() -> None:
    ((low, high),) = wheel_bands(Command([0.0, 4.0], [60.0, 360.0], [0.0, 0.0]), TIME_S[:200], AHEAD[:200])
    assert (low, high) == pytest.approx((1 - 2 / TIME_S[199], 6 + 2 / TIME_S[199]))


def test_without_bands_no_frequency_lies_within_and_bounds_belong_to_a_band() -> None:
    frequency = np.array([1.0, 2.0, 3.0, 4.0])
    assert not within(frequency, ()).any()
    assert within(frequency, ((2.0, 3.0), (3.5, 3.9))).tolist() == [False, True, True, False]


def test_ripple_of_fast_wheels_is_no_noise() -> None:
    """Wheels of 22 runs, of 300 rpm and more, that move the robot by 0.1 mm each turn, under white noise of 12 µm."""
    rng = np.random.default_rng(0)
    found = []
    for with_bands in (False, True):
        spectra = []
        for speed_hz in np.linspace(5.0, 9.0, 22):
            ripple = 0.1 * np.cos(2 * np.pi * speed_hz * TIME_S + rng.uniform(0.0, 6.0))
            residual = 0.012 * rng.normal(size=(240, 4)) + ripple[:, None]
            bands = ((speed_hz - 0.5, speed_hz + 0.5),) if with_bands else ()
            spectra.append(residual_spectra(TIME_S, residual, 0.0, bands))
        found.append(np.median([run[0].sigma_mm for run in channel_noise(spectra)]))
    assert found[0] > 0.05
    assert found[1] == pytest.approx(0.012, rel=0.1)


def test_modes_of_the_bands_follow_the_slow_ones_up_to_what_frames_resolve() -> None:
    """Half-waves of 3.98 s: 23 of up to 3 Hz, and those of 4.7 to 5.3 Hz; of 40 to 60 Hz none."""
    noise = (Noise(1.0, 0.0, 0.1),) * 4
    used = np.ones(240, dtype=np.bool_)
    usual = compression(TIME_S, used, noise)
    made = compression(TIME_S, used, noise, bands_hz=((4.7, 5.3), (40.0, 60.0)))
    sizes = [part.shape[1] for part in made.functional]
    assert sizes == [usual.functional[0].shape[1] + 5] * 3 + [usual.functional[3].shape[1]]
    line = np.zeros((240, 4))
    line[:, 1] = np.cos(2 * np.pi * 5.0 * TIME_S)
    seen = [np.sum(part.features(line) ** 2) for part in (usual, made)]
    assert seen[0] < 2.0
    assert seen[1] == pytest.approx(np.sum(line**2), rel=0.1)


def test_slow_wheels_change_nothing() -> None:
    noise = (Noise(1.0, 0.0, 0.1),) * 4
    used = np.ones(240, dtype=np.bool_)
    bands = ((0.2, 1.8),)
    usual, made = compression(TIME_S, used, noise), compression(TIME_S, used, noise, bands_hz=bands)
    np.testing.assert_array_equal(usual.functional[0], made.functional[0])
    residual = np.random.default_rng(1).normal(size=(240, 4))
    usual_power, power = (residual_spectra(TIME_S, residual, 0.0, asked)[0].power_mm2 for asked in ((), bands))
    np.testing.assert_array_equal(usual_power, power)
