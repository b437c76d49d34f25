"""What is said of a mistake: its runs, what else they could be, and what puts their files right."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes import outlying
from evaluator.diagnosis.mistakes.misread import belief, hypotheses
from evaluator.diagnosis.mistakes.misread.alternatives import Alternative, correction_to
from evaluator.diagnosis.mistakes.misread.hypotheses import _judged, _worst_of_good, misread_runs, reading_of
from evaluator.diagnosis.mistakes.misread.judgement import Judgement
from evaluator.diagnosis.mistakes.outlying import has_similar_runs, outlying_run, turns_like_others
from evaluator.diagnosis.mistakes.recognised import Correction, Found, Kind, exchanged_commands, mistakes_of
from evaluator.diagnosis.mistakes.session.copies import copies
from evaluator.interchange.commands import RunCommand
from simulator.command import Command
from simulator.robot import load_robot
from tests.evaluator.diagnosis.marks_of_motion import TIME, moving, recorded
from tests.evaluator.diagnosis.straight_session import ROBOT, driven

HUSKY = Path(__file__).parents[2] / "driven_robot" / "husky.toml"


@pytest.mark.parametrize(
    ("kind", "changes", "expected"),
    [
        ("marks-swapped", {}, Correction(marks_exchanged=True)),
        ("mirrored", {}, Correction(marks_times=(-1.0, 1.0))),
        ("wrong-rate", {"time_s": 0.5 * TIME}, Correction(seconds_times=0.5)),
        ("reversed", {"left_rpm": -30.0, "right_rpm": -20.0}, Correction(command=(-30.0, -20.0))),
        ("sides-swapped", {"left_rpm": 20.0, "right_rpm": 30.0}, Correction(command=(20.0, 30.0))),
        ("wrong-command", {"left_rpm": 60.0}, Correction(command=(60.0, 20.0))),
        ("late-start", {}, None),
        (None, {}, None),
    ],
)
def test_what_puts_the_files_of_a_run_right(kind: Any, changes: dict[str, Any], expected: Correction | None) -> None:
    run = recorded(moving(TIME))
    assert correction_to(Alternative(kind, replace(run, **changes)), Alternative(None, run)) == expected


def test_a_run_with_a_log_is_put_right_by_a_log_and_never_by_one_command() -> None:
    run, log = recorded(moving(TIME)), RunCommand(Command.constant(30.0, 20.0, 0.5), logged=True)
    logged = Alternative(None, replace(run, log=log))
    assert correction_to(Alternative("late-start", replace(run, log=log)), logged) == Correction(log=log)
    assert correction_to(Alternative("wrong-command", run), logged) is None


def test_runs_of_a_common_mistake_are_named_in_order_with_what_each_could_be_and_what_rights_it() -> None:
    rights = [Correction(later_s=1.0), Correction(later_s=2.0), None]
    others: list[Any] = [("pushed", "mirrored"), ("pushed",), ("pushed", "stuck")]
    found = [
        Found(f"r{k}", "reversed", f"seen {k}", f"remedy {k}", other, right)
        for k, other, right in zip((2, 0, 1), others, rights, strict=True)
    ]
    (together,) = mistakes_of(found, 3)
    assert together.runs == ("r0", "r1", "r2")
    assert together.sentence == "all runs, r0 for example: seen 0; remedy 0"
    assert (together.equivalent_kinds, together.everywhere) == (("pushed",), True)
    assert together.corrections == {"r2": rights[0], "r0": rights[1]}
    single = mistakes_of(found[:1], 9)[0]
    assert (single.runs, single.equivalent_kinds, single.everywhere) == (("r2",), ("pushed", "mirrored"), False)
    assert single.corrections == {"r2": rights[0]}


def test_parts_of_a_long_recording_are_named_after_it_and_told_once() -> None:
    """One sentence of 300 characters came six times, and "r01@0.0s" is the name of nothing that a reader has."""
    found = [Found(f"r{k}@{t}s", "reversed", f"seen {t}", "turn it") for k, t in ((4, 0.0), (4, 11.9), (5, 3.5))]
    found.append(Found("r6", "reversed", "seen", "turn it"))
    told = [(item.runs, item.sentence) for item in mistakes_of(found, 30)]
    assert told == [
        (("r4@0.0s", "r4@11.9s"), "r4 (2 parts of it): seen 0.0; turn it"),
        (("r5@3.5s",), "r5 (from 3.5 s on): seen 3.5; turn it"),
        (("r6",), "r6: seen; turn it"),
    ]
    assert mistakes_of(found, 4)[0].sentence == "all runs, r4 (from 0.0 s on) for example: seen 0.0; turn it"


def test_a_judgement_says_both_misfits_and_every_reading_that_fits_as_well() -> None:
    run = driven(0)
    mirror = replace(run, marks_mm=run.marks_mm * [-1.0, 1.0, -1.0, 1.0])
    ways = [
        Alternative(None, run),
        Alternative("mirrored", mirror, "seen in a mirror"),
        Alternative("reversed", run, "b"),
    ]
    found = _judged(Judgement(ways, np.array([9.0, 1.2, 1.0]), 10.0, ()), set())
    assert found is not None
    assert (
        found.seen
        == "seen in a mirror, or b (distance of simulated and measured marks: 9 mm as stated in the file, 1 mm when "
        "corrected)"
    )
    assert (found.kind, found.equivalent) == ("mirrored", ("reversed",))
    assert found.correction == Correction(marks_times=(-1.0, 1.0))
    assert "; or change the signs" in found.remedy


@pytest.mark.parametrize(
    ("rates", "told"),
    [
        ([1.2, 1.2, 1.2, 1.2, 1.0], 4),
        ([1.2, 1.2, 1.2, 1.0, 1.0], 0),  # two runs contradict it, of which at most one is odd
        ([1.2, 1.25, 2.0, 2.5, 4.0], 0),  # each turn is slower by another factor, as with a blocked wheel
        ([1.0, 1.0, 1.0, 1.0, 1.0], 0),
    ],
)
def test_another_rate_is_believed_where_one_rate_fits_most_runs(
    rates: list[float], told: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = [driven(number) for number in range(len(rates))]
    ratios = sorted({*rates} - {1.0}) or [2.0]
    judgements = [
        Judgement(
            [Alternative(None, run), *(Alternative("wrong-rate", run, f"at {ratio}") for ratio in ratios)],
            np.array([9.0, *(0.1 if ratio == rate else 3.1 for ratio in ratios)]),
            10.0,
            ((10.0, 30.0 + number),),
        )
        for number, (run, rate) in enumerate(zip(data, rates, strict=True))
    ]
    monkeypatch.setattr(hypotheses, "_judged_runs", lambda *_: judgements)
    monkeypatch.setattr(belief, "misfit_within_tolerances", lambda *_: np.inf)
    assert len(misread_runs(data, [ROBOT] * len(data))) == told


def test_a_lag_that_logs_have_in_common_is_no_late_start_of_those_in_which_it_tells_most(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of five runs with logs all fit best later, two of them far better; six runs without a log say nothing of it."""

    def judged(number: int, later_s: float, stated: float) -> Judgement:
        log = RunCommand(Command.steps([(0.0, 30.0, 20.0)]), logged=True) if number < 5 else None
        run = replace(driven(number), log=log)
        ways = [Alternative(None, run), Alternative("late-start", run, "follows late", later_s=later_s)]
        return Judgement(ways, np.array([stated, 0.1]), 10.0, ((20.0, 30.0 + number),))

    data = [driven(number) for number in range(11)]
    for odd, told in ((0.1, []), (0.5, ["r1"])):
        sizes = [9.0, 9.0, 1.0, 1.0, 1.0] + [0.05] * 6
        judgements = [judged(number, odd if number == 1 else 0.1, size) for number, size in enumerate(sizes)]
        monkeypatch.setattr(hypotheses, "_judged_runs", lambda *_, found=judgements: found)
        monkeypatch.setattr(belief, "misfit_within_tolerances", lambda *_: np.inf)
        assert [item.run for item in misread_runs(data, [ROBOT] * 11)] == told


def test_a_run_at_other_intervals_than_the_session_may_be_of_another_rate_by_itself() -> None:
    run = driven(0)
    misfits = np.array([9.0, 0.1])
    for own, told in ((True, True), (False, False)):
        ways = [Alternative(None, run), Alternative("wrong-rate", run, "moves as if", own=own)]
        assert (_judged(Judgement(ways, misfits, 10.0, ()), set()) is not None) == told


def test_a_turn_is_like_others_with_the_same_side_slower() -> None:
    left, right = replace(driven(0), left_rpm=14.4, right_rpm=33.3), replace(driven(1), left_rpm=33.3, right_rpm=14.4)
    backward = replace(driven(2), left_rpm=-14.4, right_rpm=-33.3)
    assert has_similar_runs(left, [right])
    assert not turns_like_others(left, [right])
    assert turns_like_others(left, [right, backward])
    straight = replace(driven(3), left_rpm=20.0, right_rpm=20.0)  # leaves no side alone
    assert turns_like_others(straight, [right])


def test_a_lone_run_that_disagrees_is_named_by_its_reading_or_as_outlying(monkeypatch: pytest.MonkeyPatch) -> None:
    run, others = driven(0), [driven(1), replace(driven(2), left_rpm=10.0)]
    assert has_similar_runs(run, others)
    assert not has_similar_runs(run, others[1:])
    monkeypatch.setattr(outlying, "reading_of", lambda *_: None)
    unread = outlying_run(run, others, ROBOT)
    assert (unread.runs, unread.kind) == (("r0",), "outlying")
    assert unread.sentence.startswith("r0 disagrees with the robot that the other 2 runs determine; none of")
    driven_else = outlying_run(run, others, ROBOT, gains=(-0.5, 0.0))
    assert driven_else.kind == "wrong-command"
    slower, same = 0.5 * run.left_rpm, run.right_rpm
    assert (
        f"commanded about {slower:.2g} / {same:.2g} rpm, not {run.left_rpm:g} / {same:g}; check which"
        in driven_else.sentence
    )
    hardly = outlying_run(run, others, ROBOT, gains=(-0.004, 0.003))
    assert hardly.kind == "outlying"
    assert "its left wheels turn 0.4 % slower than commanded, its right wheels 0.3 % faster; inspect" in hardly.sentence
    for reading, kind in (
        (Correction(seconds_times=1.2), "wrong-rate"),
        (Correction(command=(1.0, 2.0)), "wrong-command"),
    ):
        half_read = Found("r0", "wrong-rate", "moves so", "mend it", (), reading)
        monkeypatch.setattr(outlying, "reading_of", lambda *_, read=half_read: read)
        for gains, of_gains in (((0.2, 0.2), False), ((0.2, 0.14), True)):
            sentence = outlying_run(run, others, ROBOT, gains=gains).sentence
            assert ("moves as if it were commanded about" in sentence) == (of_gains or kind == "wrong-command")
    faster = outlying_run(run, others, ROBOT, gains=(0.11, 0.09)).sentence
    assert ", or as if its wheels were 1.1 times as large (another robot?); check which command" in faster
    assert "another robot" not in outlying_run(run, others, ROBOT, gains=(0.12, 0.08)).sentence
    slow = Found("r0", "wrong-rate", "moves so", "mend it", ("late-start",), Correction(seconds_times=1.25))
    monkeypatch.setattr(outlying, "reading_of", lambda *_: slow)
    named = outlying_run(replace(run, left_rpm=-15.0, right_rpm=-18.0), others, ROBOT)
    assert (named.equivalent_kinds, named.corrections) == (("late-start", "wrong-command"), {"r0": slow.correction})
    assert named.sentence.endswith(
        "it moves so, or as if it were commanded about -19 / -22 rpm, not -15 / -18, or as if its wheels were 1.2 "
        "times as large (another robot?); mend it; or check which command belongs to this recording"
    )
    read = Found("r0", "mirrored", "moves so", "mirror it", ("reversed",))
    monkeypatch.setattr(outlying, "reading_of", lambda *_: read)
    named = outlying_run(run, others, ROBOT)
    assert (named.kind, named.equivalent_kinds, named.corrections) == ("mirrored", ("reversed",), {})
    assert named.sentence.endswith("runs determine: it moves so; mirror it")
    ground = outlying_run(replace(run, from_poses=True), others, load_robot(HUSKY))
    assert (ground.kind, ground.equivalent_kinds) == ("outlying", ())
    assert ground.sentence.endswith("runs determine; inspect the recording, or repeat the run")


@pytest.mark.parametrize(
    ("pair", "alike"),
    [
        ((30.0, 20.0), True),  # between the others, though none drives at its speeds
        ((-20.0, -30.0), True),
        ((47.0, 28.0), True),  # 18 % faster than the fastest
        ((52.0, 28.0), False),  # 30 % faster
        ((24.0, 5.0), False),  # its slower wheel is slower by half than any other: a dead band may act in it alone
        ((30.0, -20.0), False),  # turns on the spot
    ],
)
def test_a_run_has_kin_among_runs_that_drive_alike_or_around_it(pair: tuple[float, float], alike: bool) -> None:
    around = ((40.0, 12.0), (12.0, 40.0), (-25.0, -24.0), (-38.0, -10.0))
    others = [replace(driven(k), left_rpm=left, right_rpm=right) for k, (left, right) in enumerate(around)]
    assert has_similar_runs(replace(driven(9), left_rpm=pair[0], right_rpm=pair[1]), others) == alike


def test_a_run_known_to_disagree_is_read_however_small_its_misfit_and_at_any_rate(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    run = driven(0)
    ways = [Alternative(None, run), Alternative("wrong-rate", run, "moves as if")]
    monkeypatch.setattr(hypotheses, "judgements_of", lambda *_: [Judgement(ways, np.array([0.2, 0.01]), 10.0, ())])
    found = reading_of(run, [driven(1)], ROBOT)
    assert found is not None
    assert found.kind == "wrong-rate"


def test_a_mistake_that_fits_worse_than_all_other_runs_is_the_nearest_and_corrects_nothing() -> None:
    """A run whose file stated the command of no run was told to drive backward, and to change its signs."""
    run = driven(0)
    ways = [Alternative(None, run), Alternative("reversed", replace(run, left_rpm=-30.0), "drives the opposite way")]
    item = Judgement(ways, np.array([1.4, 0.1]), 5.0, ())
    for good_mm, fits in ((0.11, True), (0.09, False)):
        found = _judged(item, set(), good_mm=good_mm)
        assert found is not None
        assert found.kind == "reversed"
        assert (found.correction is not None) == fits
        assert found.seen.startswith(
            "drives the opposite" if fits else "contradicts its file, and no usual mistake fits"
        )
    good = [Judgement(ways[:1], np.array([value]), 5.0, ()) for value in (0.05, 0.07, np.nan)]
    assert _worst_of_good([*good, item], [False] * 3 + [True]) == np.inf  # no majority
    assert _worst_of_good(good, [False] * 3) == 0.07


@pytest.mark.parametrize(("ratio", "said"), [(1.03, None), (1.05, 1.05), (0.95, 0.95)])
def test_frame_intervals_of_a_run_differ_from_those_of_the_session_by_four_percent(
    ratio: float, said: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = [driven(number) for number in range(5)]
    data[2] = replace(data[2], time_s=ratio * data[2].time_s)
    asked: list[tuple[float | None, float]] = []

    def noted(run: RunData, _: Any, interval_ratio: float | None, same_interval: float, _f: Any) -> list[Alternative]:
        asked.append((interval_ratio, same_interval))
        return [Alternative(None, run)]

    monkeypatch.setattr(hypotheses, "alternatives", noted)
    monkeypatch.setattr(
        hypotheses, "judgements_of", lambda ways, _: [Judgement(of_run, np.ones(1), 1.0, ()) for of_run in ways]
    )
    assert misread_runs(data, [ROBOT] * 5) == []
    assert asked[2] == (said if said is None else pytest.approx(said), 0.04)
    assert asked[0] == (None if said is None else pytest.approx(1.0), 0.04)


@pytest.mark.parametrize(("frames", "told"), [(9, False), (10, True)])
def test_a_copy_has_ten_frames_or_more(frames: int, told: bool) -> None:
    run = driven(1)
    short = replace(run, time_s=run.time_s[:frames], marks_mm=run.marks_mm[:frames])
    assert bool(copies([short, replace(short, id="copy")])) == told


def test_two_runs_that_moved_by_each_others_command_are_to_be_exchanged() -> None:
    def moved_by(run: str, command: tuple[float, float], kind: Kind = "wrong-command") -> Found:
        return Found(run, kind, "moves", "check it", (), Correction(command=command))

    commands = {"r0": (30.0, 10.0), "r1": (20.0, 40.0), "r2": (50.0, 50.0)}
    pair = [moved_by("r0", (20.0, 40.0)), moved_by("r1", (30.0, 10.0))]
    assert [item.remedy for item in exchanged_commands(pair, commands)] == [
        "exchange the commands of r0 and r1",
        "exchange the commands of r1 and r0",
    ]
    for others in (
        [pair[0], moved_by("r1", (50.0, 50.0))],  # one of them by that of a third run
        [*pair, moved_by("r2", (20.0, 40.0))],  # or two by the same
        [pair[0], moved_by("r1", (30.0, 10.0), "reversed")],
        pair[:1],
    ):
        assert "check it" in {item.remedy for item in exchanged_commands(others, commands)}
        assert exchanged_commands(others, commands)[0].remedy == "check it"
