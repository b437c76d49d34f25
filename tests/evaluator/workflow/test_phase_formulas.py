"""Phases of a log, and runs of a circular test, in closed form and without files."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from evaluator.interchange.commands import RunCommand
from evaluator.turning.clock import CommandDelay
from evaluator.workflow.circular import runs as circular
from evaluator.workflow.runs import phases
from evaluator.workflow.runs.phases import _stretches, rows_of
from simulator.command import Command

TIME_S = np.arange(301) / 60
STEPS = [(0.0, 30.0, 20.0), (1.0, 0.0, 0.0), (2.0, -20.0, 30.0), (2.2, 50.0, 50.0)]
LOG = RunCommand(Command.steps(STEPS), logged=True)


@pytest.mark.parametrize(
    ("late", "limits"),
    [
        (CommandDelay(), [(0.0, 1.0), (2.0, 2.2), (2.2, 5.0)]),
        (CommandDelay(0.05, 0.0, 0.1), [(0.1, 1.0), (2.3, 5.0)]),  # six frames are no phase
        (CommandDelay(-0.06, -0.11, -0.01), [(0.0, 0.89), (2.19, 5.0)]),
    ],
)
def test_phases_are_as_late_as_the_motion_and_leave_out_what_may_belong_to_a_change(
    late: CommandDelay, limits: list[tuple[float, float]]
) -> None:
    found = list(_stretches(LOG, TIME_S, late))
    assert [(TIME_S[one.frames.start], TIME_S[one.frames.stop - 1]) for one in found] == [
        pytest.approx((begin, end), abs=1.01 / 60) for begin, end in limits
    ]
    for number, (one, (begin, end)) in enumerate(zip(found, limits, strict=True), 1):
        inside = TIME_S[one.frames]
        assert begin - 1e-9 <= inside[0]
        assert inside[-1] <= end + 1e-9
        assert (one.head["phase"], one.head["phase_start_s"], one.head["phase_stop_s"]) == (
            number,
            inside[0],
            inside[-1],
        )
        assert (
            (one.head["left_rpm"], one.head["right_rpm"])
            == (one.left_rpm, one.right_rpm)
            == LOG.command.at(begin + 0.05)
        )
        assert (one.head["late_s"], one.head["late_low_s"], one.head["late_high_s"]) == (
            pytest.approx((late.value_s, late.low_s, late.high_s), nan_ok=True)
        )


@pytest.mark.parametrize(("frames", "is_one"), [(11, False), (12, True)])
def test_a_phase_has_twelve_frames(frames: int, is_one: bool) -> None:
    assert bool(list(_stretches(LOG, TIME_S[:frames], CommandDelay()))) == is_one


def test_a_log_without_a_phase_says_why() -> None:
    poses: Any = SimpleNamespace(measured=np.arange(40) < 33)
    (row,) = rows_of([], poses, None)
    assert row["radius_status"] == (
        "its log of commands holds nothing with a motor on for 12 frames of the recording, which has 33 with a pose"
    )


def test_a_delay_is_told_by_the_changes_of_the_log_and_the_poses_that_are_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def delay(times: np.ndarray, pose: np.ndarray, changes: list[float], reach_mm: float) -> CommandDelay:
        assert changes == [1.0, 2.0, 2.2]  # those within the recording
        assert reach_mm == 5.0  # of the farthest wheel
        np.testing.assert_array_equal(pose, np.column_stack([times, 2 * times, 3 * times]))
        return CommandDelay(0.1, 0.0, 0.2)

    monkeypatch.setattr(phases, "command_delay", delay)
    monkeypatch.setattr(phases, "_offset", lambda *_: None)
    for count, known in ((12, True), (11, False)):
        there = np.isin(np.arange(301), np.linspace(0, 300, count).astype(int))
        poses: Any = SimpleNamespace(
            measured=there, time_s=TIME_S, x_mm=TIME_S, y_mm=2 * TIME_S, heading_rad=3 * TIME_S
        )
        shape: Any = SimpleNamespace(wheel_positions_mm=((1.0, -2.0), (-3.0, 4.0)))
        assert phases.command_delay_of(LOG, poses, shape).is_known == known


def turning(monkeypatch: pytest.MonkeyPatch, yaw: float, **said: float) -> None:
    usual = {"u_mm_s": -4.0, "v_mm_s": 1.0, "yaw_rate_rad_s": yaw, "speed_mm_s": 4.1, "radius_mm": -8.0}
    monkeypatch.setattr(circular, "steady_turn", lambda *_: SimpleNamespace(**usual | said))


def test_simulated_turns_have_their_way_and_slip(monkeypatch: pytest.MonkeyPatch) -> None:
    turning(monkeypatch, -0.5)
    robot: Any = None
    table = circular.simulated_turns(
        robot, pd.DataFrame({"left_rpm": [-30.0] * 2, "right_rpm": [-20.0] * 2}, index=[4, 7])
    )
    assert table.index.tolist() == [4, 7]
    assert table.loc[7].tolist() == pytest.approx([-30, -20, -4.1, np.degrees(-0.5), np.degrees(np.arctan2(1, 4))])


def test_commands_of_a_circular_test_are_of_both_sides_and_both_ways() -> None:
    cells = list(circular._cells([(30.0, 0.43), (15.0, -0.3)]))
    assert cells[:4] == [(12.9, 30.0), (30.0, 12.9), (-12.9, -30.0), (-30.0, -12.9)]
    assert cells[4:] == [(-4.5, 15.0), (15.0, -4.5), (4.5, -15.0), (-15.0, 4.5)]
