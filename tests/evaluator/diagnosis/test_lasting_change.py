"""Runs whose speed changes at once and for good though their command stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.disturbances import disturbed_runs
from evaluator.diagnosis.mistakes.intervals import lasting_change
from evaluator.diagnosis.mistakes.motion import Motion
from evaluator.diagnosis.mistakes.recognised import Found
from tests.evaluator.diagnosis.marks_of_motion import moving, recorded
from tests.evaluator.diagnosis.straight_session import ROBOT

TIMES = np.arange(0.0, 6.0, 0.075)


def motion(speed: np.ndarray) -> Motion:
    still = np.zeros(len(speed))
    return Motion(TIMES[: len(speed)], speed, still, still)


def changing(number: int = 0, factor: float = -1.0, at_s: float = 3.0, lasts_s: float = 0.0) -> RunData:
    """Six seconds on a circle at 2 mm/s, from at_s on by a factor, reached evenly within a time."""
    time = np.arange(360) / 60
    speed = 1 + (factor - 1) * np.clip((time - at_s) / max(lasts_s, 1e-9), 0.0, 1.0)
    way = np.concatenate([[0.0], np.cumsum(speed[:-1]) / 60])
    return replace(recorded(moving(way), time), id=f"r{number}")


def changed(run: RunData, others: int = 7) -> list[Found]:
    session = [run, *(changing(number, 1.0) for number in range(1, others + 1))]
    return disturbed_runs(session, [ROBOT] * len(session))


@pytest.mark.parametrize(("after", "found"), [(-1.5, True), (0.7, True), (0.8, False), (2.8, False), (3.2, True)])
def test_a_speed_changes_for_good_by_half_of_the_larger_one(after: float, found: bool) -> None:
    told = lasting_change(motion(np.where(TIMES < 3.0, 1.5, after)))
    assert (told is not None) == found
    if told is not None:
        assert told == pytest.approx((3.0, 1.5, after), abs=0.04)


def test_a_change_is_larger_than_the_scatter_on_either_side_and_than_their_own_course() -> None:
    random = np.random.default_rng(1)
    step = np.where(TIMES < 3.0, 1.5, -1.5)
    assert lasting_change(motion(step + random.normal(0.0, 0.3, len(TIMES)))) is not None
    assert lasting_change(motion(step + random.normal(0.0, 0.8, len(TIMES)))) is None
    assert lasting_change(motion(1.5 - TIMES / 2)) is None  # a slope that turns the robot round
    assert lasting_change(motion(step + np.where(TIMES < 3.0, 0.4, 0.9) * (TIMES % 3.0))) is None


@pytest.mark.filterwarnings("error")
def test_a_change_beside_which_frames_are_missing_is_none() -> None:
    for first, told in ((1, False), (2, True)):  # moments before it, of whose halves one would have none
        found = motion(np.where(np.arange(len(TIMES)) < first, 1.5, -1.5))
        found = replace(found, time_s=TIMES + 2.0 * (np.arange(len(TIMES)) >= first))
        assert (lasting_change(found) is not None) == told


def test_speeds_are_those_beside_the_window_of_the_change() -> None:
    """Windows that hold both speeds are of neither."""
    speed = np.where(TIMES < 3.0, 1.5, -1.5)
    speed[np.abs(TIMES - 2.9625) < 0.14] = 0.2
    assert lasting_change(motion(speed)) == pytest.approx((3.0, 1.5, -1.5), abs=0.15)


@pytest.mark.parametrize(("at_s", "found"), [(0.4, False), (0.9, True), (5.0, True), (5.6, False)])
def test_both_speeds_are_seen_for_three_quarters_of_a_second(at_s: float, found: bool) -> None:
    assert (lasting_change(motion(np.where(at_s > TIMES, 1.5, -1.5))) is not None) == found


def test_a_run_that_is_too_short_for_both_shows_no_change() -> None:
    assert lasting_change(motion(np.where(TIMES[:18] < 0.6, 1.5, -1.5))) is None


def test_motors_that_are_reversed_without_a_word_are_told_with_time_speeds_and_what_to_do() -> None:
    (found,) = changed(changing())
    assert (found.run, found.kind) == ("r0", "wrong-command")
    assert found.seen == "drives at 2 mm/s until 3.01 s and at −2 mm/s from there on, though its command stays"
    assert (
        "did a motor fail, or does something hold it? Name its command log (commands), or end it there" in found.remedy
    )


@pytest.mark.parametrize(
    "run",
    [
        changing(factor=0.6),
        changing(lasts_s=4.0, at_s=1.0),
        replace(changing(), right_rpm=-20.0),  # on the spot
        replace(changing(), stop_s=3.5),  # it is switched off soon
    ],
)
def test_small_slow_and_late_changes_and_turns_on_the_spot_are_left_alone(run: RunData) -> None:
    assert [item.run for item in changed(run) if "command stays" in item.seen] == []


@pytest.mark.parametrize(("count", "told"), [(2, True), (3, False)])
def test_changes_in_more_than_a_quarter_of_the_runs_are_no_accidents(count: int, told: bool) -> None:
    session = [changing(number, -1.0 if number < count else 1.0) for number in range(8)]
    found = disturbed_runs(session, [ROBOT] * 8)
    assert [item.run for item in found] == ([f"r{number}" for number in range(count)] if told else [])
