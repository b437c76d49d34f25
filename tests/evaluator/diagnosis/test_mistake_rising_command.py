"""Starts of runs whose command rises: a slow ramp is seen to move only after its start, and is not late."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.motion import Onset, onset
from evaluator.diagnosis.mistakes.start.late_start import late_starts
from evaluator.diagnosis.mistakes.start.rising_command import motors_on, onset_after_start
from evaluator.interchange.commands import RunCommand
from simulator.command import Command
from tests.evaluator.diagnosis.marks_of_motion import moving, recorded
from tests.evaluator.diagnosis.straight_session import ROBOT

START_S, FULL_RPM, RISE_S = 0.5, 40.0, 10.0
TIME = np.arange(300) / 60


def ramp(number: int = 0, begins_s: float = START_S) -> RunData:
    """A run whose speed rises evenly from begins_s on, by its log from START_S on: after 1 s, 0.2 mm/s."""
    marks = moving(0.1 * np.maximum(TIME - begins_s, 0.0) ** 2, 1.0, 0.0)
    run = recorded(marks, TIME, noise_mm=0.005)
    log = RunCommand(Command.ramp(FULL_RPM, FULL_RPM, START_S, START_S + RISE_S), logged=True)
    return replace(run, id=f"ramp{number}", left_rpm=FULL_RPM, right_rpm=FULL_RPM, start_s=START_S, log=log)


def waiting(number: int, band_rpm: float) -> RunData:
    """A run whose command rises by 8 rpm/s, and whose wheels turn from a command of band_rpm on, at its speed."""
    rate, speed_per_rpm = 8.0, 0.05
    begins_s = START_S + band_rpm / rate
    way = speed_per_rpm * rate / 2 * (np.maximum(TIME - START_S, band_rpm / rate) ** 2 - (band_rpm / rate) ** 2)
    run = recorded(moving(way * (begins_s < TIME), 1.0, 0.0), TIME, noise_mm=0.005)
    log = RunCommand(Command.ramp(80.0, 80.0, START_S, START_S + 80.0 / rate), logged=True)
    return replace(run, id=f"waiting{number}", left_rpm=80.0, right_rpm=80.0, start_s=START_S, log=log)


def constant(number: int, begins_s: float) -> RunData:
    run = recorded(moving(np.maximum(TIME - begins_s, 0.0), 2.0, 0.2), TIME)
    return replace(run, id=f"constant{number}", start_s=START_S)


def test_line_through_a_parabola_begins_at_a_quarter_of_the_sum_of_the_ends() -> None:
    """The tangent at the middle m of a span meets 0 at m/2; the median of all slopes is that of the middle."""
    begins = Onset(1.0, 0.01, (0.9, 1.3))
    assert onset_after_start(ramp(), begins, 0.3) == pytest.approx((0.6 + 1.0) / 4, abs=0.01)
    assert motors_on(ramp(), replace(begins, time_s=0.3 + (0.6 + 1.0) / 4)) == pytest.approx(0.3, abs=0.01)


def test_motion_at_a_constant_command_is_expected_from_the_start_on() -> None:
    begins = Onset(0.7, 0.01, (0.75, 1.1))
    assert onset_after_start(constant(0, 0.7), begins, START_S) == 0.0
    assert motors_on(constant(0, 0.7), begins) == 0.7
    held = RunCommand(Command.constant(30.0, 20.0, START_S), logged=True)
    assert onset_after_start(replace(constant(0, 0.7), log=held), begins, START_S) == pytest.approx(0.0, abs=0.01)
    assert onset_after_start(ramp(), replace(begins, span_s=(0.1, 0.4)), START_S) == 0.0  # nothing is commanded yet


@pytest.mark.parametrize("ramps", [1, 3])
def test_a_slow_ramp_is_not_late_and_does_not_hide_a_run_that_is(ramps: int) -> None:
    runs = [*(ramp(k) for k in range(ramps)), *(constant(k, START_S) for k in range(4)), constant(9, START_S + 0.8)]
    (found,) = late_starts(runs, [ROBOT] * len(runs))
    assert (found.run, found.kind) == ("constant9", "late-start")
    assert found.correction is not None
    assert found.correction.later_s == pytest.approx(0.8, abs=0.02)


def test_a_ramp_that_is_late_is_told_with_the_start_of_its_motors() -> None:
    runs = [ramp(0, START_S + 1.5), *(constant(k, START_S) for k in range(4))]
    (found,) = late_starts(runs, [ROBOT] * len(runs))
    assert found.run == "ramp0"
    assert found.correction is not None
    assert found.correction.later_s == pytest.approx(1.5, abs=0.1)


def test_ramps_through_a_dead_band_are_not_late_unless_others_begin_at_a_lower_command() -> None:
    """Constant runs are commanded 30 rpm. Motion before START_S + 1.5 s would be at less than 12 rpm."""
    others = [constant(k, START_S) for k in range(4)]
    waits = [waiting(0, 12.0), waiting(1, 12.0)]
    assert late_starts([*waits, *others], [ROBOT] * 6) == []
    slow = [replace(run, left_rpm=8.0, right_rpm=6.0) for run in others]
    assert [item.run for item in late_starts([*waits, *slow], [ROBOT] * 6)] == ["waiting0", "waiting1"]


def test_a_log_with_stairs_waits_for_the_stair_above_the_dead_band() -> None:
    others = [constant(k, START_S) for k in range(4)]
    rpm = np.array([5.0, 5.0, 40.0])
    stairs = RunCommand(Command(np.array([START_S, 1.5, 1.5]), rpm, rpm), logged=True)
    late = replace(constant(9, 1.5), log=stairs, left_rpm=40.0, right_rpm=40.0)
    assert late_starts([late, *others], [ROBOT] * 5) == []


def soft(number: int, begins_s: float, noise_mm: float = 0.005) -> RunData:
    """A run at a constant command whose drive reaches its speed of 2 mm/s evenly within 0.8 s."""
    since = np.maximum(TIME - begins_s, 0.0)
    way = np.where(since < 0.8, 1.25 * since**2, 2.0 * since - 0.8)
    run = recorded(moving(way * (since > 0), 1.0, 0.0), TIME, noise_mm=noise_mm)
    return replace(run, id=f"soft{number}", start_s=START_S)


@pytest.mark.parametrize("noise_mm", [0.001, 0.005, 0.01])
def test_a_drive_that_starts_softly_is_not_late_beside_others_that_start_at_once(noise_mm: float) -> None:
    others = [constant(k, START_S) for k in range(4)]
    assert late_starts([soft(0, START_S, noise_mm), *others], [ROBOT] * 5) == []
    (found,) = late_starts([soft(0, START_S + 0.3, noise_mm), *others], [ROBOT] * 5)
    assert found.correction is not None
    assert found.correction.later_s == pytest.approx(0.3, abs=0.03)


@pytest.mark.parametrize("noise_mm", [0.001, 0.01, 0.05])
def test_a_start_at_once_is_not_taken_for_a_soft_one(noise_mm: float) -> None:
    marks = moving(np.maximum(TIME - START_S, 0.0), 2.0, 0.2)
    begins = onset(recorded(marks, TIME, noise_mm=noise_mm))
    assert begins is not None
    assert begins.softly_s is None
    assert begins.rests_until_s is None


def brisk(number: int, begins_s: float) -> RunData:
    """A run that sets out at 2.5 mm/s and goes on at 0.6 mm/s after 0.08 s, as a slow pivot whose wheels first slip."""
    since = np.maximum(TIME - begins_s, 0.0)
    way = np.minimum(2.5 * since, 0.6 * (since - 0.08) + 0.2)
    run = recorded(moving(way * (since > 0), 1.0, 0.0), TIME, noise_mm=0.01)
    return replace(run, id=f"brisk{number}", start_s=START_S)


def test_a_robot_that_sets_out_faster_than_it_goes_on_has_not_started_early() -> None:
    """The line through its first 0.4 s begins 0.2 s before it moves."""
    others = [constant(k, START_S) for k in range(4)]
    begins = onset(brisk(0, START_S))
    assert begins is not None
    assert begins.time_s < START_S - 0.15
    assert begins.rests_until_s == pytest.approx(START_S, abs=0.04)
    assert late_starts([brisk(0, START_S), *others], [ROBOT] * 5) == []
    (found,) = late_starts([brisk(0, START_S - 0.2), *others], [ROBOT] * 5)
    assert found.correction is not None
    assert found.correction.later_s == pytest.approx(-0.2, abs=0.04)
