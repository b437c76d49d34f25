"""Recordings whose clock is off their command log, by the whole motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.start import log_clock
from evaluator.diagnosis.mistakes.start.log_clock import WIDEST_S, clocks_off
from evaluator.interchange.commands import RunCommand
from evaluator.interchange.log_offset import LogOffset
from simulator.command import Command


def driven(seed: int, late_s: float) -> RunData:
    """A robot half a metre wide that follows a log of changes every 1.5 s, late."""
    rng = np.random.default_rng(seed)
    command = Command.steps([(1.5 * k, *rng.uniform(5, 40, 2)) for k in range(20)])
    time = np.arange(0, 30, 0.05)
    left, right = command.at(time - 0.05 - late_s)  # sums are of what was before
    heading = np.cumsum(0.03 * (right - left)) * 0.05
    way = np.cumsum(10.0 * (left + right) * np.exp(1j * heading)) * 0.05
    off = 100j * np.exp(1j * heading)
    marks = np.column_stack([(way + off).real, (way + off).imag, (way - off).real, (way - off).imag])
    marks += rng.normal(size=marks.shape)
    log = RunCommand(command, logged=True)
    return RunData(f"r{seed}", 30.0, 20.0, 0.0, None, time, marks, seed, log=log, from_poses=True)


def test_a_run_with_another_offset_than_the_others_is_left_out_with_its_change_of_start() -> None:
    alike = [driven(seed, 0.2) for seed in range(4)]
    assert clocks_off(alike) == {}
    (left_out,) = clocks_off([*alike, driven(7, 1.0), driven(8, 0.2)]).items()
    assert left_out[0] == "r7"
    assert "0.80 s later than in the other runs; add 0.80 s to its start_s" in left_out[1]


def test_an_offset_of_one_run_alone_is_off_beyond_the_lag_of_the_slowest_drives() -> None:
    assert clocks_off([driven(1, 0.8)]) == {}
    assert "3.00 s earlier than it says; subtract 3.00 s from its start_s" in clocks_off([driven(1, -3.0)])["r1"]


@pytest.mark.parametrize(("width_s", "used"), [(0.99 * WIDEST_S, True), (1.01 * WIDEST_S, False)])
def test_an_offset_with_a_wide_interval_is_not_used(
    width_s: float, used: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = LogOffset(3.0, 3.0 - width_s / 2, 3.0 + width_s / 2)
    monkeypatch.setattr(log_clock, "log_offset", lambda *_: found)
    assert bool(clocks_off([driven(1, 0.0)])) == used
    assert not clocks_off([replace(driven(1, 0.0), log=None)])
