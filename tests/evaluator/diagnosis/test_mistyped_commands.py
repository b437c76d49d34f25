"""Commands that were written wrongly: which numbers a slip leaves, and from where on the motion of a run shows it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evaluator.diagnosis.mistakes.misread.alternatives import Alternative, alternatives
from evaluator.diagnosis.mistakes.misread.belief import far_from_the_others, without_shared_commands
from evaluator.diagnosis.mistakes.misread.hypotheses import _judged
from evaluator.diagnosis.mistakes.misread.judgement import Judgement
from evaluator.diagnosis.mistakes.misread.typing_slips import before_a_slip
from evaluator.diagnosis.mistakes.outrun import outruns_its_wheels
from evaluator.diagnosis.mistakes.recognised import Correction, Found
from tests.evaluator.diagnosis.straight_session import ROBOT, ROLLED_MM_S, driven

RUN = driven(0)


@pytest.mark.parametrize(
    ("written", "meant", "what"),
    [
        (-3.3999999999999986, -30.4, "for a digit left out"),
        (6.0, 26.0, "for a digit left out"),
        (35.3, 53.3, "for two digits exchanged"),
        (-112.5, -12.5, "for a digit typed twice"),
    ],
)
def test_a_slip_of_the_keyboard_leaves_out_doubles_or_exchanges_digits(written: float, meant: float, what: str) -> None:
    assert before_a_slip(written)[meant] == what


def test_no_slip_leaves_a_number_as_it_was_or_a_motor_off() -> None:
    assert before_a_slip(0.0) == {}
    assert 33.0 not in before_a_slip(33.0)
    assert all(number < 0 for number in before_a_slip(-11.0))


def test_a_side_was_not_mistyped_from_a_speed_beyond_all_of_the_session() -> None:
    run, fastest = replace(RUN, left_rpm=3.4, right_rpm=13.1), replace(RUN, left_rpm=40.0)
    commands = {way.run.command for way in alternatives(run, [run, fastest], None, 0.04) if way.slip}
    assert {(30.4, 13.1), (39.4, 13.1), (3.4, 31.1)} <= commands
    assert not {(43.4, 13.1), (3.4, 131.1)} & commands


def test_what_displaces_all_runs_alike_does_not_count_more_in_short_runs() -> None:
    """Marks that are 0.06 mm off: more than half of a path of 0.1 mm, and nothing of a path of 1 mm."""
    mistyped, short = Found("r0", "wrong-command", "", ""), [0.058, 0.057, 0.06, 0.059]
    runs = [(0.44, 0.75), *((misfit, extent) for misfit, extent in zip(short, [0.1, 0.4, 1.0, 2.0], strict=True))]
    assert far_from_the_others([mistyped], judged(runs)) == {"r0"}
    bent = [*runs[:-1], (0.5, 2.0)]  # a quarter of its path: an effect, which bends others as much
    assert far_from_the_others([mistyped], judged(bent)) == set()
    noisy = [(0.17, 0.75), *runs[1:]]  # less than three times what all runs are off
    assert far_from_the_others([mistyped], judged(noisy)) == set()


def judged(runs: list[tuple[float, float]]) -> list[Judgement]:
    """Runs with their misfits and extents, mm."""
    return [
        Judgement([Alternative(None, replace(RUN, id=f"r{k}"))], np.array([misfit]), extent, ())
        for k, (misfit, extent) in enumerate(runs)
    ]


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ([26.0, 10.0, 20.0, 30.0, 40.0], 0),  # r2 and r4 move as r0: a fence, not a keyboard
        ([10.0, 20.0, 30.0, 26.0, 40.0], 2),  # in a row: the program stayed at its command
        ([26.0, 10.0, 20.0, 26.0, 40.0], 2),  # a command that is driven again is mixed up more easily
    ],
)
def test_runs_apart_that_share_the_motion_of_a_third_are_led_by_the_plate(given: list[float], told: int) -> None:
    runs = [replace(RUN, id=f"r{k}", left_rpm=speed, right_rpm=26.0) for k, speed in enumerate(given)]
    seen = [Judgement([Alternative(None, run)], np.array([1.0]), 10.0, ()) for run in runs]
    found = [
        Found(run, "wrong-command", "moves as if", "", correction=Correction(command=(26.0, 26.0)))
        for run in ("r2", "r4")
    ]
    assert without_shared_commands(found, seen) == found[:told]
    assert without_shared_commands(found[:1], seen) == found[:1]


@pytest.mark.parametrize(("slip", "corrects"), [(True, True), (False, False)])
def test_a_command_that_fits_a_little_worse_than_other_runs_is_believed_if_digits_show_the_slip(
    slip: bool, corrects: bool
) -> None:
    ways = [Alternative(None, RUN), Alternative("wrong-command", replace(RUN, left_rpm=-30.0), "x", slip=slip)]
    found = _judged(Judgement(ways, np.array([3.0, 0.6]), 10.0, ()), set(), good_mm=0.54)
    assert found is not None
    assert (found.correction is not None) == corrects
    assert ("no usual mistake fits" in found.seen) != corrects


@pytest.mark.parametrize(("times", "pushed"), [(1.0, True), (3.5, False)])
def test_a_run_that_is_faster_than_slow_wheels_all_the_time_is_not_pushed(times: float, pushed: bool) -> None:
    """At 3 rpm only the moment in which it is fastest is a leap; times: its usual speed over that of its wheels."""
    time = np.arange(180) / 60
    speed = np.where((time > 1.5) & (time < 1.8), 2 * ROLLED_MM_S, times * ROLLED_MM_S / 10)
    run = replace(driven(0, speed=speed), left_rpm=3.0, right_rpm=3.0)
    assert (outruns_its_wheels(run, ROBOT) is not None) == pushed
