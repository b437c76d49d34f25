"""An odometry that is reset leaps to its origin; poses that slip, are held, are wrong once or come late do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.misread.pose_leaps import AROUND, leaping
from evaluator.diagnosis.mistakes.recognise import recognise
from evaluator.diagnosis.mistakes.recognised import Mistake
from evaluator.workflow.runs.mistakes import with_sentences
from tests.evaluator.diagnosis.posed_runs import HUSKY, poses

AT = 41  # the last pose before a leap


def moved(run: RunData, frames: slice, x_mm: float) -> RunData:
    """A run whose poses are elsewhere in some frames."""
    marks = run.marks_mm.copy()
    marks[frames, ::2] += x_mm
    return replace(run, marks_mm=marks)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_run_that_leaps_is_told_alone(way: float) -> None:
    runs = [poses(number) for number in range(6)]
    runs[3] = moved(runs[3], slice(AT + 1, None), way * 3000.0)
    (found,) = leaping(runs, [HUSKY] * 6)
    assert (found.run, found.kind, found.equivalent) == ("r3", "pushed", ("camera-moved",))
    step = np.hypot(*np.diff(runs[3].marks_mm[AT : AT + 2, :2] + runs[3].marks_mm[AT : AT + 2, 2:], axis=0)[0]) / 2
    carried = 50.0 * 2 * np.pi * HUSKY.driving_radius_mm / 60 * 0.1
    said = (
        f"leaps by {step / 1000:.2g} m from 4.10 to 4.20 s, while its wheels carry it by {carried / 1000:.2g} m at most"
    )
    assert found.seen == said
    assert "odometry reset" in found.remedy
    assert ["r3: leaps by " in item.sentence for item in recognise(runs, [HUSKY] * 6) if "r3" in item.runs] == [True]


@pytest.mark.parametrize(
    ("frames", "x_mm", "told"),
    [
        (slice(AT + 1, None), 1500.0, True),
        (slice(AT + 1, None), 700.0, False),  # ten usual steps are 0.75 m
        (slice(AT + 1, AT + 1 + AROUND // 2), 3000.0, False),  # wrong poses
        (slice(AT + 1, AT + 3 + AROUND // 2), 3000.0, True),
        (slice(AROUND, None), 3000.0, True),
        (slice(AROUND - 1, None), 3000.0, False),  # too few before to know that they are right
        (slice(60 - AROUND, None), 3000.0, True),
        (slice(61 - AROUND, None), 3000.0, False),
    ],
)
def test_a_leap_is_far_and_stays(frames: slice, x_mm: float, *, told: bool) -> None:
    run = moved(poses(3, speed=0.9), frames, x_mm)
    assert bool(leaping([run], [HUSKY])) == told


def test_a_leap_of_a_robot_that_hardly_moves_is_half_as_far_as_it_is_wide() -> None:
    slow = poses(3, speed=0.002)
    slow.marks_mm[:] = slow.marks_mm[0]
    slow.marks_mm[:, ::2] += 1e-3 * np.arange(60)[:, None]
    carried_mm = 50.0 * 2 * np.pi * HUSKY.driving_radius_mm / 60 * 0.1
    for width, told in ((0.49, False), (0.51, True)):
        far = moved(slow, slice(AT + 1, None), width * HUSKY.track_mm + carried_mm)
        assert bool(leaping([far], [HUSKY])) == told


@pytest.mark.parametrize(("poses_of_run", "told"), [(19, False), (20, True)])
def test_a_run_of_few_poses_has_no_usual_step(poses_of_run: int, *, told: bool) -> None:
    part = slice(AT - 9, AT - 9 + poses_of_run)
    leaps = moved(poses(3), slice(AT + 1, None), 3000.0)
    few = replace(leaps, time_s=leaps.time_s[part], marks_mm=leaps.marks_mm[part])
    assert bool(leaping([few], [HUSKY])) == told


def test_poses_that_are_held_late_or_of_marks_do_not_leap() -> None:
    run = poses(3)
    held = np.repeat(run.marks_mm[::20], 20, axis=0)
    assert leaping([replace(run, marks_mm=held)], [HUSKY]) == []
    kept = np.r_[0:30, 50:60]  # two seconds without a pose
    late = replace(run, time_s=run.time_s[kept], marks_mm=run.marks_mm[kept])
    assert leaping([late], [HUSKY]) == []
    leaps = moved(run, slice(AT + 1, None), 3000.0)
    assert leaping([replace(leaps, from_poses=False)], [HUSKY]) == []
    assert leaping([replace(leaps, left_rpm=0.0, right_rpm=0.0)], [HUSKY]) == []


def test_the_mistake_of_a_part_stands_with_its_recording() -> None:
    leap = Mistake(("d1@28.2s",), "pushed", "d1 (from 28.2 s on): leaps by 0.7 m")
    own = Mistake(("d2",), "pushed", "d2: is pushed")
    both = Mistake(("d1", "d2"), "wrong-unit", "all runs, d1 for example: are in cm", everywhere=True)
    notes = with_sentences({"d1": ("noise",)}, [both, own, leap])
    assert notes == {"d1": ("leaps by 0.7 m", both.sentence, "noise"), "d2": ("is pushed",)}
