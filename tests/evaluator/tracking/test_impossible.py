from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from evaluator.tracking.following.background import background, strangers
from evaluator.tracking.following.jumps import astray_note, off_course
from evaluator.tracking.observation import OFF_COURSE, OK

TIMES = np.arange(120) / 30.0
RADIUS = 6.0


def circle(turn: float = 70.0, step: float = 0.05, noise: float = 0.05) -> np.ndarray:
    angle = step * np.arange(len(TIMES))
    points = np.stack([160 + turn * np.cos(angle), 120 + turn * np.sin(angle)], axis=-1)
    return points + np.random.default_rng(1).normal(0, noise, points.shape)


def test_a_smooth_track_loses_nothing() -> None:
    assert not off_course(TIMES, circle(), RADIUS).any()
    assert not off_course(TIMES, circle(step=0.0), RADIUS).any()


@pytest.mark.parametrize("frames", [2, 6, 12])
def test_what_stands_and_then_catches_up_is_off_its_course(frames: int) -> None:
    points = circle()
    points[41 : 41 + frames] = points[40]
    assert np.flatnonzero(off_course(TIMES, points, RADIUS)).tolist() == list(range(41, 41 + frames))


def test_a_spot_that_a_track_jumps_to_and_back_from_is_off_its_course() -> None:
    points, spots = circle(), [20, 21, 50, 51, 52, 90]
    points[spots] = [230.0, 30.0]
    assert np.flatnonzero(off_course(TIMES, points, RADIUS)).tolist() == spots


def test_a_robot_that_starts_stops_or_is_pushed_loses_nothing() -> None:
    lapse = np.concatenate([np.zeros(30), np.arange(30), np.full(30, 29), 29 + 4 * np.arange(30)])
    points = np.stack([20 + 2.0 * lapse, np.full(120, 50.0)], axis=-1)
    points += np.random.default_rng(1).normal(0, 0.05, points.shape)
    assert not off_course(TIMES, points, RADIUS).any()


def test_a_robot_that_was_carried_elsewhere_is_followed_there() -> None:
    points = circle()
    points[60:] += [90.0, 40.0]
    assert not off_course(TIMES, points, RADIUS).any()


def test_a_spot_where_something_is_found_while_the_mark_is_out_of_view_is_off_its_course() -> None:
    points = circle()
    points[:50], points[62:] = [230.0, 30.0], [230.0, 30.0]
    wrong = off_course(TIMES, points, RADIUS)
    assert wrong[:50].all()
    assert wrong[62:].all()
    assert not wrong[50:62].any()


def test_a_thing_at_rest_that_is_put_elsewhere_rests_there() -> None:
    points = np.full((120, 2), [40.0, 60.0]) + np.random.default_rng(1).normal(0, 0.05, (120, 2))
    points[60:] += 90.0
    points[20] += 30.0
    assert np.flatnonzero(off_course(TIMES, points, RADIUS)).tolist() == [20]


def test_a_gap_in_the_recording_is_no_jump() -> None:
    times = TIMES.copy()
    times[60:] += 0.5
    angle = 0.05 * 30 * times
    points = np.stack([160 + 70 * np.cos(angle), 120 + 70 * np.sin(angle)], axis=-1)
    assert not off_course(times, points, RADIUS).any()


def test_what_rests_while_the_other_mark_drives_is_background() -> None:
    rest = np.full((120, 2), [40.0, 60.0])
    assert background(rest, circle(), RADIUS).all()
    assert not background(circle(), rest, RADIUS).any()


def test_a_robot_that_turns_about_its_mark_or_rests_has_both() -> None:
    pivot = np.full((120, 2), [160.0, 120.0])
    assert not background(pivot, circle(44.0), RADIUS).any()
    assert not background(pivot, pivot + 44.0, RADIUS).any()


def test_a_thing_at_rest_without_a_partner_is_no_mark_of_a_robot() -> None:
    rest = np.full((120, 2), [40.0, 60.0])
    assert background(rest, np.full((120, 2), np.nan), RADIUS).all()
    assert not background(circle(), np.full((120, 2), np.nan), RADIUS).any()


def test_a_robot_that_rests_before_it_drives_keeps_its_marks() -> None:
    angle = 0.05 * np.maximum(np.arange(120) - 60, 0)
    one = np.stack([160 + 70 * np.cos(angle), 120 + 70 * np.sin(angle)], axis=-1)
    other = np.stack([160 + 30 * np.cos(angle), 120 + 30 * np.sin(angle)], axis=-1)
    assert not background(one, other, RADIUS).any()
    assert not background(other, one, RADIUS).any()


def test_two_things_that_move_on_their_own_are_no_pair() -> None:
    toward = np.stack([300 - 2.0 * np.arange(120), np.full(120, 50.0)], axis=-1)
    assert strangers(toward, circle(), RADIUS)
    angle = 0.05 * np.arange(120)
    slanted = circle() + 40 * np.stack([np.cos(angle), 0.5 * np.sin(angle)], axis=-1)  # seen at 60 degrees
    assert not strangers(circle(), slanted, RADIUS)


def test_two_marks_that_mostly_rest_are_on_one_body_though_their_noise_is_not() -> None:
    rng = np.random.default_rng(8)
    way = np.concatenate([np.zeros(200), np.linspace(0, 150, 40), np.full(260, 150.0)])
    one = np.column_stack([way, 0 * way])
    noisy = [places + rng.normal(0, 0.05, places.shape) for places in (one, one + np.array([11.0, 11.0]))]
    assert not strangers(noisy[0], noisy[1], 6.0)
    elsewhere = np.column_stack([-way, 300 + 0 * way]) + rng.normal(0, 3.0, one.shape)
    assert strangers(noisy[0], elsewhere, 6.0)


@pytest.mark.parametrize(("off", "said"), [(0, False), (12, False), (13, True)])
def test_a_mark_that_is_off_its_course_in_a_tenth_of_the_frames_is_told(off: int, said: bool) -> None:
    status = {"green_status": [OFF_COURSE] * off + [OK] * (120 - off), "yellow_status": [OK] * 120}
    note = astray_note(pd.DataFrame({"frame": range(120), **status}))
    assert note.startswith(f"off its course: green in {off} of 120 frames; what is tracked") is said
    assert bool(note) is said
    assert "yellow" not in note
