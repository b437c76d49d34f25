"""Frames in which a hand moves the robot are no part of its run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from evaluator.diagnosis import experiment
from evaluator.diagnosis.experiment import session_of
from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.start.handling import between_hands, moved_before_start_mm
from evaluator.diagnosis.mistakes.start.late_start import late_starts
from evaluator.errors import InputError
from evaluator.settings import load_experiment
from simulator.robot import load_robot

START_S, STOP_S = 1.0, 2.0


def filmed(
    *, laid_down_s: float = 0.0, taken_away_s: float = 9.0, hand_mm_s: float = 8.0, begins_s: float = START_S
) -> RunData:
    """A run straight ahead at 4 mm/s, with a hand before and after."""
    time = np.arange(0, 4, 1 / 60)
    way = 4.0 * np.clip(time - begins_s, 0.0, STOP_S - begins_s)
    by_hand = hand_mm_s * (np.clip(laid_down_s - time, 0, None) + np.clip(time - taken_away_s, 0, None))
    marks = np.stack([way + by_hand, 1.83 + by_hand, way + by_hand, by_hand - 1.83], axis=1)
    marks += np.random.default_rng(0).normal(0.0, 0.003, marks.shape)
    return RunData("r", 10, 10, START_S, STOP_S, time, marks, 0)


def kept_s(run: RunData) -> tuple[float, float]:
    own = between_hands(run)
    return float(run.time_s[own.start]), float(run.time_s[own.stop - 1])


def test_run_begins_where_the_robot_rests_after_it_was_laid_down() -> None:
    assert kept_s(filmed(laid_down_s=0.5)) == pytest.approx((0.6, 3.98), abs=0.04)


@pytest.mark.parametrize("laid_down_s", [0.84, 0.87, 0.9])
def test_a_rest_of_a_tenth_of_a_second_until_the_start_is_enough(laid_down_s: float) -> None:
    """A robot laid down 0.15 s before its start counted as one that started then."""
    run = filmed(laid_down_s=laid_down_s)
    assert kept_s(run)[0] == pytest.approx(0.9, abs=0.02)
    own = between_hands(run)
    assert not late_starts([replace(run, marks_mm=run.marks_mm[own], time_s=run.time_s[own])], [])


@pytest.mark.parametrize("hand_mm_s", [0.3, 1.0])
def test_a_slow_nudge_before_the_start_is_no_place_where_it_starts(hand_mm_s: float) -> None:
    """By 0.08 to 0.25 mm within a quarter of a second: frames before it were averaged into the start of the run."""
    run, nudged = filmed(), filmed(laid_down_s=0.5, hand_mm_s=hand_mm_s)
    marks = np.where(run.time_s[:, None] < 0.25, nudged.marks_mm[15], nudged.marks_mm)
    assert kept_s(replace(run, marks_mm=marks))[0] == pytest.approx(0.6, abs=0.1)


@pytest.mark.parametrize("last_s", [0.88, 0.9, 0.94])
def test_first_frames_after_a_sudden_rest_may_count_as_wrong_marks(last_s: float) -> None:
    """A hand twists the robot and stops at once, and a jumpy tracker: 7 of 18 runs were late starts."""
    run = filmed(laid_down_s=0.78, hand_mm_s=20.0)
    marks = run.marks_mm.copy()
    marks[(run.time_s > 0.76) & (run.time_s < last_s)] = np.nan
    assert kept_s(replace(run, marks_mm=marks))[0] == pytest.approx(0.8, abs=0.02)
    assert not late_starts([replace(run, marks_mm=marks[(own := between_hands(run))], time_s=run.time_s[own])], [])


def test_a_wrong_mark_is_no_motion_before_the_start() -> None:
    run = filmed(laid_down_s=0.5)
    marks = run.marks_mm.copy()
    marks[int(0.85 * 60)] += 0.4
    assert kept_s(replace(run, marks_mm=marks))[0] == pytest.approx(0.6, abs=0.04)


def test_run_ends_where_the_robot_is_taken_away() -> None:
    assert kept_s(filmed(taken_away_s=3.0)) == pytest.approx((0.0, 3.0), abs=0.04)


@pytest.mark.parametrize("taken_away_s", [2.05, 2.3])
def test_run_ends_where_the_robot_is_taken_away_without_a_rest(taken_away_s: float) -> None:
    """With stop_s a tenth of a second before the hand, a session without fault was "unknown" physics."""
    end_s = kept_s(filmed(taken_away_s=taken_away_s, hand_mm_s=25.0))[1]
    assert taken_away_s - 0.15 < end_s < taken_away_s + 0.02


@pytest.mark.parametrize(("nudged_s", "begins_s"), [(0.5, 0.6), (0.8, 0.8), (0.95, 0.0), (1.5, 0.0)])
def test_run_begins_after_a_nudge_that_is_surely_before_its_start(nudged_s: float, begins_s: float) -> None:
    """By 0.15 mm, from one frame to the next; later ones are left to those who look for disturbances."""
    run = filmed()
    nudged = replace(run, marks_mm=run.marks_mm + 0.15 * (run.time_s > nudged_s)[:, None] * [0.6, 0.8, 0.6, 0.8])
    assert kept_s(nudged)[0] == pytest.approx(begins_s, abs=0.02)


@pytest.mark.parametrize(("unseen_s", "begins_s"), [((0.5, 0.75), 0.63), ((0.5, 0.98), 0.74), ((0.62, 1.12), 0.0)])
def test_run_begins_after_a_nudge_however_long_the_marks_are_not_seen(
    unseen_s: tuple[float, float], begins_s: float
) -> None:
    """Nine frames around a nudge were rejected as outliers, and half a millimetre before it was unknown physics.

    Where the marks are seen again only when the robot moves, the way may be its own.
    """
    run = filmed()
    marks = run.marks_mm + 0.3 * (run.time_s > 0.7)[:, None] * [0.6, 0.8, 0.6, 0.8]
    marks[(run.time_s > unseen_s[0]) & (run.time_s < unseen_s[1])] = np.nan
    assert kept_s(replace(run, marks_mm=marks))[0] == pytest.approx(begins_s, abs=0.02)


@pytest.mark.parametrize(
    "run",
    [
        filmed(),
        filmed(begins_s=0.5),  # motors on before the file says so: for late_starts
        filmed(laid_down_s=0.95),  # no rest before the motors tells hand and motors apart
        filmed(taken_away_s=3.5, hand_mm_s=0.5),  # a quarter of a millimetre after the stop: no hand
    ],
)
def test_all_frames_count_where_no_hand_is_seen(run: RunData) -> None:
    assert between_hands(run) == slice(0, len(run.time_s))


def test_frames_of_its_own_are_those_with_marks_and_enough() -> None:
    run = filmed(laid_down_s=0.5)
    run.marks_mm[30:40] = np.nan  # and some more after it was laid down
    assert experiment._own_frames(run, 12) == slice(40, len(run.time_s))
    with pytest.raises(InputError, match=r"200 frames in which no hand moves the robot; at least 201 are needed"):
        experiment._own_frames(run, 201)


@pytest.mark.parametrize("run", [filmed(laid_down_s=0.95), filmed(begins_s=-0.5)])
def test_run_that_moves_before_its_start_is_said_to(run: RunData) -> None:
    (found,) = late_starts([run], [load_robot("barrel")])
    assert (found.kind, found.equivalent) == ("late-start", ("pushed",))
    assert found.seen.endswith("mm before its motors are switched on at start_s = 1 s")


def cut(run: RunData, at_s: float) -> RunData:
    """The run without the frames before a time."""
    kept = run.time_s >= at_s
    return replace(run, time_s=run.time_s[kept], marks_mm=run.marks_mm[kept])


@pytest.mark.parametrize("at_s", [0.8, 0.85])
def test_a_film_that_is_cut_while_the_robot_drives_shows_it_in_the_frames_before_its_start(at_s: float) -> None:
    """In 0.2 s the robot gets less far than a hand would carry it; one film of eighteen was not noticed."""
    run = cut(filmed(begins_s=0.5), at_s)
    assert moved_before_start_mm(run) == pytest.approx(4.0 * (START_S - at_s), rel=0.15)
    (found,) = late_starts([run], [load_robot("barrel")])
    assert found.kind == "late-start"


@pytest.mark.parametrize(("share", "drives"), [(0.6, False), (0.8, True), (1.3, True), (2.2, False)])
def test_what_drives_before_the_start_goes_on_about_as_fast(share: float, drives: bool) -> None:
    """share: of the speed after the start. Within half of the way before it."""
    run = cut(filmed(begins_s=0.5), 0.8)
    slower = 4.0 * (share - 1) * np.minimum(run.time_s - START_S, 0.0)[:, None] * np.array([1.0, 0.0, 1.0, 0.0])
    assert (moved_before_start_mm(replace(run, marks_mm=run.marks_mm + slower)) > 0.0) == drives


def test_what_moves_another_way_than_the_run_goes_on_does_not_drive() -> None:
    run = filmed()
    settling = np.clip(1.0 - run.time_s[:, None], 0.0, None) * np.array([0.0, 0.3, 0.0, 0.3])
    assert moved_before_start_mm(cut(replace(run, marks_mm=run.marks_mm + settling), 0.8)) == 0.0
    assert moved_before_start_mm(cut(filmed(), 0.8)) == 0.0
    assert moved_before_start_mm(cut(filmed(begins_s=0.5), 0.95)) == 0.0  # three frames


@pytest.mark.parametrize("run", [filmed(), filmed(laid_down_s=0.5, hand_mm_s=0.5)])
def test_run_that_rests_before_its_start_is_not(run: RunData) -> None:
    assert moved_before_start_mm(run) == 0.0


def test_diagnosis_reads_a_run_without_hands_and_whether_its_start_is_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(experiment, "recognise", lambda *_: [])  # both runs are read from one file
    run = filmed(laid_down_s=0.5)
    table = np.column_stack([run.time_s, run.marks_mm])
    head = "time_s,green_x_mm,green_y_mm,yellow_x_mm,yellow_y_mm"
    np.savetxt(tmp_path / "r.csv", table, delimiter=",", header=head, comments="")
    text = 'format = 1\nname = "e"\nrobot = "barrel"\n'
    for name, start in (("a", f"start_s = {START_S}\n"), ("b", "")):
        text += f'[[run]]\nid = "{name}"\nleft_rpm = 76\nright_rpm = 76\n{start}marks = "r.csv"\n'
    (tmp_path / "experiment.toml").write_text(text)
    marks = dict.fromkeys("ab", tmp_path / "r.csv")
    read = session_of(load_experiment(tmp_path / "experiment.toml"), marks)
    assert [(item.id, item.start_is_stated) for item in read.data] == [("a", True), ("b", False)]
    assert read.data[0].time_s[0] == pytest.approx(0.6, abs=0.04)
