"""Mistakes in runs of several commands each are named like those in runs of one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.recognise import recognise
from evaluator.interchange.commands import RunCommand
from simulator.command import Command
from simulator.observation import marks_of_run
from simulator.robot import load_robot
from simulator.run import State
from simulator.simulation import simulate
from tests.evaluator.diagnosis.hidden import COMMANDS

ROBOT = load_robot("barrel")
ODD = 2  # number of the run that is changed
SIGMA_MM = 0.004
CHANGE_S = 3.0  # from the first phase to the second


def driven(number: int, command: Command) -> RunData:
    """Six seconds of two phases, with marks as a tracker would see them."""
    rng = np.random.default_rng(number)
    time = np.arange(180) / 30
    run = simulate(ROBOT, command, time, State(*rng.uniform(-8, 8, 2), rng.uniform(-3, 3)))
    marks = marks_of_run(ROBOT, run).iloc[:, 1:].to_numpy() + rng.normal(0, SIGMA_MM, (len(time), 4))
    told = RunCommand(command, logged=True)
    left, right = told.main(0.0, 6.0)
    assert told.start_s is not None
    return RunData(f"r{number}", left, right, told.start_s, None, time, marks, number, log=told)


def two_phases(left: float, right: float) -> Command:
    return Command.steps([(0.3, left, right), (CHANGE_S, 0.6 * right, left)])


@pytest.fixture(scope="module")
def runs() -> list[RunData]:
    return [driven(number, two_phases(*command)) for number, command in enumerate(COMMANDS)]


def told(run: RunData, change: Callable[[Command], Command]) -> RunData:
    """The run with another log than the one it was driven with."""
    assert run.log is not None
    log = replace(run.log, command=change(run.log.command))
    assert log.start_s is not None
    return replace(run, log=log, start_s=log.start_s)


def held(run: RunData) -> RunData:
    """The run as if it stood from the second phase on."""
    still = run.marks_mm.copy()
    still[run.time_s > CHANGE_S] = still[np.searchsorted(run.time_s, CHANGE_S)]
    noise = np.random.default_rng(1).normal(0, SIGMA_MM, still.shape)
    return replace(run, marks_mm=np.where((run.time_s > CHANGE_S)[:, None], still + noise, run.marks_mm))


CHANGES: dict[str, tuple[str, Callable[[RunData], RunData]]] = {
    "signs": ("reversed", lambda r: told(r, lambda c: Command(c.time_s, -c.left_rpm, -c.right_rpm))),
    "sides": ("sides-swapped", lambda r: told(r, lambda c: Command(c.time_s, c.right_rpm, c.left_rpm))),
    "columns": ("marks-swapped", lambda r: replace(r, marks_mm=r.marks_mm[:, [2, 3, 0, 1]])),
    "mirror": ("mirrored", lambda r: replace(r, marks_mm=r.marks_mm * [-1.0, 1.0, -1.0, 1.0])),
    "half the rate": ("wrong-rate", lambda r: replace(r, time_s=2 * r.time_s)),
    "late": ("late-start", lambda r: told(r, lambda c: c.retimed(later_s=-0.25))),
    "held in its second phase": ("stuck", held),
}


@pytest.mark.parametrize("change", sorted(CHANGES))
def test_a_mistake_in_one_run_with_a_log_is_named_with_its_run_and_kind(runs: list[RunData], change: str) -> None:
    kind, act = CHANGES[change]
    data = [act(run) if number == ODD else run for number, run in enumerate(runs)]
    assert [(item.runs, item.kind) for item in recognise(data, [ROBOT] * len(data))] == [((f"r{ODD}",), kind)]


def test_runs_with_logs_as_they_were_driven_have_no_mistake(runs: list[RunData]) -> None:
    assert recognise(runs, [ROBOT] * len(runs)) == []


def test_two_runs_whose_logs_were_exchanged_are_named_with_each_others_log(runs: list[RunData]) -> None:
    one, other = runs[2], runs[6]
    data = [replace(one, log=other.log), replace(other, log=one.log)]
    found = recognise([*runs[:2], data[0], *runs[3:6], data[1], *runs[7:]], [ROBOT] * len(runs))
    assert [(item.runs, item.kind) for item in found] == [(("r2",), "wrong-command"), (("r6",), "wrong-command")]
    assert "moves as the command log of r6 says" in found[0].sentence


def test_a_robot_that_moves_already_follows_its_log_late(runs: list[RunData]) -> None:
    moving = []
    for run in runs:
        assert run.log is not None
        seen = run.time_s > 1.0
        log = replace(run.log, starts_at_rest=False)
        moving.append(replace(run, time_s=run.time_s[seen], marks_mm=run.marks_mm[seen], start_s=1.0, log=log))
    assert recognise(moving, [ROBOT] * len(moving)) == []
    log = moving[ODD].log
    assert log is not None
    moving[ODD] = replace(moving[ODD], log=replace(log, command=log.command.retimed(later_s=-0.8)))
    found = recognise(moving, [ROBOT] * len(moving))
    assert [(item.runs, item.kind) for item in found] == [((f"r{ODD}",), "late-start")]
    assert "follows its command log 0.8 s late" in found[0].sentence
