"""An effect is a verdict only where neither gap speaks against it: refitted and predicted, each by its own measure."""

from __future__ import annotations

import numpy as np
import pytest

from evaluator.diagnosis.assessment.gap import Gap, grown_gap

RUNS = 12
FLOOR = np.full(RUNS, 0.005)


def gap(after: float, *, grown: int = 0, by_mm: float = 0.05, heading_mm: float = 0.0) -> Gap:
    """Gaps of a dozen runs: refitted from 0.1 mm to after; predicted smaller by 0.05 mm but in the first few."""
    before = np.full(RUNS, 0.1)
    predicted = np.full(RUNS, 0.2)
    predicted[-1] += heading_mm
    change = np.where(np.arange(RUNS) < grown, by_mm, -0.05)
    change[-1] += 0.3 * heading_mm
    return Gap(before, np.full(RUNS, after), FLOOR, predicted, predicted + change)


@pytest.mark.parametrize(("grown", "speaks"), [(0, False), (6, False), (9, False), (10, True), (12, True)])
def test_a_predicted_gap_may_grow_in_no_more_runs_than_chance_allows(grown: int, speaks: bool) -> None:
    assert (f"grows in {grown} of {RUNS} runs" in grown_gap(gap(0.01, grown=grown))) == speaks


def test_a_change_below_half_the_noise_floor_is_none() -> None:
    assert grown_gap(gap(0.01, grown=12, by_mm=0.0024)) == ""
    assert grown_gap(gap(0.01, grown=12, by_mm=0.0026)) != ""


def test_one_run_that_starts_with_a_wrong_heading_does_not_speak_against_an_effect() -> None:
    found = gap(0.01, heading_mm=3.0)
    assert np.sum(found.predicted_after_mm**2) > np.sum(found.predicted_before_mm**2)
    assert grown_gap(found) == ""


def test_a_refitted_gap_must_shrink() -> None:
    assert "after refitting does not shrink (0.1 to 0.11 mm)" in grown_gap(gap(0.11))


def test_runs_that_cannot_be_simulated_say_nothing() -> None:
    found = gap(0.01, grown=12)
    assert grown_gap(Gap(found.before_mm, found.after_mm, FLOOR, np.full(RUNS, np.nan), found.predicted_after_mm)) == ""
