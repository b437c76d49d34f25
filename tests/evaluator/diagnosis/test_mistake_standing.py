"""Robots that stand with motors on are stuck, unless slower ones stand, too; robots that outrun them are pushed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.disturbances import disturbed_runs, standing_runs
from evaluator.diagnosis.mistakes.outrun import outruns_its_wheels
from evaluator.interchange.commands import RunCommand
from simulator.command import Command
from tests.evaluator.diagnosis.straight_session import GREEN, ROBOT, ROLLED_MM_S, YELLOW, driven, kinds, session

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


@pytest.mark.parametrize(("rpm", "kind"), [(900.0, "wrong-command"), (30.0, "")])
def test_a_run_that_gets_far_but_not_as_far_as_its_wheels_has_another_command(rpm: float, kind: str) -> None:
    """A digit too many: the robot moves as always."""
    run = replace(driven(0, speed=2.0), left_rpm=rpm, right_rpm=rpm)
    found = disturbed_runs(session(run), [ROBOT] * 8)
    assert kinds(found) == ([("r0", kind)] if kind else [])
    assert all(item.seen.startswith("gets 4.7 mm far, less than a twentieth of what its wheels") for item in found)


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


def pushed(at_s: float, lasts_s: float, by_mm: float) -> np.ndarray:
    """Speeds of a run that is pushed on its way, mm/s."""
    return np.where((at_s <= TIME) & (at_s + lasts_s > TIME), by_mm / lasts_s, 1.5)


@pytest.mark.parametrize(
    ("speed", "told"),
    [
        (pushed(0.7, 0.08, 1.0), True),  # 0.2 s after its start: its motion before is too short to be known
        (pushed(0.7, 0.08, 0.45), False),  # 0.55 mm in 0.15 s, while its wheels roll 0.24: within 0.2 mm of 1.6 times
        (pushed(1.5, 0.4, 4.0), True),
        (pushed(1.5, 0.6, 6.0), False),  # no hand: a magnet that captures it, a slope
        (np.full(180, 4.0), False),  # all the time: another command
    ],
)
def test_a_robot_that_outruns_its_wheels_for_a_moment_is_pushed(speed: np.ndarray, told: bool) -> None:
    """The speed of a push was told as that of the run: its recording ended 0.5 s later."""
    found = outruns_its_wheels(driven(0, speed=speed), ROBOT)
    assert (found is not None) == told
    if found is not None:
        assert (found.kind, found.equivalent) == ("pushed", ("camera-moved",))
    assert outruns_its_wheels(replace(driven(0, speed=speed), from_poses=True), ROBOT) is None


NARROW = ROBOT.model_copy(update={"wheels": ROBOT.wheels.model_copy(update={"track_mm": 3.4})})


def pivot_about_the_front_axle(push_mm: float = 0.0) -> RunData:
    """A turn on the spot whose front wheels do not slide: 30 rpm forward on the right, backward on the left.

    0.6 s of it were not recorded; at 2 s, a hand pushes it in 0.1 s.
    """
    seen = (TIME < 1.2) | (TIME > 1.8)
    heading = 2 * ROLLED_MM_S / NARROW.track_mm * np.maximum(TIME[seen] - 0.5, 0.0)
    push = push_mm * np.clip((TIME[seen] - 2.0) / 0.1, 0.0, 1.0)
    axle = float(NARROW.wheel_positions_mm()[:, 0].max())
    paths = [push + complex(x - axle, y) * np.exp(1j * heading) for x, y in (GREEN, YELLOW)]
    marks = np.column_stack([part for path in paths for part in (path.real, path.imag)])
    noise = 1e-4 * np.random.default_rng(1).normal(size=marks.shape)
    return replace(driven(0), left_rpm=-30.0, right_rpm=30.0, time_s=TIME[seen], marks_mm=marks + noise)


def test_a_turn_on_the_spot_about_the_front_axle_is_no_push() -> None:
    """The marks, 3.5 mm behind that axle, are twice as fast as the rims."""
    assert outruns_its_wheels(pivot_about_the_front_axle(), NARROW) is None
    assert disturbed_runs(session(pivot_about_the_front_axle()), [NARROW] * 8) == []
    found = outruns_its_wheels(pivot_about_the_front_axle(2.0), NARROW)
    assert found is not None
    assert found.kind == "pushed"


def test_motors_that_follow_a_log_late_do_not_make_a_robot_outrun_its_wheels() -> None:
    """Told to slow down from 60 to 8 rpm at 1.5 s, it goes on for 0.3 s."""
    log = RunCommand(Command.steps([(0.5, 60.0, 60.0), (1.5, 8.0, 8.0)]), logged=True)
    late = replace(driven(0, speed=np.where(TIME > 1.8, 0.4, 3.1)), log=log)
    assert outruns_its_wheels(late, ROBOT) is None
    assert disturbed_runs(session(late), [ROBOT] * 8) == []
    swept = replace(driven(0, speed=np.where((TIME > 1.8) & (TIME < 1.95), 12.0, 3.1)), log=log)
    assert outruns_its_wheels(swept, ROBOT) is not None


def test_a_hand_that_takes_the_robot_away_is_told_with_the_time_at_which_the_run_should_end() -> None:
    """The robot seemed to stand still for most of its run, as slow as it is beside a hand."""
    taken = driven(0, speed=np.where(TIME > 2.6, 25.0, 0.9))
    (found,) = disturbed_runs(session(taken), [ROBOT] * 8)
    assert found.kind == "pushed"
    stop_s = float(found.remedy.partition("stop_s = ")[2].rstrip(")"))
    assert 2.4 < stop_s <= 2.6


def test_a_push_is_told_with_the_way_and_how_far_the_wheels_carry_it_meanwhile() -> None:
    found = outruns_its_wheels(driven(0, speed=pushed(0.7, 0.08, 1.0)), ROBOT)
    assert found is not None
    carried = f"{0.15 * ROLLED_MM_S:.2g} mm at most"
    assert found.seen.startswith("moves by 1.1 mm from 0.")
    assert found.seen.endswith(f"while its wheels carry it by {carried}")
    wrong = driven(0)
    wrong.marks_mm[90:92] += 3.0  # two frames
    assert outruns_its_wheels(wrong, ROBOT) is None
