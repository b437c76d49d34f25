"""Times of frames: other units, frame numbers, and frames that a recorder lost, in synthetic turns with noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from evaluator.diagnosis.likelihood.run_data import Floats, RunData
from evaluator.diagnosis.mistakes.frame_times import (
    advances,
    frame_numbers,
    lost_frames,
    runs_with_lost_frames,
    wrong_seconds,
)
from evaluator.workflow.editing.mending import mended_marks
from simulator.robot import load_robot
from tests.evaluator.diagnosis.marks_of_motion import RATE, moving

LONG = np.arange(420) / RATE


def losing(
    frames: dict[int, int], seed: int = 0, speed: float = 2.0, name: str = "r", noise_mm: float = 0.005
) -> RunData:
    """A turn of 7 s that lost some frames, by the index of the first frame after them."""
    ahead = sum(((np.arange(len(LONG)) >= at) * count for at, count in frames.items()), np.zeros(len(LONG)))
    marks = moving(LONG + ahead / RATE, speed, 0.2 * speed)
    marks += noise_mm * np.random.default_rng(seed).normal(size=marks.shape)
    return RunData(name, 30.0, 20.0, 0.0, None, LONG, marks, 0)


@pytest.mark.parametrize(
    ("factor", "said", "correction"),
    [
        (1e3, "in milliseconds", 1e-3),
        (1e6, "in microseconds", 1e-6),
        (1e9, "in nanoseconds", 1e-9),
        (60.0, "frame numbers", None),
        (1.0, None, None),
        (10.0, None, None),  # six frames a second
        (50.0, None, None),  # a frame in 0.83 s
    ],
)
def test_times_in_another_unit_are_told(factor: float, said: str | None, correction: float | None) -> None:
    run = replace(losing({}), time_s=LONG * factor)
    found = wrong_seconds([run], [load_robot("barrel")])
    assert bool(found) == (said is not None)
    for item in found:
        assert item.kind == "wrong-unit"
        assert said in item.remedy
        assert (item.correction and item.correction.seconds_times) == correction
    slow = replace(run, left_rpm=0.02, right_rpm=0.01)  # a few frames a minute of a robot as slow as that
    assert bool(wrong_seconds([slow], [load_robot("barrel")])) == (factor > 1e3)


def test_times_of_eight_frames_tell_no_unit() -> None:
    still = replace(losing({}), time_s=LONG[:9], marks_mm=np.zeros((9, 4)))
    assert wrong_seconds([replace(still, time_s=60 * LONG[:9])], [load_robot("barrel")]) != []
    few = replace(still, time_s=60 * LONG[:8], marks_mm=np.zeros((8, 4)))
    assert wrong_seconds([few], [load_robot("barrel")]) == []


def test_error_of_an_advance_is_that_of_a_step_in_a_cubic() -> None:
    """In each of three coordinates, of which the scatter is that of all; wider where advances scatter more."""
    rng, around = np.random.default_rng(3), 18
    course = np.column_stack([2 * LONG, 0.5 * LONG, 0 * LONG]) + 0.01 * rng.normal(size=(len(LONG), 3))
    found, sigma, speed = advances(np.arange(len(LONG)), course, around)
    since = (np.arange(2 * around) - around + 0.5) / around
    design = np.column_stack([since**0, since, since**2, since**3, since > 0])
    error = np.sqrt(np.linalg.inv(design.T @ design)[4, 4])
    own = np.full(len(LONG), np.nan)
    for k in range(around, len(LONG) - around):
        window = course[k - around : k + around]
        left = window - design @ np.linalg.lstsq(design, window, rcond=None)[0]
        own[k] = np.sqrt(np.sum(left**2) / (3 * (2 * around - 5))) * error / speed[k]
    inner = np.isfinite(own) & np.isfinite(found)
    wider = sigma[inner] / own[inner]
    assert wider == pytest.approx(wider[0])
    assert 1.0 <= wider[0] < 1.2


def test_errors_of_advances_are_as_large_as_advances_scatter_where_noise_lasts() -> None:
    """Of noise of which the next frame keeps four fifths, a step of a cubic tells too small an error."""
    noise = np.random.default_rng(4).normal(size=(len(LONG), 3))
    for k in range(1, len(LONG)):
        noise[k] += 0.8 * noise[k - 1]
    course = np.column_stack([2 * LONG, 0.5 * LONG, 0 * LONG]) + 0.005 * noise
    found, sigma, _ = advances(np.arange(len(LONG)), course, 18)
    assert np.nanmedian(np.abs(found / sigma)) == pytest.approx(0.6745, rel=1e-3)


def test_lost_frames_are_found_where_they_are_and_in_their_number() -> None:
    found = lost_frames(losing({120: 1, 200: 2, 300: 1}))
    assert [(loss.time_s, loss.frames) for loss in found] == [(2.0, 1), (pytest.approx(200 / RATE), 2), (5.0, 1)]
    assert [loss.missing_s for loss in found] == pytest.approx([1 / RATE, 2 / RATE, 1 / RATE])


@pytest.mark.parametrize("seed", range(6))
def test_a_recording_without_losses_has_none(seed: int) -> None:
    assert lost_frames(losing({}, seed), sigmas=4.0) == []


@pytest.mark.parametrize(("aside_mm", "within_s"), [(1.0, 0.04), (1.0, 0.06), (2.0, 0.1), (4.0, 0.06)])
def test_a_robot_that_is_pushed_aside_loses_no_frames(aside_mm: float, within_s: float) -> None:
    run = losing({}, seed=1)
    aside = aside_mm * (1 + np.tanh((LONG - 3.0) / within_s)) / 2
    assert lost_frames(replace(run, marks_mm=run.marks_mm + np.outer(aside, [0, 1, 0, 1]))) == []


@pytest.mark.parametrize("mark", [0, 1])
def test_one_mark_alone_that_is_ahead_is_no_lost_frame(mark: int) -> None:
    """As where a spline through its noise fills a gap; both were ahead by one frame in the mean."""
    run, part = losing({200: 2}), slice(2 - 2 * mark, 4 - 2 * mark)
    marks = run.marks_mm.copy()
    marks[:, part] = losing({}).marks_mm[:, part]
    assert lost_frames(run) != []
    assert lost_frames(replace(run, marks_mm=marks)) == []


def test_neither_driver_stamps_nor_poses_nor_a_robot_that_slips_back_lose_frames() -> None:
    run = losing({200: 2})
    assert lost_frames(run) != []
    assert lost_frames(replace(run, from_poses=True)) == []
    jitter = np.random.default_rng(1).uniform(-0.2, 0.2, len(LONG)) / RATE
    assert lost_frames(replace(run, time_s=LONG + jitter)) == []
    assert (
        lost_frames(replace(run, time_s=LONG + (np.arange(len(LONG)) >= 200) * 2 / RATE)) == []
    )  # stamps show the gap
    assert lost_frames(losing({200: 2, 300: -2})) == []
    assert lost_frames(losing({10: 2})) == []  # motors start there
    assert lost_frames(losing({200: 2}, speed=0.55, noise_mm=0.001)) == []  # as little as an error of tracking


def test_an_advance_is_measured_in_frames_with_its_error() -> None:
    run = losing({200: 1})
    course = np.column_stack([run.marks_mm[:, :2], np.zeros(len(LONG))])
    found, sigma, speed = advances(np.arange(len(LONG)), course, 18)
    np.testing.assert_allclose(speed[30:-30], 1.2 / RATE, rtol=0.1)  # 2 mm beside a turn of 0.4 rad/s
    assert abs(found[200] - 1) < 3 * sigma[200]
    elsewhere = np.r_[30:170, 230:390]
    score = found[elsewhere] / sigma[elsewhere]
    assert float(np.std(score)) == pytest.approx(1.0, abs=0.35)
    assert np.isnan(found[[0, 7, -7, -1]]).all()


@pytest.mark.parametrize(("digits", "counts"), [(6, True), (3, True), (2, False)])
def test_times_count_frames_if_their_digits_show_it(digits: int, counts: bool) -> None:
    numbers, frame_s = frame_numbers(np.delete(LONG, [50, 51, 200]).round(digits))
    assert bool(len(numbers)) == counts
    if counts:
        assert frame_s == pytest.approx(1 / RATE, rel=1e-4)
        np.testing.assert_array_equal(numbers, np.delete(np.arange(len(LONG)), [50, 51, 200]))


def test_a_run_is_named_alone_and_three_together() -> None:
    runs = [losing({100 + 50 * k: 1}, k, name=f"r{k}") for k in range(3)] + [losing({}, 7, name="good")]
    one = runs_with_lost_frames(runs[2:], ())
    assert [(item.run, item.kind, item.group) for item in one] == [("r2", "wrong-rate", ())]
    assert one[0].seen.startswith("frames are missing (1 at 3.33 s), but the times count on")
    assert (one[0].seen.endswith("or it was pushed along its path there"), one[0].equivalent) == (True, ("pushed",))
    assert "the original video" in one[0].remedy
    (filmed,) = runs_with_lost_frames([replace(run, filmed=True) for run in runs[2:]], ())
    assert filmed.remedy.startswith("look at the video there")
    (twice,) = runs_with_lost_frames([losing({100: 1, 200: 1})], ())
    assert ("pushed" in twice.seen, twice.equivalent) == (False, ())  # nobody pushes a robot by a frame twice
    three = runs_with_lost_frames(runs, ())
    assert [item.group for item in three] == [("r0", "r1", "r2")] * 3
    assert "(of r0 1 at 1.67 s)" in three[0].seen
    assert {("pushed" in item.seen, item.equivalent) for item in three} == {(False, ())}
    assert runs_with_lost_frames(runs[3:], ()) == []


def test_in_a_session_that_lost_frames_weaker_signs_count() -> None:
    clear, weak = losing({200: 3}, name="clear"), losing({200: 1}, seed=3, speed=1.3, noise_mm=0.012, name="weak")
    assert not lost_frames(weak)
    assert [item.run for item in runs_with_lost_frames([clear, weak], ())] == ["clear", "weak"]
    assert runs_with_lost_frames([weak], ()) == []


def test_corrected_times_are_those_of_the_recording() -> None:
    run = losing({120: 1, 300: 2})
    (found,) = runs_with_lost_frames([run], ())
    assert found.correction is not None
    table = pd.DataFrame({"time_s": run.time_s, "a_x_mm": 1.0, "a_y_mm": 2.0, "b_x_mm": 3.0, "b_y_mm": 4.0})
    mended: Floats = mended_marks(table, found.correction, ("a", "b"))["time_s"].to_numpy()
    true = LONG + (np.arange(len(LONG)) >= 120) / RATE + 2 * (np.arange(len(LONG)) >= 300) / RATE
    np.testing.assert_allclose(mended, true, atol=1e-4)
    assert not lost_frames(replace(run, time_s=mended))
