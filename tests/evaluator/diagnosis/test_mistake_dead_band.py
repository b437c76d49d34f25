"""Wheels that stand at the slowest commands are an effect; a motor that is off at any other command is a mistake."""

from __future__ import annotations

from dataclasses import replace

import pytest

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.disturbances import disturbed_runs
from evaluator.diagnosis.mistakes.misread.dead_band import beyond_a_dead_band
from evaluator.diagnosis.mistakes.recognised import Correction, Found
from evaluator.interchange.commands import RunCommand
from simulator.command import Command
from tests.evaluator.diagnosis.straight_session import ROBOT, driven

Speeds = tuple[float, float]


def session_of(*commands: Speeds) -> list[RunData]:
    return [replace(driven(number), left_rpm=left, right_rpm=right) for number, (left, right) in enumerate(commands)]


def off(run: str, *to: float) -> Found:
    """A run that moves as if commanded otherwise."""
    return Found(run, "wrong-command", "", "", correction=Correction(command=to))


FASTER = ((30.0, 10.5), (-12.0, -12.0), (30.0, 0.0))


def test_motors_that_seem_off_below_the_slowest_wheel_that_turns_are_a_dead_band() -> None:
    data = session_of((15.0, 7.0), (-5.0, -16.0), *FASTER)
    found = [off("r0", 15.0, 0.0), off("r1", 0.0, -16.0)]
    assert beyond_a_dead_band(found, data, ()) == []


def test_runs_that_hardly_move_count_with_both_wheels() -> None:
    data = session_of((15.0, 7.0), (-4.0, -8.0), *FASTER)
    found = [off("r0", 15.0, 0.0), Found("r1", "stuck", "", "")]
    assert beyond_a_dead_band(found, data, {"r1"}) == []
    faster = session_of((15.0, 7.0), (-4.0, -11.0), *FASTER)
    assert beyond_a_dead_band(found, faster, {"r1"}) == found


@pytest.mark.parametrize("turns", [6.5, -6.5])
def test_a_slower_wheel_that_turns_shows_that_the_others_should(turns: float) -> None:
    data = session_of((15.0, 7.0), (-5.0, -16.0), (turns, turns))
    found = [off("r0", 15.0, 0.0), off("r1", 0.0, -16.0)]
    assert beyond_a_dead_band(found, data, ()) == found
    # a run with a mistake of its own shows nothing, nor does a log
    assert beyond_a_dead_band([*found, Found("r2", "pushed", "", "")], data, ()) == [Found("r2", "pushed", "", "")]
    log = RunCommand(Command.steps([(0.5, turns, turns)]), logged=True)
    assert beyond_a_dead_band(found, [*data[:2], replace(data[2], log=log)], ()) == []


def test_a_single_motor_that_is_off_and_other_mistakes_stay() -> None:
    data = session_of((15.0, 7.0), (-5.0, -16.0), *FASTER)
    for found in (
        [off("r0", 15.0, 0.0)],
        [off("r0", 15.0, 0.0), off("r1", 0.0, -17.0)],  # and a faster wheel than commanded
        [off("r0", 15.0, 0.0), Found("r1", "wrong-command", "", "")],
        [off("r0", 15.0, 0.0), Found("r1", "reversed", "", "", correction=Correction(command=(5.0, 16.0)))],
        [off("r0", 15.0, 0.0), Found("r4", "wrong-command", "", "", correction=Correction(command=(30.0, 0.0)))],
    ):
        assert beyond_a_dead_band(found, data, ()) == found


def test_what_hardly_moves_is_told_beside_what_slower_wheels_do() -> None:
    still = replace(driven(0, speed=0.0), left_rpm=9.0, right_rpm=9.0)
    for rpm, told in ((8.0, "though runs of slower wheels do"), (20.0, "and no run of slower wheels does")):
        others = [replace(driven(number), left_rpm=rpm, right_rpm=rpm) for number in range(1, 5)]
        (found,) = disturbed_runs([still, *others], [ROBOT] * 5)
        assert (found.kind, found.seen) == ("stuck", f"hardly moves, {told}")
