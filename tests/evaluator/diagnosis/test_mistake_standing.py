"""Robots that stand with their motors on are stuck, from the start or soon after it, unless slower ones stand, too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evaluator.diagnosis.mistakes.disturbances import disturbed_runs, standing_runs
from tests.evaluator.diagnosis.straight_session import ROBOT, ROLLED_MM_S, driven, kinds, session

TIME = np.arange(180) / 60  # s; driven from 0.5 s on


@pytest.mark.parametrize(("share", "stands"), [(0.0485, True), (0.0515, False)])
def test_a_run_stands_that_covers_less_than_a_twentieth_of_what_its_wheels_roll(share: float, stands: bool) -> None:
    run = driven(0, speed=share * ROLLED_MM_S / 0.94)  # the 95th percentile of 2.48 s of the way
    assert standing_runs([run], [ROBOT]) == ({"r0"} if stands else set())


def test_a_run_that_stands_is_stuck_unless_all_slower_ones_stand_too() -> None:
    still = driven(0, speed=0.0)
    (found,) = disturbed_runs(session(still), [ROBOT] * 8)
    assert found.seen == "hardly moves, though runs of slower wheels do"  # all of it, not from some time on
    assert ("r0", "stuck") in kinds(disturbed_runs(session(still), [ROBOT] * 8))
    faster = [replace(driven(number), left_rpm=60.0, right_rpm=60.0) for number in range(2, 6)]
    for rpm in (10.0, 0.5):
        slower = replace(driven(1, speed=0.0), left_rpm=rpm, right_rpm=rpm)
        assert kinds(disturbed_runs([still, slower, *faster], [ROBOT] * 6)) == [("r1", "stuck")]  # none is slower


@pytest.mark.parametrize(("until_s", "share", "told"), [(0.9, 0.0, True), (0.9, 0.04, True), (0.9, 0.06, False)])
def test_a_run_that_gets_caught_soon_after_its_start_is_stuck(until_s: float, share: float, told: bool) -> None:
    """It drove for 0.4 s and was told to follow the command of a slower run; share: of the path rolled, afterwards."""
    run = driven(0, speed=np.where(until_s > TIME, 1.5, share * ROLLED_MM_S / 0.95))
    found = disturbed_runs(session(run), [ROBOT] * 8)
    assert [(item.run, item.seen) for item in found] == told * [
        ("r0", "hardly moves from 1.00 s on, though runs of slower wheels do")
    ]


def test_robots_that_all_stand_after_they_coasted_stand_for_a_reason() -> None:
    """Below a dead band a robot coasts to rest: the command is not wrong, nor is the robot held."""
    coasting = [
        replace(driven(number, speed=np.where(TIME < 0.8, 1.5, 0.0)), left_rpm=5.0, right_rpm=5.0) for number in (0, 1)
    ]
    faster = [driven(number) for number in range(2, 8)]
    assert disturbed_runs([*coasting, *faster], [ROBOT] * 8) == []
    assert standing_runs([*coasting, *faster], [ROBOT] * 8) == {"r0", "r1"}
