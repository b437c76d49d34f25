"""The offset of a log whose clock differs by any amount, or that changes all the time, from the motion alone."""

from __future__ import annotations

import numpy as np
import pytest

from evaluator.interchange import log_offset as room
from evaluator.interchange.commands import RunCommand
from evaluator.interchange.log_offset import LogOffset
from evaluator.pose import Poses
from evaluator.workflow.runs.phases import command_delay_of
from simulator.command import Command

FRAME_S, LOG_S, NEAR_S = 0.02, 0.1, 2.0
Floats = np.ndarray


def joystick(seed: int, rows: int) -> Floats:
    """Left and right rpm (rows, 2) that wander, a row every tenth of a second."""
    rng = np.random.default_rng(seed)
    smooth = np.exp(-(np.linspace(-2, 2, 21) ** 2))
    noise = rng.normal(size=(rows + 20, 2))
    return 10 * np.stack([np.convolve(part, smooth, "valid") for part in noise.T], axis=1)


def driven(command: Command, time_s: Floats, late_s: float, seed: int = 0) -> Floats:
    """Poses of a robot that follows a log late, with gains of its own and noise of 0.02 mm and 0.01 rad."""
    fine = np.arange(time_s[0], time_s[-1] + FRAME_S, FRAME_S / 10) + FRAME_S / 20
    left, right = command.at(fine - late_s)
    heading = np.cumsum(0.02 * (right - left)) * FRAME_S / 10
    way = np.cumsum(0.04 * (left + right) * np.exp(1j * heading)) * FRAME_S / 10
    heading, way = (np.r_[0, part][: 10 * len(time_s) : 10] for part in (heading, way))
    noise = np.random.default_rng(seed).normal(size=(len(time_s), 3)) * [0.02, 0.02, 0.01]
    return np.column_stack([way.real, way.imag, heading]) + noise


def log_offset(time_s: Floats, pose: Floats, command: Command, near_s: float) -> LogOffset | None:
    return room.log_offset(time_s, pose, command.at, (command.time_s[0], command.time_s[-1]), near_s)


def log(seed: int = 1, rows: int = 200) -> Command:
    return Command.held_samples(LOG_S * np.arange(rows), joystick(seed, rows), starts_at_rest=False)


@pytest.mark.parametrize("late_s", [0.0, 0.31, -1.7, 100.0, -2500.0])
def test_offset_of_any_size_is_found_within_its_interval(late_s: float) -> None:
    time = np.arange(0, 20, FRAME_S) + late_s
    found = log_offset(time, driven(log(), time, late_s), log(), NEAR_S)
    assert found is not None
    assert found.low_s < late_s < found.high_s
    assert found.high_s - found.low_s < 0.02


def test_interval_holds_the_truth_in_about_95_percent() -> None:
    time = np.arange(0, 8, FRAME_S)
    found = [log_offset(time, driven(log(seed, 80), time, 0.3, seed), log(seed, 80), NEAR_S) for seed in range(20)]
    held = [one is not None and one.low_s < 0.3 < one.high_s for one in found]
    assert sum(held) >= 17


def test_a_log_that_repeats_itself_is_not_taken_for_one_of_another_repetition() -> None:
    rows = np.tile(joystick(3, 50), (4, 1))
    command = Command.held_samples(LOG_S * np.arange(200), rows, starts_at_rest=False)
    time = np.arange(5, 10, FRAME_S)
    found = log_offset(time, driven(command, time, 0.2), command, NEAR_S)
    assert found is not None
    assert found.value_s == pytest.approx(0.2, abs=0.02)


def test_of_what_does_not_move_or_is_too_short_nothing_is_known() -> None:
    time, still = np.arange(0, 5, FRAME_S), Command.constant(0.0, 0.0)
    assert log_offset(time, np.zeros((len(time), 3)), still, NEAR_S) is None
    assert log_offset(time[:20], np.zeros((20, 3)), log(), NEAR_S) is None


@pytest.mark.parametrize("late_s", [0.31, 12.0])
def test_delay_of_a_run_whose_log_changes_all_the_time_or_has_another_clock(late_s: float) -> None:
    time = np.arange(0, 20, FRAME_S) + late_s
    x, y, heading = driven(log(), time, late_s).T
    blank = np.full((len(time), 3, 3), np.nan)
    poses = Poses(time, x, y, heading, blank, np.full(len(time), "ok"))
    found = command_delay_of(RunCommand(log(), starts_at_rest=False, logged=True), poses)
    assert found.low_s < late_s < found.high_s
    assert found.is_known
