"""Recordings whose clock is off their command log, by the whole motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evaluator.diagnosis.experiment import Session, _in_pieces, without_mistakes
from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.recognised import Correction, recording_of
from evaluator.diagnosis.mistakes.start import log_clock
from evaluator.diagnosis.mistakes.start.log_clock import WIDEST_S, clocks_off
from evaluator.interchange.log_offset import LogOffset
from simulator.robot import load_robot
from tests.evaluator.diagnosis.posed_runs import driven


def test_a_run_with_another_offset_than_the_others_is_left_out_with_its_change_of_start() -> None:
    alike = [driven(seed, 0.2) for seed in range(4)]
    assert clocks_off(alike) == []
    (off,) = clocks_off([*alike, driven(7, 1.0), driven(8, 0.2)])
    assert (off.run, off.kind) == ("r7", "late-start")
    assert off.seen.endswith("0.80 s later than in the other runs")
    assert off.remedy == "add 0.80 s to its start_s"
    assert off.correction == Correction(later_s=0.8)


def test_an_offset_of_one_run_alone_is_off_beyond_the_lag_of_the_slowest_drives() -> None:
    assert clocks_off([driven(1, 0.8)]) == []
    (off,) = clocks_off([driven(1, -3.0)])
    assert off.seen.endswith("3.00 s earlier than it says")
    assert off.remedy == "subtract 3.00 s from its start_s"
    assert off.correction == Correction(later_s=-3.0)


@pytest.mark.parametrize(("width_s", "used"), [(0.99 * WIDEST_S, True), (1.01 * WIDEST_S, False)])
def test_an_offset_with_a_wide_interval_is_not_used(
    width_s: float, used: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = LogOffset(3.0, 3.0 - width_s / 2, 3.0 + width_s / 2)
    monkeypatch.setattr(log_clock, "log_offset", lambda *_: found)
    assert bool(clocks_off([driven(1, 0.0)])) == used
    assert not clocks_off([replace(driven(1, 0.0), log=None)])


def test_it_is_a_mistake_that_check_tells_and_mends() -> None:
    data = tuple(driven(seed, 1.0 if seed == 2 else 0.2) for seed in range(5))
    whole = Session(data, (load_robot("four_driven"),) * 5, {})
    rest = _in_pieces(whole)
    assert {recording_of(run.id) for run in rest.data} == {"r0", "r1", "r3", "r4"}
    (mistake,) = rest.mistakes
    assert mistake in without_mistakes(rest).mistakes  # beside what else is wrong with this robot
    assert (mistake.runs, mistake.kind, mistake.everywhere) == (("r2",), "late-start", False)
    assert mistake.corrections == {"r2": Correction(later_s=0.8)}


def test_no_clock_is_read_from_headings_of_another_convention(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(log_clock, "log_offset", lambda *_: LogOffset(3.0, 2.99, 3.01))
    runs = driven(0, 0.0), driven(1, 0.0)
    robots = (load_robot("four_driven"),) * 2
    assert {item.kind for item in _in_pieces(Session(runs, robots, {})).mistakes} == {"late-start"}
    assert _in_pieces(Session(tuple(map(_as_a_compass, runs)), robots, {})).mistakes == ()


def _as_a_compass(run: RunData) -> RunData:
    """A run whose headings count clockwise from the y axis."""
    middle, line = run.marks_mm[:, :2] / 2 + run.marks_mm[:, 2:] / 2, run.marks_mm[:, :2] / 2 - run.marks_mm[:, 2:] / 2
    return replace(run, marks_mm=np.concatenate([middle - line[:, ::-1], middle + line[:, ::-1]], axis=1))
