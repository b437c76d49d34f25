"""Of long sessions: pieces of long recordings, and the runs that a diagnosis needs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from evaluator.diagnosis import experiment
from evaluator.diagnosis.experiment import Session, _in_pieces, needed_of
from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.long_sessions import LONGEST_S, apart, deciding_runs, needed_runs, pieces_of, searched_runs
from evaluator.diagnosis.mistakes.recognised import Found
from evaluator.interchange.commands import RunCommand
from simulator.command import Command
from simulator.robot import load_robot
from simulator.simulation import RUN_IN_S
from tests.evaluator.diagnosis.synthetic import run_data


def driven(changes_s: tuple[float, ...], seconds: float) -> RunData:
    """A run of a robot whose left command grows by 1 rpm at every change, at 10 poses a second from 100 s on."""
    time = 100 + np.arange(0, seconds, 0.1)
    log = RunCommand(Command.steps([(100 + at, 1.0 + k, 5.0) for k, at in enumerate(changes_s)]), logged=True)
    return RunData("r", 1.0, 5.0, 100.0, None, time, np.column_stack([time] * 4), 0, log=log, from_poses=True)


def test_a_long_recording_is_cut_at_changes_of_command_and_every_few_seconds_elsewhere() -> None:
    pieces = pieces_of(driven((0.0, 2.5, 9.2, 12.8), 20.05), fewest=6)
    starts = [piece.time_s[0] - 100 for piece in pieces]
    assert starts == pytest.approx([0, 2.5, 5.5, 9.2, 12.8, 15.8])
    assert np.array_equal(np.concatenate([piece.time_s for piece in pieces]), driven((0.0,), 20.05).time_s)
    assert [piece.id for piece in pieces[:2]] == ["r@100.0s", "r@102.5s"]
    assert [piece.left_rpm for piece in pieces] == [1, 2, 2, 3, 4, 4]
    assert [piece.run_command.starts_at_rest for piece in pieces] == [True] + 5 * [False]
    # motors are told what they were told before the piece: those that follow late know it
    assert pieces[3].run_command.command.at(np.array([107.0, 109.1, 109.3]))[0].tolist() == [2, 2, 3]


def test_a_piece_begins_with_the_nearest_command_within_a_second_and_knows_those_of_six_seconds_before() -> None:
    pieces = pieces_of(driven((0.0, 2.2, 2.9, 7.2), 20.05), fewest=6)
    assert [piece.time_s[0] - 100 for piece in pieces] == pytest.approx([0, 2.9, 5.9, 8.9, 11.9, 14.9])
    told = pieces[3].run_command.command
    assert (told.time_s[0], told.time_s[-1]) == pytest.approx((102.9, pieces[3].time_s[-1] + 6.0))


def test_a_piece_begins_with_the_velocity_that_was_measured_before_it() -> None:
    """A run that gathers speed along x at 1 mm/s², and whose two marks are 1 mm apart along y."""
    run = driven((0.0, 9.2), 20.05)
    since = run.time_s - 100
    marks = np.column_stack([since**2 / 2, 0 * since + 1, since**2 / 2, 0 * since])
    run = replace(run, marks_mm=marks)
    pieces = pieces_of(run, fewest=6)
    assert pieces[0].run_in is None  # it starts at rest
    for piece in pieces[1:]:
        assert piece.run_in == pytest.approx((piece.time_s[0] - 100 - RUN_IN_S, 0.0, 0.0), abs=1e-9)
    moving = replace(run, log=replace(run.run_command, starts_at_rest=False))
    assert pieces_of(moving, fewest=6)[0].run_in == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)  # of its first frames
    short = replace(moving, time_s=run.time_s[50:80], marks_mm=marks[50:80])
    assert pieces_of(short, fewest=6)[0].run_in == pytest.approx((5.0, 0.0, 0.0), abs=1e-9)


def test_a_short_recording_stays_whole_and_pieces_without_poses_are_none() -> None:
    short = driven((0.0,), LONGEST_S)
    assert pieces_of(short, fewest=6) == (short,)
    hidden = driven((0.0,), 20.05)
    hidden.marks_mm[25:62] = np.nan  # all of the second piece, and the edges of its neighbours
    assert [piece.time_s[0] - 100 for piece in pieces_of(hidden, fewest=6)] == pytest.approx([0, 6.2, 9, 12, 15])


def test_of_a_long_session_all_runs_of_commands_far_apart_are_taken() -> None:
    """On a line from 0 to 8 the fastest first, then the slowest, then the middle one."""
    data = [run_data(float(level), float(level), number) for number, level in enumerate((0, 1, 4, 8, 8, 7, 0))]
    assert apart(data, 1, 2) == (3, 4)
    assert apart(data, 1, 3) == apart(data, 2, 1) == (0, 3, 4, 6)
    assert apart(data, 1, 5) == apart(data, 3, 3) == (0, 2, 3, 4, 6)
    assert apart(data, 1, 7) == apart(data, 99, 1) == apart(data, 1, 99) == tuple(range(7))


def test_of_hundreds_of_runs_some_dozens_decide_and_as_many_are_held_out() -> None:
    data = [run_data(float(k % 100), float(k % 7), k) for k in range(300)]
    deciding, needed = deciding_runs(data), needed_runs(data)
    assert set(searched_runs(data)) <= set(deciding) < set(needed)
    assert len(needed) == 2 * len(deciding) < 120
    assert len({data[k].command for k in deciding}) == 36  # one run to a command
    kept = [data[k] for k in needed]
    assert [kept[k].id for k in deciding_runs(kept)] == [data[k].id for k in deciding]  # the same again
    few = data[:38]
    assert deciding_runs(few) == needed_runs(few) == tuple(range(38))


def test_a_recording_in_milliseconds_is_kept_whole_for_the_search_for_mistakes_and_one_without_poses_is_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its poses, 50 s apart, gave no piece: the recording was in no list of the diagnosis, which had status 0."""
    robot = load_robot(Path(__file__).parents[2] / "driven_robot" / "husky.toml")
    rare = replace(driven((0.0,), 20.05), id="rare")
    rare.marks_mm[np.arange(len(rare.time_s)) % 12 > 0] = np.nan  # three poses in 3 s
    in_ms = replace(driven((0.0,), 20.05), id="ms")
    told = Found("ms", "wrong-unit", "", "")
    monkeypatch.setattr(experiment, "wrong_seconds", lambda *_: [told])
    usual = [replace(driven((0.0,), 20.05), id=f"r{k}", left_rpm=float(k)) for k in range(3)]
    session = _in_pieces(Session((in_ms, rare, *usual), (robot,) * 5, {}))
    assert session.left_out == {"rare": "no stretch of 3 s of it has 6 poses; are its times in seconds?"}
    assert [run.id for run in session.data][:2] == ["ms", "r0@100.0s"]
    monkeypatch.setattr(experiment, "needed_runs", lambda _: (1, 2))
    assert [run.id for run in needed_of(session).data] == ["ms", "r0@100.0s", "r0@103.0s"]
