"""Other readings of a run: phases of a log, runs of a kind, what else a command or a rate may have been."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evaluator.diagnosis.likelihood.run_data import RunData, Task
from evaluator.diagnosis.likelihood.simulation import Simulated
from evaluator.diagnosis.mistakes.intervals import phases_of
from evaluator.diagnosis.mistakes.misread.alternatives import OFFSETS_S, alternatives, distinct_commands, thinned
from evaluator.diagnosis.mistakes.misread.hypotheses import _extent, _misfit, _turned, judgements_of, misread_runs
from evaluator.diagnosis.mistakes.misread.judgement import unsigned_speeds
from evaluator.interchange.commands import RunCommand
from simulator.command import Command
from simulator.robot import load_robot
from tests.evaluator.diagnosis.marks_of_motion import TIME, moving, recorded

LOG = RunCommand(Command.steps([(0.0, 0.0, 0.0), (0.5, 30.0, 20.0), (1.5, 0.0, 0.0), (2.0, -20.0, 30.0)]), logged=True)


def test_phases_of_a_log_are_its_commands_with_a_motor_on() -> None:
    run = replace(recorded(moving(TIME)), log=LOG)
    first, second = phases_of(run)
    assert (first.command, first.start_s, first.stop_s, first.log) == ((30.0, 20.0), 0.5, 1.5, None)
    assert (second.command, second.start_s, second.stop_s) == ((-20.0, 30.0), 2.0, None)
    assert (first.time_s[0], first.time_s[-1]) == pytest.approx((0.5, 1.5))
    assert len(first.marks_mm) == len(first.time_s) == 61
    assert phases_of(replace(run, log=None))[0].log is None
    late = replace(run, time_s=run.time_s[60:], marks_mm=run.marks_mm[60:])
    assert phases_of(late)[0].start_s == 1.0
    for unseen, phases in ((57, 2), (58, 1)):  # four of 61 frames are a phase
        holed = run.marks_mm.copy()
        holed[30 : 30 + unseen] = np.nan
        assert len(phases_of(replace(run, marks_mm=holed))) == phases


def test_runs_are_kin_whose_wheels_turn_alike_to_either_side_either_way() -> None:
    run = recorded(moving(TIME))
    assert unsigned_speeds(run) == ((20.0, 30.0),)
    assert unsigned_speeds(replace(run, left_rpm=-20.0, right_rpm=30.0)) == ((20.0, 30.0),)
    assert unsigned_speeds(replace(run, log=LOG)) == ((20.0, 30.0), (20.0, 30.0))
    assert unsigned_speeds(replace(run, left_rpm=31.0)) != unsigned_speeds(run)


def test_misfit_is_what_no_rotation_and_shift_take_away_and_extent_the_larger_of_both_paths() -> None:
    marks = moving(TIME)
    turned = moving(TIME, heading=1.5) + 4.0
    assert _misfit(marks, turned) == pytest.approx(0.0, abs=1e-9)
    assert _misfit(marks, np.full_like(marks, np.nan)) != _misfit(marks, turned)
    assert np.isnan(_misfit(marks, np.where(np.arange(180)[:, None] == 7, np.nan, marks)))
    straight = moving(TIME, 2.0, 0.0)
    spread = 2.0 * np.std(TIME)
    assert _extent(straight, moving(TIME, 1.0, 0.0)) == pytest.approx(spread)
    assert _extent(moving(TIME, 1.0, 0.0), straight) == pytest.approx(spread)


@pytest.mark.parametrize(
    ("turned", "kinds"),
    [
        *((-0.9, {"sides-swapped", "mirrored"}), (-0.3, {"sides-swapped", "mirrored"})),
        *((-0.2, set()), (0.3, set()), (0.9, set())),
    ],
)
def test_a_run_turns_the_other_way_only_if_it_does_by_a_quarter(turned: float, kinds: set[str]) -> None:
    """Of what its command says; mirrored, it turns that way, which is compared."""
    run = replace(recorded(np.zeros((180, 4))), left_rpm=14.4, right_rpm=33.3)
    robot = load_robot("barrel")
    (marks,) = Simulated([robot], [run], {}).marks([Task(0, (0.0,) * 7)])
    heading = _turned(marks)[-1] * turned
    seen = replace(run, marks_mm=moving(TIME, 1.0, float(heading / TIME[-1])))
    (judged,) = judgements_of([alternatives(thinned(seen), [thinned(seen)], 1.0, 0.02)], [robot])
    assert {way.kind for way in judged.ways} & {"sides-swapped", "mirrored"} == kinds
    assert judged.ways[0].kind is None
    assert len(judged.ways) == len(judged.misfits_mm)


def ways_of(run: RunData, *others: RunData, ratio: float | None = None) -> dict[str, list[RunData]]:
    found: dict[str, list[RunData]] = {}
    for way in alternatives(run, distinct_commands([run, *others]), ratio, 0.04):
        found.setdefault(str(way.kind), []).append(way.run)
    return found


def test_a_command_that_many_runs_have_counts_once_constant_or_in_a_log() -> None:
    run = recorded(moving(TIME))
    other, logged = replace(run, left_rpm=60.0), replace(run, log=LOG)
    same_log = replace(logged, id="again", log=RunCommand(Command(*LOG.command.knots.T), logged=True))
    found = distinct_commands([run, run, logged, other, same_log, run])
    assert [id(each) for each in found] == [id(run), id(logged), id(other)]


def test_a_run_may_be_driven_the_other_way_round_exchanged_or_seen_in_a_mirror() -> None:
    run = recorded(moving(TIME))
    found = ways_of(run, replace(run, left_rpm=-30.0, right_rpm=-20.0), replace(run, left_rpm=60.0))
    assert found["reversed"][0].command == (-30.0, -20.0)
    assert found["sides-swapped"][0].command == (20.0, 30.0)
    np.testing.assert_array_equal(found["marks-swapped"][0].marks_mm[:, :2], run.marks_mm[:, 2:])
    np.testing.assert_array_equal(found["mirrored"][0].marks_mm, run.marks_mm * [-1, 1, -1, 1])
    # the command of another run, as far as no kind of its own tells it, then slips of the keyboard
    mistyped = [(3.0, 20.0), (300.0, 20.0), (-30.0, 20.0), (0.0, 20.0)]
    mistyped += [(30.0, 2.0), (30.0, 200.0), (30.0, -20.0), (30.0, 0.0), (60.0, 40.0)]
    ways = [(-60.0, -20.0), (-20.0, -60.0), (20.0, 60.0), (60.0, 20.0)]
    assert [other.command for other in found["wrong-command"]] == [*ways, *mistyped]
    off = ways_of(run, replace(run, left_rpm=40.0, right_rpm=0.0))["wrong-command"]
    assert "-0" not in " ".join(f"{left:g} {right:g}" for left, right in (other.command for other in off)).split()
    assert "late-start" not in found
    backward = ways_of(replace(run, left_rpm=-15.0, right_rpm=-6.0))["wrong-command"]
    assert "-15 / 0" in [f"{left:g} / {right:g}" for left, right in (other.command for other in backward)]  # not -0
    assert "sides-swapped" not in ways_of(replace(run, left_rpm=20.0))
    assert "reversed" not in ways_of(replace(run, left_rpm=0.0, right_rpm=0.0))


@pytest.mark.parametrize(
    ("stated", "true"),
    [(24, 30), (24, 60), (25, 30), (25, 60), (30, 60), (25, 50), (60, 120), (30, 120), (60, 240), (30, 240)],
)
def test_a_run_may_have_been_taken_at_another_usual_rate_than_its_file_says(stated: int, true: int) -> None:
    frames = np.arange(90)
    for one, other in ((stated, true), (true, stated)):
        ways = ways_of(recorded(moving(frames / true), frames / one))["wrong-rate"]
        assert any(np.allclose(way.time_s, frames / other) for way in ways)


def test_a_run_of_another_frame_interval_may_be_at_the_rate_that_this_says() -> None:
    run = recorded(moving(TIME))
    assert len(ways_of(run)["wrong-rate"]) == 14
    (double,) = ways_of(run, ratio=2.06)["wrong-rate"]
    np.testing.assert_allclose(double.time_s, run.time_s / 2)
    assert "wrong-rate" not in ways_of(run, ratio=2.1)


@pytest.mark.parametrize(
    ("begins_s", "shown"),
    [
        (0.5, []),  # as stated
        (1.0, [2.0]),  # at twice the time: frames count half as often as they should
        (0.27, [0.5]),
        (1.7, []),  # late, and by no usual rate
        (None, []),  # no rest is seen before
    ],
)
def test_a_start_at_the_time_of_another_rate_is_evidence_for_it(begins_s: float | None, shown: list[float]) -> None:
    """It was told as a start that is 0.25 s early, of a run that seemed to drive twice as fast."""
    since = TIME if begins_s is None else np.maximum(TIME - begins_s, 0.0)
    run = replace(recorded(moving(since)), start_s=0.5)
    ways = [way for way in alternatives(run, [], None, 0.04) if way.own]
    assert {way.kind for way in ways} == ({"wrong-rate"} if shown else set())
    found = [run.time_s[-1] / way.run.time_s[-1] for way in ways]
    assert found == pytest.approx(shown, rel=1e-3)


def test_a_log_may_be_reversed_exchanged_that_of_another_run_or_up_to_two_seconds_off() -> None:
    run = replace(recorded(moving(TIME)), log=LOG, start_s=0.5)
    other = replace(run, id="other", log=RunCommand(Command.steps([(0.0, 10.0, 10.0)]), logged=True))
    found = ways_of(run, other, replace(other, id="same as other"), replace(run, id="same"))
    (backward,), (swapped,) = found["reversed"], found["sides-swapped"]
    assert backward.log is not None
    assert swapped.log is not None
    assert backward.log.command.at(1.0) == pytest.approx((-30.0, -20.0))
    assert swapped.log.command.at(1.0) == pytest.approx((20.0, 30.0))
    assert [way.log for way in found["wrong-command"]] == [other.log]
    shifted = {round(way.start_s - 0.5, 3): way for way in found["late-start"]}
    assert sorted(shifted) == sorted(OFFSETS_S)
    assert (min(OFFSETS_S), max(OFFSETS_S), len(OFFSETS_S)) == (-2.0, 2.0, 40)
    later = shifted[0.3].log
    assert later is not None
    assert [float(later.command.at(at)[0]) for at in (0.75, 0.85)] == [0.0, 30.0]


def test_thinned_runs_keep_eighty_seen_frames_from_first_to_last() -> None:
    run = recorded(moving(TIME))
    marks = run.marks_mm.copy()
    marks[0] = np.nan
    thin = thinned(replace(run, marks_mm=marks))
    assert (len(thin.time_s), thin.time_s[0], thin.time_s[-1]) == (80, TIME[1], TIME[-1])
    assert np.isfinite(thin.marks_mm).all()
    assert len(thinned(replace(run, time_s=TIME[:50], marks_mm=marks[:50])).time_s) == 49


def test_runs_that_fit_another_reading_of_their_command_are_named_and_no_others() -> None:
    """Of four simulated turns, the first is stated the other way round, and the third with its sides exchanged."""
    robots = [load_robot("barrel")] * 4
    blank = recorded(np.zeros((180, 4)))
    commands = [(33.3, 14.4), (-33.3, -14.4), (30.0, 50.0), (60.0, 40.0)]
    runs = [
        replace(blank, id=f"r{number}", left_rpm=left, right_rpm=right, order=number)
        for number, (left, right) in enumerate(commands)
    ]
    marks = Simulated(robots, runs, {}).marks([Task(number, (0.0,) * 7) for number in range(4)])
    right = [replace(run, marks_mm=seen) for run, seen in zip(runs, marks, strict=True)]
    assert misread_runs(right, robots) == []
    wrong = [*right]
    wrong[0] = replace(right[0], left_rpm=-33.3, right_rpm=-14.4)
    wrong[2] = replace(right[2], left_rpm=50.0, right_rpm=30.0)
    assert [(item.run, item.kind) for item in misread_runs(wrong, robots)] == [
        ("r0", "reversed"),
        ("r2", "sides-swapped"),
    ]
