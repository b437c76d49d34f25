"""Recordings with another one's log, or with a sign or side of their own exchanged, by the whole motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evaluator.diagnosis.experiment import Session, _in_pieces, without_mistakes
from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.misread import other_log
from evaluator.diagnosis.mistakes.misread.other_log import misassigned
from evaluator.interchange.commands import RunCommand
from simulator.command import Command
from simulator.robot import load_robot
from tests.evaluator.diagnosis.posed_runs import driven

RIGHT = [driven(seed, 0.2, both_ways=True) for seed in range(4)]


def with_log(run: RunData, command: Command) -> RunData:
    return replace(run, log=RunCommand(command, logged=True))


def commanded(run: RunData) -> Command:
    assert run.log is not None
    return run.log.command


def exchanged(run: RunData, sign: float = 1.0) -> RunData:
    """The run with left and right of its log exchanged, or with a sign of all speeds."""
    knots = commanded(run).knots
    left, right = (knots[:, 2], knots[:, 1]) if sign > 0 else (-knots[:, 1], -knots[:, 2])
    return with_log(run, Command(knots[:, 0], left, right))


def test_recordings_that_follow_their_logs_are_no_mistake() -> None:
    assert misassigned(RIGHT) == []
    assert misassigned([driven(seed, 0.9) for seed in range(4)]) == []  # however late, forward only


def test_two_recordings_with_exchanged_logs_are_told_with_the_log_that_each_follows() -> None:
    first, second, *others = RIGHT
    swapped = [with_log(first, commanded(second)), with_log(second, commanded(first))]
    found = misassigned([*swapped, *others])
    assert [(item.run, item.kind, item.seen) for item in found] == [
        ("r0", "wrong-command", "moves as the command log of r1 says, and not as its own"),
        ("r1", "wrong-command", "moves as the command log of r0 says, and not as its own"),
    ]


@pytest.mark.parametrize(("sign", "kind"), [(1.0, "sides-swapped"), (-1.0, "reversed")])
def test_one_recording_with_exchanged_sides_or_signs_is_told_and_mended(sign: float, kind: str) -> None:
    odd = exchanged(RIGHT[2], sign)
    (found,) = misassigned([*RIGHT[:2], odd, RIGHT[3]])
    assert (found.run, found.kind) == ("r2", kind)
    assert found.correction is not None
    assert found.correction.log is not None
    assert np.allclose(found.correction.log.command.knots, commanded(RIGHT[2]).knots)
    assert misassigned([*(exchanged(run, sign) for run in RIGHT[:2]), *RIGHT[2:]]) == []  # which are right?


def test_a_recording_that_follows_no_log_or_whose_log_does_not_change_is_left_to_others() -> None:
    pushed = replace(RIGHT[0], marks_mm=driven(9, 0.2, both_ways=True).marks_mm)
    assert misassigned([pushed, *RIGHT[1:]]) == []
    steady = with_log(RIGHT[0], Command.steps([(0.0, 20.0, 10.0), (15.0, 22.0, 10.0)]))
    assert misassigned([exchanged(steady), *RIGHT[1:]]) == []
    assert misassigned([replace(exchanged(RIGHT[0]), log=None), *RIGHT[1:]]) == []


def test_thousands_of_recordings_are_not_all_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(other_log, "MOST_COMPARED", 3)
    assert misassigned([*RIGHT[:2], exchanged(RIGHT[2]), RIGHT[3]]) == []


def test_it_is_a_mistake_that_check_tells() -> None:
    data = (*RIGHT[:2], exchanged(RIGHT[2]), RIGHT[3])
    rest = _in_pieces(Session(data, (load_robot("four_driven"),) * 4, {}))
    (mistake,) = rest.mistakes
    assert any(item is mistake for item in without_mistakes(rest).mistakes)  # beside what else is wrong with the robot
    assert (mistake.runs, mistake.kind, mistake.everywhere) == (("r2",), "sides-swapped", False)
