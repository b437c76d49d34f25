"""Every number from which on a run is called a mistake, from either side; runs in closed form, without a simulator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evaluator.diagnosis.mistakes.disturbances import disturbed_runs, wrong_scale
from evaluator.diagnosis.mistakes.misread.alternatives import Alternative
from evaluator.diagnosis.mistakes.misread.belief import without_regimes
from evaluator.diagnosis.mistakes.misread.judgement import Judgement
from evaluator.diagnosis.mistakes.recognise import recognise
from evaluator.diagnosis.mistakes.recognised import Found, mistakes_of
from evaluator.diagnosis.mistakes.session.copies import contradicting_copies, copies
from evaluator.diagnosis.mistakes.start.late_start import late_starts
from tests.evaluator.diagnosis.straight_session import ROBOT, driven, kinds, session


@pytest.mark.parametrize(
    ("scatter", "ratio", "kind"),
    [
        (0.0, 1.025, None),
        (0.0, 1.03, "wrong-robot"),
        (0.0, 0.975, None),
        (0.0, 0.97, "wrong-robot"),
        (0.0, 2.9, "wrong-robot"),
        (0.01, 1.055, None),  # the median deviation from the median is 0.01: a standard deviation of 0.0148
        (0.02, 1.07, None),
        (0.02, 1.12, "wrong-robot"),
        (0.02, 0.93, None),
        (0.02, 0.88, "wrong-robot"),
    ],
)
def test_marks_of_one_run_may_be_off_by_a_twelfth_or_a_fortieth_where_those_of_the_others_are_the_same(
    scatter: float, ratio: float, kind: str | None
) -> None:
    """A robot whose marks are 7 % nearer was taken for a wrong command."""
    others = [driven(number, scale=1.0 + scatter * (-1) ** number) for number in (1, 2, 3, 5, 6, 7, 8)]
    found = wrong_scale([*others, driven(4, scale=ratio)], [ROBOT] * 8)
    assert kinds(found) == ([("r4", kind)] if kind else [])


def test_marks_at_the_edge_of_the_plate_may_be_off_by_a_twelfth() -> None:
    """A lens that is not calibrated errs there, wherever on the plate its origin is."""
    for others, place, told in ((0, 4, True), (0, 30, False), (50, 54, True), (50, 80, False), (50, 20, False)):
        runs = [*(driven(others + number) for number in (1, 2, 3, 5, 6, 7, 8)), driven(place, scale=1.05)]
        assert bool(wrong_scale(runs, [ROBOT] * 8)) == told


@pytest.mark.parametrize(("ratio", "wrong"), [(1.19, False), (1.22, True), (0.85, False), (0.82, True)])
def test_marks_of_all_runs_may_be_off_by_a_fifth(ratio: float, wrong: bool) -> None:
    found = wrong_scale([driven(number, scale=ratio) for number in range(8)], [ROBOT] * 8)
    assert (len(found) > 0) == wrong


@pytest.mark.parametrize(("ratio", "kind"), [(1.15, None), (1.17, "wrong-robot"), (1.0, "wrong-robot")])
def test_a_run_is_held_against_where_all_runs_see_the_marks(ratio: float, kind: str | None) -> None:
    found = wrong_scale([driven(number, scale=ratio if number == 3 else 1.13) for number in range(8)], [ROBOT] * 8)
    assert kinds(found) == ([("r3", kind)] if kind else [])


def test_where_most_runs_are_beyond_a_fifth_the_robot_file_is_right() -> None:
    found = wrong_scale([driven(number, scale=1.0 if number == 3 else 1.25) for number in range(8)], [ROBOT] * 8)
    assert kinds(found) == [(f"r{number}", "wrong-robot") for number in range(8) if number != 3]


@pytest.mark.parametrize(("unit", "factor"), [("m", 1e-3), ("cm", 0.1), ("inch", 1 / 25.4), ("µm", 1e3)])
def test_unit_is_recognised_within_a_seventeenth(unit: str, factor: float) -> None:
    for off, kind in ((1.05, "wrong-unit"), (0.95, "wrong-unit"), (0.92, "wrong-robot")):
        (found,) = wrong_scale(session(driven(0, scale=off * factor)), [ROBOT] * 8)
        expected = "wrong-unit" if unit == "µm" else kind  # beyond three times too far apart it is px, at the least
        assert (found.kind, f"in {unit}:" in found.remedy) == (expected, kind == "wrong-unit")
        if kind == "wrong-unit":
            assert found.remedy == f"they seem to be in {unit}: convert them to mm"
            assert found.correction is not None
            assert found.correction.marks_times == pytest.approx((1 / factor, 1 / factor))


def test_marks_more_than_three_times_too_far_apart_are_in_px() -> None:
    (found,) = wrong_scale(session(driven(0, scale=3.1)), [ROBOT] * 8)
    assert (found.kind, found.correction) == ("wrong-unit", None)
    assert found.remedy == "they seem to be in px: place them with a camera"


@pytest.mark.parametrize(("speed", "stuck"), [(0.0, []), (1.5, ["r0"])])
def test_a_command_at_which_all_runs_stand_in_any_direction_and_side_is_nobodys_mistake(
    speed: float, stuck: list[str]
) -> None:
    """A wheel at 5 rpm stands in a dead band and holds the robot, though both wheels at 10 rpm move it."""
    held = replace(driven(0, speed=0.0), left_rpm=-5.0, right_rpm=-33.3)
    mirrored = replace(driven(1, speed=speed), left_rpm=33.3, right_rpm=5.0)
    slow = [replace(driven(number), left_rpm=10.0, right_rpm=10.0) for number in range(2, 6)]
    found = disturbed_runs([held, mirrored, *slow], [ROBOT] * 6)
    assert [item.run for item in found if item.kind == "stuck"] == stuck


@pytest.mark.parametrize(("seconds", "share", "stuck"), [(0.6, 0.0, True), (0.2, 0.0, False), (0.6, 0.5, False)])
def test_a_run_is_held_that_stops_for_a_quarter_of_a_second(seconds: float, share: float, stuck: bool) -> None:
    time = np.arange(180) / 60
    speed = np.where((time > 1.5) & (time < 1.5 + seconds), 1.5 * share, 1.5)
    assert (("r0", "stuck") in kinds(disturbed_runs([driven(0, speed=speed)], [ROBOT]))) == stuck


@pytest.mark.parametrize("usual", [-1.5, 0.6])
def test_a_slow_run_and_one_backward_are_held_too(usual: float) -> None:
    time = np.arange(180) / 60
    run = driven(0, speed=np.where((time > 1.5) & (time < 2.1), 0.0, usual))
    assert kinds(disturbed_runs([run], [ROBOT])) == [("r0", "stuck")]


def test_a_run_that_stops_early_for_good_is_stuck_though_it_stands_for_most_of_its_time() -> None:
    time = np.arange(180) / 60
    found = disturbed_runs([driven(0, speed=np.where(time > 1.7, 0.0, 1.5))], [ROBOT])
    assert kinds(found) == [("r0", "stuck")]
    assert "stands still from 1.8" in found[0].seen


def test_a_held_run_is_told_from_when_to_when_it_stands() -> None:
    time = np.arange(180) / 60
    (found,) = disturbed_runs([driven(0, speed=np.where((time > 1.5) & (time < 2.1), 0.0, 1.5))], [ROBOT])
    begin, end = found.seen.removeprefix("stands still from ").removesuffix(" s with its motors on").split(" to ")
    assert (float(begin), float(end)) == pytest.approx((1.55, 2.05), abs=0.08)  # windows of 0.15 s that stand


@pytest.mark.parametrize(("share", "pushed"), [(1.4, False), (1.8, True)])
def test_a_run_is_pushed_that_is_faster_by_more_than_half_for_a_moment(share: float, pushed: bool) -> None:
    time = np.arange(180) / 60
    speed = np.where((time > 1.5) & (time < 2.1), 1.5 * share, 1.5)
    assert (("r0", "pushed") in kinds(disturbed_runs([driven(0, speed=speed)], [ROBOT]))) == pushed


@pytest.mark.parametrize(("size_mm", "moved"), [(0.5, True), (0.015, False)])
def test_a_camera_has_moved_where_both_marks_jump(size_mm: float, moved: bool) -> None:
    run = driven(0)
    marks = run.marks_mm.copy()
    marks[120:] += size_mm
    found = disturbed_runs([replace(run, marks_mm=marks)], [ROBOT])
    assert (("r0", "camera-moved") in kinds(found)) == moved
    if moved:
        assert f"both marks jump by {np.sqrt(2) * size_mm:.2f} mm at 1.99 s" in found[0].seen


@pytest.mark.parametrize(("concerned", "together"), [(8, True), (7, False)])
def test_what_concerns_four_fifths_of_the_runs_is_said_once(concerned: int, together: bool) -> None:
    found = [Found(f"r{number}", "mirrored", "moves so", "mirror it") for number in range(concerned)]
    mistakes = mistakes_of(found, 10)
    assert len(mistakes) == (1 if together else concerned)
    assert mistakes[0].everywhere == together
    assert mistakes_of(found[:2], 2)[0].runs == ("r0",)


def test_of_two_mistakes_of_a_run_the_one_is_told_that_hides_the_other() -> None:
    both = [Found("r0", "reversed", "b", "b"), Found("r0", "wrong-unit", "a", "a")]
    assert [item.kind for item in mistakes_of(both, 5)] == ["wrong-unit"]
    assert mistakes_of(both, 5)[0].sentence == "r0: a; a"


@pytest.mark.parametrize(
    ("from_s", "until_s", "kind"), [(1.8, 2.3, "pushed"), (1.8, 4.0, "wrong-command"), (0.4, 1.5, None)]
)
def test_push_interrupts_usual_motion(from_s: float, until_s: float, kind: str | None) -> None:
    """What lasts is another command, and backlash of a gear shows at the start."""
    run = driven()
    speed = np.where((run.time_s > from_s) & (run.time_s < until_s), 3.0, 1.5)
    found = disturbed_runs(session(driven(speed=speed)), [ROBOT] * 8)
    assert kinds(found) == ([("r0", kind)] if kind else [])


def test_a_start_that_is_late_by_most_of_a_second_is_no_hold() -> None:
    data = session(driven(0, begins_s=1.5))
    assert kinds(disturbed_runs(data, [ROBOT] * 8)) == []
    assert kinds(late_starts(data, [ROBOT] * 8)) == [("r0", "late-start")]


@pytest.mark.parametrize(("share", "kind"), [(0.25, "wrong-command"), (0.1, "stuck")])
def test_robot_that_creeps_does_not_stand(share: float, kind: str | None) -> None:
    run = driven()
    found = disturbed_runs(session(driven(speed=np.where(run.time_s > 2.0, 1.5 * share, 1.5))), [ROBOT] * 8)
    assert kinds(found) == ([("r0", kind)] if kind else [])


@pytest.mark.parametrize(("over_s", "others"), [(0.1, ("camera-moved",)), (0.35, ())])
def test_displacement_along_the_path_may_be_of_the_camera_if_it_is_sudden(
    over_s: float, others: tuple[str, ...]
) -> None:
    run = driven()
    off = 0.6 * np.clip((run.time_s - 1.5) / over_s, 0, 1)
    (found,) = disturbed_runs(session(replace(run, marks_mm=run.marks_mm + off[:, None] * [1, 0, 1, 0])), [ROBOT] * 8)
    assert (found.kind, found.equivalent) == ("pushed", others)


def test_tracking_errors_at_both_ends_of_a_gap_are_no_push() -> None:
    run = driven()
    off = np.where((run.time_s > 1.4) & (run.time_s < 1.5), 1.0, 0.0) - np.where(
        (run.time_s > 2.0) & (run.time_s < 2.1), 1.0, 0.0
    )
    marks = run.marks_mm + np.clip(off, -1, 1)[:, None] * [0.0, 0.25, 0.0, 0.25]
    marks[(run.time_s > 1.5) & (run.time_s < 2.0)] = np.nan
    assert kinds(disturbed_runs(session(replace(run, marks_mm=marks)), [ROBOT] * 8)) == []


@pytest.mark.parametrize(("pushed_mm", "kind"), [(0.6, "pushed"), (0.05, None)])
def test_push_of_a_fifth_of_a_second_is_seen_by_how_far_it_carries(pushed_mm: float, kind: str | None) -> None:
    run = driven()
    off = pushed_mm * np.clip((run.time_s - 1.5) / 0.2, 0, 1)
    pushed = replace(run, marks_mm=run.marks_mm + off[:, None] * [0.0, 1.0, 0.0, 1.0])
    assert kinds(disturbed_runs(session(pushed), [ROBOT] * 8)) == ([("r0", kind)] if kind else [])


def test_turn_by_hand_is_a_push_though_the_robot_is_where_it_was() -> None:
    run = driven()
    angle = np.radians(12) * np.clip((run.time_s - 1.5) / 0.3, 0, 1)
    turn = np.exp(1j * angle)[:, None]
    places = run.marks_mm[:, ::2] + 1j * run.marks_mm[:, 1::2]
    middle = places.mean(axis=1, keepdims=True)
    turned = middle + turn * (places - middle)
    way = np.concatenate([[0], np.cumsum(np.diff(middle[:, 0]) * turn[:-1, 0])])[:, None]  # on along the new heading
    turned += middle[:1] + way - middle
    marks = np.stack([turned.real, turned.imag], axis=2).reshape(-1, 4)
    assert kinds(disturbed_runs(session(replace(run, marks_mm=marks)), [ROBOT] * 8)) == [("r0", "pushed")]


def test_marks_mistaken_in_a_few_frames_are_no_push() -> None:
    run = driven()
    marks = run.marks_mm.copy()
    marks[[80, 81, 83]] += [0.0, 0.9, 0.0, 0.9]
    assert disturbed_runs(session(replace(run, marks_mm=marks)), [ROBOT] * 8) == []


def test_copy_of_a_run_counts_once_whatever_its_clock() -> None:
    original = driven(3)
    copied = replace(original, id="r9", time_s=original.time_s + 7.0, start_s=7.5)
    (found,) = copies([*session(driven()), copied])
    assert (found.run, found.kind) == ("r9", "duplicate")
    assert "same marks as r3" in found.seen
    assert copies([*session(driven()), replace(copied, left_rpm=20.0)]) == []  # the simulation tells which is wrong
    assert copies(session(driven())) == []


def test_same_marks_under_two_commands_are_doubtful_unless_they_contradict_one_of_them() -> None:
    original = driven(3)
    other = replace(original, id="r9", left_rpm=original.left_rpm + 5.0)
    data = [*session(driven()), other]
    found = contradicting_copies(data, [])
    assert [(item.run, item.kind, item.group) for item in found] == [
        ("r3", "duplicate", ("r3", "r9")),
        ("r9", "duplicate", ("r3", "r9")),
    ]
    (copy,) = contradicting_copies(data, [Found("r9", "wrong-command", "", "")])
    assert (copy.run, copy.kind, copy.equivalent, copy.group) == ("r9", "duplicate", ("wrong-command",), ())
    assert copy.seen.startswith("has the same marks as r3, frame for frame, but another command")
    assert contradicting_copies(data, [Found(run, "wrong-command", "", "") for run in ("r3", "r9")]) == []
    thrice = [*data, replace(original, id="r10")]
    assert [item.run for item in contradicting_copies(thrice, copies(thrice))] == ["r3", "r9"]
    (told,) = [item for item in recognise(data, [ROBOT] * len(data)) if "r9" in item.runs]
    assert told.runs == ("r3", "r9")
    assert told.sentence.startswith("r3, r9: have the same marks, frame for frame, but different commands; find out")


def test_mistake_of_all_runs_that_could_show_it_is_said_once() -> None:
    swapped = [Found(f"r{k}", "sides-swapped", "turns", "exchange") for k in range(5)]
    (mistake,) = mistakes_of(swapped, 9, {"sides-swapped": 5})
    assert mistake.everywhere
    assert mistake.sentence.startswith("5 of 9 runs, all that could show it, r0 for example: turns")
    assert len(mistakes_of(swapped, 9)) == 5


@pytest.mark.parametrize(("stop_s", "seen"), [(1.6, "1.65 to 2.85"), (1.4, "1.42 to 2.85")])
def test_stop_for_good_is_a_stop_to_the_end_of_the_recording(stop_s: float, seen: str) -> None:
    run = driven()
    speed = np.where(run.time_s < stop_s, 1.5, 0.0)  # after a second: it stands longer than it drives
    (found,) = disturbed_runs(session(driven(speed=speed)), [ROBOT] * 8)
    assert (found.kind, found.seen) == ("stuck", f"stands still from {seen} s with its motors on")


def test_commands_that_all_runs_of_a_speed_seem_to_have_mixed_up_are_physics() -> None:
    def misread(*runs: int) -> list[Found]:
        return [Found(f"r{k}", "wrong-command", "moves as if", "look up") for k in runs]

    speeds = [((5.0, 33.0),), ((5.0, 33.0),), ((14.0, 33.0),), ((14.0, 33.0),), ((36.0, 60.0),)]
    seen = [Judgement([Alternative(None, driven(k))], np.array([1.0]), 10.0, pairs) for k, pairs in enumerate(speeds)]
    assert without_regimes(misread(0, 1, 2), seen) == misread(2)  # r3 turns as r2 should
    assert without_regimes(misread(4), seen) == misread(4)  # nothing to compare it with
    to_the_left = [replace(driven(k), left_rpm=side * 5.0, right_rpm=side * 33.0) for k, side in enumerate((1, -1))]
    to_the_right = [replace(driven(k), left_rpm=side * 33.0, right_rpm=side * 5.0) for k, side in enumerate((1, -1), 2)]
    turns = [
        Judgement([Alternative(None, run)], np.array([1.0]), 10.0, speeds[0]) for run in to_the_left + to_the_right
    ]
    assert without_regimes(misread(0, 1, 2), turns) == misread(2)  # the right wheel is driven fast in both
    ratios = [((10.5, 70.0),), ((15.0, 100.0),), ((15.0, 100.0),), ((30.0, 30.0),), ((40.0, 40.0),)]
    seen = [Judgement([Alternative(None, driven(k))], np.array([1.0]), 10.0, pairs) for k, pairs in enumerate(ratios)]
    assert without_regimes(misread(0, 1, 2), seen) == []  # turns on the spot, of which none fits
    assert without_regimes(misread(0, 1), seen) == misread(0, 1)  # another one fits
    assert without_regimes(misread(3, 4), seen) == misread(3, 4)  # straight runs have no ratio of their own
    swapped = Found("r0", "sides-swapped", "turns", "exchange")
    assert without_regimes([swapped, *misread(1)], seen) == [swapped, *misread(1)]
