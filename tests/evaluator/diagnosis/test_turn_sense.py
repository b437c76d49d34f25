"""Exchanged sides of large robots, by the sense of their turns: slip and lag of any size hide and invent none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.misread.turn_sense import turn_of, turned_otherwise
from evaluator.interchange.commands import RunCommand
from evaluator.interchange.log_offset import correlations
from simulator.command import Command

LINE_RAD = 0.4  # of the marks in the body frame


def driven(seed: int, size_mm: float, share: float, lag_s: float, ahead: float = 1.0, turn: float = 1.0) -> RunData:
    """A robot that turns by a share of its command, late; ahead, turn: -1 to reverse either."""
    rng = np.random.default_rng(seed)
    knots = np.column_stack([np.arange(0, 6, 1.5), rng.uniform(20, 40, 4), rng.uniform(20, 40, 4)])
    knots[2, 1:] = knots[2, 2:0:-1]
    command = Command.steps([*map(tuple, knots), (6.0, 0.0, 0.0)])
    time = np.arange(0, 6, 0.02)
    left, right = command.at(time - lag_s)
    rpm_mm_s = size_mm / 20
    heading = seed + np.cumsum(turn * share * rpm_mm_s * (right - left) / size_mm) * 0.02
    way = np.cumsum(ahead * rpm_mm_s * (left + right) / 2 * np.exp(1j * heading)) * 0.02
    off = 0.2 * size_mm * np.exp(1j * (heading + LINE_RAD))
    marks = np.column_stack([(way + off).real, (way + off).imag, (way - off).real, (way - off).imag])
    marks += 3e-4 * size_mm * rng.normal(size=marks.shape)
    log = RunCommand(command, logged=True)
    return RunData(f"r{seed}", 30.0, 20.0, 0.0, 6.0, time, marks, seed, line_rad=LINE_RAD, log=log, from_poses=True)


@pytest.mark.parametrize("size_mm", [4.0, 60.0, 600.0])
@pytest.mark.parametrize(("share", "lag_s"), [(1.0, 0.0), (0.3, 0.2), (0.1, 0.5)])
def test_sides_are_exchanged_where_turns_go_the_other_way_at_every_size_slip_and_lag(
    size_mm: float, share: float, lag_s: float
) -> None:
    right = [driven(seed, size_mm, share, lag_s) for seed in range(6)]
    wrong = [driven(seed, size_mm, share, lag_s, turn=-1.0) for seed in range(6)]
    turns = [turn_of(run) for run in right]
    assert all(turn is not None and turn.correlation > 0.9 for turn in turns)
    assert [turn and turn.gain for turn in turns] == pytest.approx([share / 20] * 6, rel=0.1)
    assert turned_otherwise(right) == []
    found = turned_otherwise(wrong)
    assert [item.run for item in found] == [run.id for run in wrong]
    assert {item.kind for item in found} == {"sides-swapped"}
    assert "of 6 runs or parts of runs whose turns follow their commands, 6 turn the other way" in found[0].seen
    correction = found[0].correction
    assert correction is not None
    assert correction.log is not None
    assert correction.log.command.left_rpm.tolist() == wrong[0].run_command.command.right_rpm.tolist()


def test_a_robot_that_drives_the_opposite_way_has_no_exchanged_sides() -> None:
    assert turn_of(driven(1, 600.0, 0.5, 0.1, ahead=-1.0, turn=-1.0)) is None


def test_a_robot_that_stands_or_is_not_seen_shows_no_sense() -> None:
    run = driven(1, 600.0, 0.5, 0.1)
    assert turn_of(replace(run, marks_mm=np.tile(run.marks_mm[0], (len(run.time_s), 1)))) is None
    assert turn_of(replace(run, marks_mm=np.full_like(run.marks_mm, np.nan))) is None


def test_some_runs_that_turn_the_other_way_are_no_exchange_of_the_session() -> None:
    wrong = [driven(seed, 600.0, 0.5, 0.1, turn=-1.0) for seed in range(3)]
    assert turned_otherwise([*wrong, driven(3, 600.0, 0.5, 0.1)]) == []  # three of four are not nearly all
    assert turned_otherwise(wrong[:2]) == []


@pytest.mark.parametrize(
    ("share", "others", "found"),
    [
        (0.3, 6, True),
        (0.16, 6, True),  # half of the gain of the others: slip
        (0.14, 6, False),
        (0.62, 6, False),  # pushed
        (0.3, 3, False),  # one of four is not one of few
    ],
)
def test_a_single_run_has_exchanged_sides_if_it_turns_as_the_others_would(
    share: float, others: int, *, found: bool
) -> None:
    wrong = driven(9, 600.0, share, 0.1, turn=-1.0)
    right = [driven(seed, 600.0, 0.3, 0.1) for seed in range(others)]
    assert [item.run for item in turned_otherwise([*right, wrong])] == ["r9"] * found
    if found:
        (item,) = turned_otherwise([*right, wrong])
        assert "of 7 runs or parts of runs whose turns follow their commands, 1 turns the other way" in item.seen


def test_a_correlation_is_one_at_the_delay_of_the_motion_and_counts_no_gain() -> None:
    time = np.arange(0, 20, 0.02)
    late = 0.4
    pose = np.column_stack([np.zeros_like(time), np.zeros_like(time), -0.1 * np.cos(time - late)])
    found, gains = correlations(time, pose, lambda at: (-np.sin(at), np.sin(at)), np.array([0.0, late]))
    assert gains[1] == pytest.approx([0.05 * np.cos(late), 0.05], rel=0.05)
    assert found[1] == pytest.approx([np.cos(late), 1.0], abs=0.02)
    assert found[0] == pytest.approx([0.0, 0.0])
