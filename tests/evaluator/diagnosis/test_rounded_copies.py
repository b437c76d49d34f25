"""A copy of a run counts once, also if its coordinates are rounded; two runs that are driven alike do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.session.copies import copies
from tests.evaluator.diagnosis.marks_of_motion import TIME, moving, recorded

ORIGINAL = replace(recorded(moving(TIME)), id="original")


def rounded(run: RunData, unit_mm: float, name: str = "copy") -> RunData:
    return replace(run, id=name, marks_mm=unit_mm * np.round(run.marks_mm / unit_mm))


@pytest.mark.parametrize("unit_mm", [1e-4, 1e-3, 0.01, 0.1])
def test_a_rounded_copy_counts_once(unit_mm: float) -> None:
    copy = rounded(ORIGINAL, unit_mm)
    for runs in ([ORIGINAL, copy], [copy, ORIGINAL]):
        (found,) = copies(runs)
        assert (found.run, found.kind) == (runs[1].id, "duplicate")
        assert f"same marks as {runs[0].id}" in found.seen


def test_copies_of_a_copy_are_told_of_one_original() -> None:
    other = recorded(moving(TIME, speed=2.5))
    fine, coarse = rounded(ORIGINAL, 0.002, "fine"), rounded(ORIGINAL, 0.05, "coarse")
    runs = [replace(other, id="other"), fine, ORIGINAL, coarse, replace(ORIGINAL, id="again")]
    found = copies(runs)
    assert sorted(item.run for item in found) == ["again", "coarse", "original"]
    assert all("same marks as fine" in item.seen for item in found)
    assert copies([coarse, replace(fine, left_rpm=1.0)]) == []  # under another command a simulation tells which


@pytest.mark.parametrize(
    ("unit_mm", "off_mm"),
    [(0.01, 1e-4), (0.01, 1e-3), (0.1, 1e-3), (1e-4, 0.0)],
)
def test_runs_that_are_driven_alike_are_no_copies(unit_mm: float, off_mm: float) -> None:
    """Their noise differs, or their places by a hundredth of the unit of rounding."""
    rng = np.random.default_rng(3)
    again = replace(ORIGINAL, marks_mm=moving(TIME) + off_mm + 1e-4 * rng.normal(size=ORIGINAL.marks_mm.shape))
    assert copies([rounded(ORIGINAL, unit_mm, "first"), rounded(again, unit_mm, "second")]) == []


def test_a_copy_may_lack_frames_that_are_outliers_when_rounded() -> None:
    copy = rounded(ORIGINAL, 0.01)
    copy.marks_mm[[20, 70]] = np.nan
    assert [item.run for item in copies([ORIGINAL, copy])] == ["copy"]
    copy.marks_mm[30] += 1.0
    assert [item.run for item in copies([ORIGINAL, copy])] == ["copy"]
    copy.marks_mm[31:34] += 1.0
    assert copies([ORIGINAL, copy]) == []
    copy = rounded(ORIGINAL, 0.01)
    copy.marks_mm[9:] = np.nan
    assert copies([ORIGINAL, copy]) == []


def test_coarse_places_of_a_robot_that_hardly_moves_agree_by_chance() -> None:
    short = replace(ORIGINAL, time_s=TIME[:12], marks_mm=moving(TIME[:12], speed=1.0))
    unit_mm = 0.05  # it moves by five of them
    assert copies([rounded(short, unit_mm, "first"), replace(short, id="second")]) == []
    assert copies([rounded(short, unit_mm / 5, "first"), replace(short, id="second")]) != []


@pytest.mark.parametrize(("frames", "told"), [(10, True), (9, False)])
def test_a_rounded_copy_has_ten_frames_in_common(frames: int, *, told: bool) -> None:
    short = replace(ORIGINAL, time_s=TIME[:frames], marks_mm=ORIGINAL.marks_mm[:frames])
    assert bool(copies([short, rounded(short, 0.01)])) == told


def test_of_runs_of_several_lengths_each_has_its_copy() -> None:
    short = replace(ORIGINAL, id="short", time_s=TIME[:100], marks_mm=ORIGINAL.marks_mm[:100])
    runs = [ORIGINAL, short, rounded(short, 0.01, "of short"), rounded(ORIGINAL, 0.01, "of original")]
    assert {item.run: item.seen.split()[5].rstrip(",") for item in copies(runs)} == {
        "of short": "short",
        "of original": "original",
    }
    assert copies(runs[1:2] + runs[3:]) == []
