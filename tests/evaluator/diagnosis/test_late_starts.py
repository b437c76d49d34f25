"""From where on a start is late, and which starts of all runs are told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evaluator.diagnosis.mistakes.motion import Onset
from evaluator.diagnosis.mistakes.start import late_start
from evaluator.diagnosis.mistakes.start.late_start import late_starts
from tests.evaluator.diagnosis.straight_session import ROBOT, ROLLED_MM_S, driven, kinds, session


@pytest.mark.parametrize(("late_s", "told"), [(0.07, False), (0.14, True), (-0.14, True)])
def test_a_start_is_late_from_a_tenth_of_a_second_on(late_s: float, told: bool) -> None:
    found = late_starts(session(driven(0, begins_s=0.5 + late_s)), [ROBOT] * 8)
    assert kinds(found) == ([("r0", "late-start")] if told else [])
    if told:
        assert float(found[0].remedy.removeprefix("set start_s = ")) == pytest.approx(0.5 + late_s, abs=0.03)
        assert ("later" if late_s > 0 else "earlier") in found[0].seen


@pytest.mark.parametrize(("sigmas", "told"), [(4.8, False), (5.2, True), (-5.2, True)])
def test_a_start_is_late_from_five_of_its_standard_deviations_on(
    sigmas: float, told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    begins = {"r0": 0.5 + sigmas * 0.06}
    monkeypatch.setattr(late_start, "onset", lambda run: Onset(begins.get(run.id, 0.5), 0.06, (0.6, 1.0)))
    assert kinds(late_starts(session(driven(0)), [ROBOT] * 8)) == ([("r0", "late-start")] if told else [])


def test_a_start_is_late_beside_the_lag_of_all_runs() -> None:
    runs = [driven(0, begins_s=1.0), *(driven(number, begins_s=0.8) for number in range(1, 8))]
    (found,) = late_starts(runs, [ROBOT] * 8)
    assert (found.run, found.kind) == ("r0", "late-start")
    assert found.correction is not None
    assert found.correction.later_s == pytest.approx(0.2, abs=0.03)


def test_a_start_that_noise_leaves_open_is_no_late_one() -> None:
    """At 3 rpm a robot goes 16 µm in a tenth of a second: in noise of 10 µm that is nobody's mistake."""
    others = [driven(number) for number in range(1, 8)]
    found = []
    for seed in range(12):
        slow = driven(0, speed=ROLLED_MM_S / 10)
        noise = np.random.default_rng(seed).normal(0.0, 0.01, slow.marks_mm.shape)
        found += late_starts([replace(slow, marks_mm=slow.marks_mm + noise), *others], [ROBOT] * 8)
    assert found == []


def test_a_lag_of_all_runs_is_no_late_start_and_a_start_after_the_end_is() -> None:
    assert late_starts([driven(number, begins_s=0.8) for number in range(8)], [ROBOT] * 8) == []
    found = late_starts(session(driven(0, start_s=3.5)), [ROBOT] * 8)
    assert kinds(found) == [("r0", "late-start")]
    assert "after the end of the recording (0.00 to 2.98 s)" in found[0].seen


@pytest.mark.parametrize(("late_s", "told"), [(0.9, False), (1.1, True)])
def test_starts_that_all_are_late_by_more_than_motors_take_are_told(late_s: float, told: bool) -> None:
    found = late_starts([driven(number, start_s=0.2, begins_s=0.2 + late_s) for number in range(8)], [ROBOT] * 8)
    assert kinds(found) == [(f"r{number}", "late-start") for number in range(8 * told)]
    assert all("later than start_s says" in item.seen for item in found)


@pytest.mark.parametrize(("late_s", "told"), [(0.25, False), (0.35, True)])
def test_starts_that_the_file_leaves_out_are_said_to_be_late_though_all_are(late_s: float, told: bool) -> None:
    runs = [driven(number, start_s=0.5, begins_s=0.5 + late_s) for number in range(8)]
    found = late_starts([replace(run, start_is_stated=False) for run in runs], [ROBOT] * 8)
    assert kinds(found) == [(f"r{number}", "late-start") for number in range(8 * told)]
    assert all("start_s, which is not given, counts as 0.5" in item.seen for item in found)
    assert all(abs(item.correction.later_s - late_s) < 0.03 for item in found if item.correction)


@pytest.mark.parametrize("late", [4, 6, 8, 9])
@pytest.mark.parametrize("late_s", [0.3, -0.3, 0.15])
def test_of_two_groups_the_one_at_start_s_is_right_however_small(late: int, late_s: float) -> None:
    runs = [driven(number, begins_s=0.5 + late_s * (number >= 12 - late)) for number in range(12)]
    found = late_starts(runs, [ROBOT] * 12)
    assert kinds(found) == [(f"r{number}", "late-start") for number in range(12 - late, 12)]
    assert all(item.correction.later_s == pytest.approx(late_s, abs=0.03) for item in found if item.correction)


@pytest.mark.parametrize(("spread_s", "told"), [(0.012, True), (0.03, False)])
def test_groups_lie_apart_by_six_times_their_spread(
    spread_s: float, told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    begins = {f"r{number}": 0.5 + 0.16 * (number > 5) + spread_s * (number % 3 - 1) for number in range(12)}
    monkeypatch.setattr(late_start, "onset", lambda run: Onset(begins[run.id], 0.002, (0.6, 1.0)))
    found = late_starts([driven(number) for number in range(12)], [ROBOT] * 12)
    assert kinds(found) == [(f"r{number}", "late-start") for number in range(6, 12)] * told


def test_two_runs_of_twelve_in_time_are_early_beside_the_lag_of_the_others() -> None:
    runs = [driven(number, begins_s=0.5 + 0.3 * (number > 1)) for number in range(12)]
    assert kinds(late_starts(runs, [ROBOT] * 12)) == [("r0", "late-start"), ("r1", "late-start")]


def test_starts_that_spread_have_no_groups() -> None:
    runs = [driven(number, begins_s=0.5 + 0.06 * number) for number in range(12)]
    assert late_starts(runs, [ROBOT] * 12) == []
