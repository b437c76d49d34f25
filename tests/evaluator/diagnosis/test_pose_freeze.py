"""Poses that stand while the wheels are commanded on are told with their time, also over the parts of a recording."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.misread.pose_freeze import frozen
from evaluator.interchange.commands import RunCommand
from simulator.command import Command
from simulator.robot import load_robot

ROBOT = load_robot("barrel")
TIME_S = np.arange(0.0, 20.0, 0.05)
MM_S = 0.6 * 2 * np.pi / 60 * 30 * ROBOT.driving_radius_mm  # of 30 rpm, with slip
HALF_MM = 2.0


def posed(
    *, until_s: float = np.inf, yaw: float = 0.2, off_s: float = 19.0, noise_mm: float = 0.02, share: float = 1.0
) -> RunData:
    """A robot that turns at 30 rpm and stands from a time on, with virtual marks on both sides of it."""
    moved_s = np.minimum(TIME_S, min(until_s, off_s))
    heading = yaw * moved_s
    way = np.concatenate([[0.0], np.cumsum(np.diff(moved_s) * share * MM_S * np.exp(1j * heading[:-1]))])
    way = way + np.random.default_rng(1).normal(0.0, noise_mm, (2, len(TIME_S))).T @ [1.0, 1j]
    across = 1j * HALF_MM * np.exp(1j * heading)
    marks = np.column_stack([(way + across).real, (way + across).imag, (way - across).real, (way - across).imag])
    log = RunCommand(Command.steps([(0.0, 30.0, 30.0), (9.0, 30.0, 20.0), (off_s, 0.0, 0.0)]), logged=True)
    return RunData("r1", 30.0, 30.0, 0.0, None, TIME_S, marks, 0, log=log, line_rad=np.pi / 2, from_poses=True)


def parts_of(run: RunData, *at_s: float) -> list[RunData]:
    edges = [-1.0, *at_s, 99.0]
    chosen = [(run.time_s > low) & (run.time_s <= high) for low, high in itertools.pairwise(edges)]
    return [
        replace(run, id=f"r1@{run.time_s[keep][0]:.1f}s", time_s=run.time_s[keep], marks_mm=run.marks_mm[keep])
        for keep in chosen
    ]


@pytest.mark.parametrize("until_s", [5.0, 8.0, 14.0])
def test_poses_that_stop_while_their_commands_go_on_are_told(until_s: float) -> None:
    (found,) = frozen([posed(until_s=until_s)], [ROBOT])
    assert (found.run, found.kind) == ("r1", "stuck")
    told_s = float(found.seen.split(" from ")[1].split(" s ")[0])
    assert told_s == pytest.approx(until_s, abs=0.3)
    assert "while its wheels are commanded to roll on" in found.seen


@pytest.mark.parametrize(
    "shown",
    [
        {},
        {"until_s": 12.0, "off_s": 12.0},  # as commanded
        {"until_s": 0.5},  # it hardly moves at all: a dead band, or the wrong command
        {"until_s": 17.5},  # a stop that its log has late
        {"yaw": 1.5},  # on a small circle
        {"share": 0.0, "yaw": 0.6},  # on the spot
        {"noise_mm": 2.0, "until_s": 10.0},  # they scatter as far as it drives
    ],
)
def test_a_robot_that_drives_or_turns_to_the_end_is_not_frozen(shown: dict[str, Any]) -> None:
    assert frozen([posed(**shown)], [ROBOT]) == []


def test_poses_of_marks_and_few_ones_are_left_to_other_searches() -> None:
    stopped = posed(until_s=8.0)
    assert frozen([replace(stopped, from_poses=False)], [ROBOT]) == []
    few = slice(0, None, 30)
    assert frozen([replace(stopped, time_s=TIME_S[few], marks_mm=stopped.marks_mm[few])], [ROBOT]) == []


def test_of_a_recording_in_parts_the_last_ones_are_told() -> None:
    parts = parts_of(posed(until_s=8.0), 4.0, 9.0, 15.0)
    found = frozen([*parts, replace(posed(), id="r2")], [ROBOT] * 5)
    assert [item.run for item in found] == [part.id for part in parts[1:]]
    assert len({item.seen for item in found}) == 1
