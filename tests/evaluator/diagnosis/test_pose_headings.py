"""Headings of another convention are told by the direction of motion, and right ones of robots that slide are not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.misread.pose_headings import in_another_convention
from evaluator.diagnosis.mistakes.motion import midpoint_and_heading
from evaluator.diagnosis.mistakes.recognise import recognise
from evaluator.interchange.commands import RunCommand
from simulator.command import Command
from tests.evaluator.diagnosis.posed_runs import HUSKY, TIME, poses

Floats = NDArray[np.float64]
RIGHT_ANGLE = np.pi / 2


def read_as(run: RunData, reading: Callable[[Floats], Floats]) -> RunData:
    """A run whose headings are what a reading makes of the true ones."""
    _, middle, heading = midpoint_and_heading(run)
    half = np.hypot(*(run.marks_mm[0, :2] - run.marks_mm[0, 2:])) / 2
    line = reading(heading) + run.line_rad
    aside = half * np.column_stack([np.cos(line), np.sin(line)])
    return replace(run, marks_mm=np.concatenate([middle + aside, middle - aside], axis=1))


def rotated(run: RunData, angle: float) -> RunData:
    """A run rotated about the origin."""
    places = (run.marks_mm[:, ::2] + 1j * run.marks_mm[:, 1::2]) * np.exp(1j * angle)
    return replace(run, marks_mm=np.ascontiguousarray(places).view(float))


def runs_read_as(reading: Callable[[Floats], Floats]) -> list[RunData]:
    return [read_as(poses(number), reading) for number in range(6)]


@pytest.mark.parametrize(
    ("reading", "said"),
    [
        (lambda heading: RIGHT_ANGLE - heading, "its headings seem to count clockwise from the y axis"),
        (lambda heading: -RIGHT_ANGLE - heading, "its headings seem to count clockwise from the y axis"),
        (np.negative, "its headings seem to count clockwise (or"),
        (lambda heading: heading + RIGHT_ANGLE, "its headings seem to count from another axis, 90 degrees off"),
        (lambda heading: heading - RIGHT_ANGLE, "its headings seem to count from another axis, 90 degrees off"),
        (lambda heading: heading + 0.7, "its headings are off by 40 degrees"),
        (lambda heading: heading - 0.7, "its headings are off by 40 degrees"),
        (lambda heading: 57.3 * heading, "and its headings follow no usual convention or are in another unit"),
    ],
)
def test_headings_of_all_runs_are_told_by_the_direction_of_motion(
    reading: Callable[[Floats], Floats], said: str
) -> None:
    runs = runs_read_as(reading)
    found = in_another_convention(runs, [HUSKY] * 6)
    assert [item.run for item in found] == [run.id for run in runs]
    assert {item.kind for item in found} == {"wrong-unit"}
    assert all(said in item.seen for item in found)
    assert all(item.remedy.startswith("give headings from the x axis") for item in found)


@pytest.mark.parametrize(
    "reading",
    [
        np.positive,
        lambda heading: heading + np.pi,  # the same line: a robot that drives backward
        lambda heading: heading + 0.35,  # 20 degrees of drift
        lambda heading: heading - 0.35,
    ],
)
def test_robots_that_slide_some_degrees_aside_are_right(reading: Callable[[Floats], Floats]) -> None:
    assert in_another_convention(runs_read_as(reading), [HUSKY] * 6) == []


def test_turns_on_the_spot_and_short_recordings_tell_nothing() -> None:
    aside = [read_as(poses(4), lambda heading: heading + RIGHT_ANGLE)] * 6  # its command is a turn on the spot
    assert in_another_convention(aside, [HUSKY] * 6) == []
    short = [run.first(11) for run in runs_read_as(np.negative)]
    assert in_another_convention(short, [HUSKY] * 6) == []


@pytest.mark.parametrize("every", [False, True])
def test_gentle_turns_judge_where_there_are_some(*, every: bool) -> None:
    """A robot with a load at one end moves far off its heading in tight turns."""
    begin_s = 0.0 if every else 2.0
    runs = []
    for run in runs_read_as(np.positive):
        steps = [(0.0, run.left_rpm, run.right_rpm), (begin_s, 20.0, 60.0)]
        skewed = read_as(run, lambda heading: heading + RIGHT_ANGLE * (begin_s <= TIME))
        runs.append(replace(skewed, log=RunCommand(Command.steps(steps[every:]), logged=True)))
    assert bool(in_another_convention(runs, [HUSKY] * 6)) == every


@pytest.mark.parametrize("along_x", [False, True])
def test_where_straight_parts_agree_some_force_moves_the_robot_aside_in_turns(*, along_x: bool) -> None:
    """Along x alone, headings of the wrong sense agree as well, and only the turns show it."""
    straight = [poses(3 + 6 * number, speed=0.4) for number in range(5)]  # equal sides, each another way
    if along_x:
        straight = [rotated(run, -0.3 * (3 + 6 * number)) for number, run in enumerate(straight)]
    aside = runs_read_as(np.negative if along_x else lambda heading: heading + RIGHT_ANGLE)
    turning = [run for run in aside if run.left_rpm != run.right_rpm]
    assert in_another_convention(turning)
    assert bool(in_another_convention([*straight, *turning])) == along_x


def test_two_runs_may_have_been_pushed() -> None:
    assert in_another_convention(runs_read_as(np.negative)[:2], [HUSKY] * 2) == []


def test_marks_of_a_film_have_no_convention() -> None:
    runs = [replace(run, from_poses=False) for run in runs_read_as(np.negative)]
    assert in_another_convention(runs, [HUSKY] * 6) == []


def test_a_recording_of_another_convention_is_told_among_others_and_once() -> None:
    compass = [replace(run, id=f"r1@{3 * k}.0s") for k, run in enumerate(runs_read_as(lambda h: RIGHT_ANGLE - h))]
    others = [replace(poses(number), id=f"r2@{3 * number}.0s") for number in range(6)]
    others += [replace(poses(number), id=f"r3@{3 * number - 18}.0s") for number in range(6, 12)]
    (mistake,) = recognise([*compass, *others], [HUSKY] * 18)
    assert set(mistake.runs) == {run.id for run in compass}
    assert mistake.sentence.startswith("r1 (6 parts of it): does not move the way it heads")
