"""A course of the residuals that all changes of the command share is told; starts, drifts, walks and lags are none."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.assessment.residuals.transient import transient
from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.interchange.commands import RunCommand
from simulator.command import Command

TIME = np.arange(720) / 60
HALF_MM = 1.83
HEADING = 0.7
Course = Callable[[np.ndarray], np.ndarray]
POINT: Any = SimpleNamespace(task=lambda number: number)


def rings(since: np.ndarray, hertz: float = 2.5) -> np.ndarray:
    """Way, mm per rpm, that a motor has gone ahead; its speed rings with a sixth of a rpm."""
    rate = 2 * np.pi * hertz
    since = np.maximum(since, 0.0)
    return np.exp(-0.3 * rate * since) * np.sin(rate * since) / (6 * rate)


def lags(since: np.ndarray) -> np.ndarray:
    return 0.005 * (1 - np.exp(-np.maximum(since, 0.0) / 0.012))


def walk(rng: np.random.Generator) -> np.ndarray:
    return np.cumsum(rng.normal(0.0, 0.002, len(TIME)))


def problem(
    *, along: Course | None = None, turned: Course | None = None, runs: int = 6, kinds: int = 9, ramps: bool = False,
    each_s: float = 1.7, walks: bool = False,
) -> Any:  # fmt: skip
    """Runs of six changes of the command each; after each the way and the heading take a course, times the jump."""
    rng = np.random.default_rng(4)
    speeds = rng.uniform(-60, 60, (kinds, 2))
    data, residuals, channels = [], [], []
    for number in range(runs):
        begins = 0.5 + each_s * np.arange(6)
        steps = [(at, *speeds[rng.integers(kinds)]) for at in begins]
        command = Command.steps(steps)
        if ramps:
            late = np.where(np.arange(len(command.time_s)) % 2, 0.3, 0.0)
            command = Command(command.time_s + late, command.left_rpm, command.right_rpm)
        held = [(0.0, 0.0), *[(left, right) for _, left, right in steps]]
        way, heading = rng.normal(0.0, 0.003, (2, len(TIME)))
        if walks:
            way, heading = way + walk(rng), heading + walk(rng) / HALF_MM
        for at, (old, new) in zip(begins, itertools.pairwise(held), strict=True):
            jump = np.subtract(new, old)
            if along is not None:
                way = way + jump.mean() * along(TIME - at)
            if turned is not None:
                heading = heading + (jump[1] - jump[0]) / 2 * turned(TIME - at)
        residual = np.column_stack([np.cos(HEADING) * way, np.sin(HEADING) * way, HALF_MM * heading, 0 * TIME])
        residual[100:103] = np.nan
        residuals.append(residual)
        channels.append(np.column_stack([0 * TIME, 0 * TIME, 0 * TIME + HEADING + np.pi / 2, 0 * TIME]))
        log = RunCommand(command, logged=True)
        data.append(RunData(f"r{number}", 0.0, 0.0, 0.5, None, TIME, np.zeros((len(TIME), 4)), number, log=log))
    return SimpleNamespace(
        data=data, channels=channels, half_distance_mm=HALF_MM, residuals=lambda tasks: [residuals[k] for k in tasks]
    )


def test_motors_that_ring_are_told_with_the_size_of_their_speed() -> None:
    seen = problem(along=rings)
    found = transient(seen, POINT)
    assert found is not None
    assert (found.quantity, found.by) == ("along_mm_s", "change of the command")
    jumps = [
        np.mean([new.left_rpm - old.left_rpm, new.right_rpm - old.right_rpm])
        for run in seen.data
        for old, new in zip(run.log.command.stretches()[:-1], run.log.command.stretches()[1:], strict=True)
    ]
    # the largest speed that is looked at is that of 0.05 s on, in pieces of a 16th of the window
    since = 0.05 + np.arange(17) * 0.75 / 16
    most = np.abs(np.diff(rings(since)) / np.diff(since)).max() * np.sqrt(np.mean(np.square(jumps)))
    assert found.rms * np.sqrt(2) == pytest.approx(most, rel=0.25)
    assert found.sizes[0][0] == pytest.approx(found.rms * np.sqrt(2))
    assert "measured speed along the robot deviates alike after every change of the command, by up to" in found.sentence
    assert "within 0.8 s" in found.sentence or "within 0.4 s" in found.sentence
    assert "that explains 9" in found.sentence
    assert found.sigmas > 30


def test_a_turn_that_overshoots_is_one_of_the_yaw_rate() -> None:
    found = transient(problem(turned=rings), POINT)
    assert found is not None
    assert found.quantity == "yaw_deg_s"
    assert "deg/s within" in found.sentence


@pytest.mark.parametrize(
    "shown", [{}, {"walks": True}, {"along": lags, "turned": lags}, {"along": lags, "walks": True}]
)
def test_noise_walks_starts_and_motors_that_lag_by_some_milliseconds_have_none(shown: dict[str, Any]) -> None:
    assert transient(problem(**shown), POINT) is None


def test_a_speed_that_is_off_or_drifts_after_each_change_is_none() -> None:
    """Each change has a way, a speed and a drift of its own: what friction and radii do, in part alike."""
    assert (
        transient(problem(along=lambda since: np.where(since > 0, 0.01 * since + 0.002 * since**2, 0.0)), POINT) is None
    )


@pytest.mark.parametrize(
    "few",
    [{"runs": 1}, {"kinds": 2, "runs": 1}, {"ramps": True}, {"each_s": 0.35}],
    ids=["runs", "kinds", "ramps", "short"],
)
def test_few_changes_ramps_and_short_ones_tell_none(few: dict[str, Any]) -> None:
    assert transient(problem(along=rings, **few), POINT) is None


def test_one_command_of_all_runs_tells_no_transient() -> None:
    """Any law leaves the same course in runs of one command: a shape that grows with the jump needs several."""
    assert transient(problem(along=rings, kinds=1, runs=12), POINT) is None


def test_three_different_jumps_in_eight_windows_are_enough() -> None:
    assert transient(problem(along=rings, kinds=3), POINT) is not None


def driven(jumps: list[float], *, each_s: float = 1.7, seen: slice = slice(None)) -> Any:
    """A run whose common speed jumps so, with a ringing way after each, and frames of it."""
    begins, levels = 0.5 + each_s * np.arange(len(jumps)), np.cumsum(jumps)
    time = np.arange(0.0, begins[-1] + each_s, 1 / 60)
    command = Command.steps([(at, level, level) for at, level in zip(begins, levels, strict=True)])
    way = sum(jump * rings(time - at) for at, jump in zip(begins, jumps, strict=True))
    way = way + np.random.default_rng(3).normal(0.0, 0.001, len(time))
    zero = 0 * time
    residual = np.column_stack([way, zero, zero, zero])[seen]
    channels = np.column_stack([zero, zero, zero + np.pi / 2, zero])[seen]
    log = RunCommand(command, logged=True)
    run = RunData("r", 0.0, 0.0, 0.5, None, time[seen], np.zeros((len(time), 4))[seen], 0, log=log)
    return SimpleNamespace(data=[run], channels=[channels], half_distance_mm=HALF_MM, residuals=lambda _: [residual])


@pytest.mark.parametrize(
    ("jumps", "told"),
    [
        ([30.0, -60.0, 45.0, -30.0, 60.0, -45.0, 30.0, -60.0], True),
        ([30.0, -60.0, 45.0, -30.0, 60.0, -45.0, 30.0], False),  # seven changes
        ([30.0, -60.0, 60.0, -30.0, 60.0, -60.0, 30.0, -60.0], False),  # of two sizes
        ([30.0, -60.0, 45.0, -30.0, 60.0, -45.0, 30.0, 5.9], False),  # one of them is less than a tenth of the largest
        ([30.0, -60.0, 45.0, -30.0, 60.0, -45.0, 30.0, 6.1], True),
    ],
)
def test_eight_changes_of_three_sizes_are_needed(jumps: list[float], *, told: bool) -> None:
    assert (transient(driven(jumps), POINT) is not None) == told


def test_a_window_is_not_longer_than_commands_are_held() -> None:
    found = transient(driven([30.0, -60.0, 45.0] * 4, each_s=0.45), POINT)
    assert found is not None
    assert " within 0.4 s," in found.sentence
    assert transient(driven([30.0, -60.0, 45.0] * 4, each_s=0.39), POINT) is None


def test_frames_that_are_few_or_only_in_a_part_of_a_window_tell_nothing() -> None:
    jumps = [30.0, -60.0, 45.0, -30.0, 60.0, -45.0, 30.0, -60.0]
    assert transient(driven(jumps, seen=slice(None, None, 2)), POINT) is not None
    assert transient(driven(jumps, seen=slice(None, None, 11)), POINT) is None  # nine in 1.6 s
    assert transient(driven(jumps, seen=slice(0, 90)), POINT) is None  # of the first change alone
