"""Changes of commands that come late: response of the path in closed form, and noise that covers it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evaluator.diagnosis.likelihood.noise.late_changes import MOST_CHANGES, jumps_of, late_changes
from evaluator.diagnosis.likelihood.preparation import build_problem, late_shifts
from evaluator.diagnosis.likelihood.run_data import PER_RUN, RunData, Task
from evaluator.diagnosis.likelihood.simulation import Simulated
from evaluator.interchange.commands import RunCommand
from simulator.command import Command
from simulator.robot import load_robot
from tests.evaluator.diagnosis.test_problem import marks_at

TIME = np.arange(300) / 60
CHANGES_S = (1.0, 2.2, 3.5)
TWISTS = ((4.0, 0.5), (6.0, -1.0), (-3.0, 0.4), (2.0, 0.5))  # forward mm/s, yaw rad/s, of each phase
HALF_MM = 2.0
LATE_S = 1e-4


def channels_of_phases(changes_s: tuple[float, ...]) -> np.ndarray:
    """Midpoint and direction of a body with the twists of TWISTS, exactly, (n, 4)."""
    place, heading, found = 0j, 0.3, []
    edges = (0.0, *changes_s, np.inf)
    for (speed, yaw), begin, end in zip(TWISTS, edges[:-1], edges[1:], strict=True):
        inside = TIME[(begin <= TIME) & (end > TIME)] - begin
        for since, keep in [*((t, True) for t in inside), (end - begin, False)]:
            if not np.isfinite(since):
                continue
            turned = heading + yaw * since
            at = place + speed / yaw * -1j * (np.exp(1j * turned) - np.exp(1j * heading))
            if keep:
                found.append([at.real, at.imag, turned, 2 * HALF_MM])
        if np.isfinite(end):
            place, heading = at, turned
    return np.array(found)


@pytest.mark.parametrize("which", [0, 1, 2])
def test_path_after_a_late_change_is_shifted_and_turned_as_of_a_body_that_continued_as_before(which: int) -> None:
    later = tuple(at + LATE_S * (number == which) for number, at in enumerate(CHANGES_S))
    off = (channels_of_phases(later) - channels_of_phases(CHANGES_S)) / LATE_S
    off[:, 2] *= HALF_MM
    found = late_changes(TIME, channels_of_phases(CHANGES_S), CHANGES_S, HALF_MM)
    assert found.shape == (3, 300, 4)
    steady = (np.abs(TIME[:, None] - CHANGES_S) > 0.05).all(axis=1)  # the differences of other frames contain a change
    closest = min(found, key=lambda part: float(np.abs(part - off)[steady].max()))
    np.testing.assert_allclose(closest[steady], off[steady], atol=0.02)
    assert np.abs(off[steady]).max() > 4.0


def test_largest_changes_are_kept() -> None:
    time_s = np.arange(2000) / 60
    speeds = np.where(time_s % 2 < 1, 4.0, 5.0)
    speeds[20 * 60 :] *= 3.0  # what changes later moves more of the path
    place = np.concatenate([[0.0], np.cumsum(speeds[:-1] * np.diff(time_s))])
    channels = np.column_stack([place, 0 * place, 0 * place, 0 * place])
    found = late_changes(time_s, channels, [float(at) for at in range(1, 33)], HALF_MM)
    assert len(found) == MOST_CHANGES
    sizes = np.sum(found**2, axis=(1, 2))
    assert (np.diff(sizes) <= 0).all()


def test_start_is_no_late_change_and_the_stop_is_one() -> None:
    assert jumps_of(Command.constant(30.0, 20.0, 0.5)) == []
    assert jumps_of(Command.constant(30.0, 20.0, 0.5, 2.0)) == [2.0]
    assert jumps_of(Command.steps([(0.5, 30, 20), (1.0, 20, 30), (2.0, 20, 40)])) == [1.0, 2.0]
    assert jumps_of(Command.steps([(0.5, 30, 0), (1.0, 20, 0), (2.0, 0, 20)])) == [1.0, 2.0]  # one side at a time
    assert jumps_of(Command.always(30.0, 20.0, 2.0)) == [2.0]
    assert jumps_of(Command.ramp(30.0, 20.0, 0.5, 2.0)) == []


@pytest.mark.parametrize("sigma_s", [0.0, 1 / 120])
def test_run_whose_change_comes_late_is_noise_within_the_tolerance(sigma_s: float) -> None:
    """The log of two runs says 2.0 s; in one of them the change came 17 ms later, two sigmas."""
    barrel = load_robot("barrel")
    logs = [Command.steps([(0.5, 30, 60), (at, 60, 30)]) for at in (2.0, 2.017)]
    at_rest = marks_at(np.zeros(300), np.zeros(300), np.zeros(300))
    runs = [
        RunData(f"r{k}", 30.0, 60.0, 0.5, None, TIME, at_rest, k, log=RunCommand(log, logged=True))
        for k, log in enumerate(logs)
    ]
    true = Simulated([barrel] * 2, runs, {}).marks([Task(k, (0.0,) * PER_RUN) for k in range(2)])
    rng = np.random.default_rng(0)
    seen = [
        replace(run, marks_mm=marks + 0.003 * rng.normal(size=marks.shape), log=runs[0].log)
        for run, marks in zip(runs, true, strict=True)
    ]
    problem, point = build_problem(seen, Simulated([barrel] * 2, seen, {}), change_sigma_s=sigma_s)
    features = problem.features([point.task(run) for run in range(2)])
    on_time, late = (float(np.mean(item**2)) for item in features)
    assert on_time < 1.5
    assert (late < 1.5) == (sigma_s > 0)
    assert [len(item) for item in late_shifts(problem, point, [0, 1])] == [int(sigma_s > 0)] * 2
    twice = late_shifts(replace(problem, change_sigma_s=2 * sigma_s), point, [0])[0]
    np.testing.assert_allclose(twice, 2 * late_shifts(problem, point, [0])[0])
    assert (problem.compressions[1].random_mm > 0.004) == (sigma_s > 0)
