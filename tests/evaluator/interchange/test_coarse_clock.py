"""Even frames whose times a coarse clock told."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

from evaluator.interchange.tracker_faults import mended, without_faults
from evaluator.recording.coarse_clock import FEWEST_FRAMES, even_times

OF_COMPUTER_S = 1 / 64


def frames(rate_hz: float, lost: Sequence[int] = (), count: int = 300) -> NDArray[np.float64]:
    """Times of even frames, s, without some."""
    return 0.3037 + np.delete(np.arange(count), lost) / rate_hz


def told(time_s: NDArray[np.float64], step_s: float, places: int = 9) -> NDArray[np.float64]:
    """Times as a clock tells them that moves in steps, written with so many decimal places."""
    return np.round(np.floor(time_s / step_s + 1e-9) * step_s, places)


@pytest.mark.parametrize("lost", [(), (50, 51, 120)])
@pytest.mark.parametrize(
    ("rate_hz", "step_s"),
    [(24, OF_COMPUTER_S), (30, OF_COMPUTER_S), (30, 0.01), (29.97, 1e-3), (60, 0.01), (60, 1e-3), (240, 1e-3)],
)
def test_even_frames_are_found_from_the_times_of_a_coarse_clock(
    rate_hz: float, step_s: float, lost: Sequence[int]
) -> None:
    true = frames(rate_hz, lost)
    found = even_times(told(true, step_s))
    assert found is not None
    assert found[1] == pytest.approx(step_s)
    late = true - found[0]
    assert np.std(late) < 0.05 * step_s  # stamps themselves scatter by 0.29
    assert 0.3 * step_s < late.mean() < 0.7 * step_s
    assert np.std(true - told(true, step_s)) > 4 * np.std(late)


@pytest.mark.parametrize(("places", "within"), [(3, 0.02), (4, 0.005), (6, 1e-4)])
def test_steps_of_a_computer_are_known_from_rounded_times(places: int, within: float) -> None:
    true = frames(30)
    found = even_times(told(true, OF_COMPUTER_S, places))
    assert found is not None
    assert found[1] == pytest.approx(OF_COMPUTER_S, rel=within)
    assert np.std(true - found[0]) < 1e-4


def test_steps_as_long_as_the_interval_are_those_of_a_computer_or_lost_frames() -> None:
    true = frames(60)
    found = even_times(told(true, OF_COMPUTER_S))
    assert found is not None
    assert np.std(true - found[0]) < 5e-4
    for every in (3, 7, 10):  # one frame lost in so many
        kept = frames(60, range(0, 300, every))
        assert even_times(np.round(kept, 6)) is None
        rounded = even_times(np.round(kept, 3))
        assert rounded is None or np.std(kept - rounded[0]) < 5e-4


@pytest.mark.parametrize("scatter_s", [1e-3, 3e-3])
@pytest.mark.parametrize("places", [3, 6])
def test_frames_that_are_not_even_keep_their_times(scatter_s: float, places: int) -> None:
    random = np.random.default_rng(3).normal(0.0, scatter_s, 300)
    assert even_times(np.unique(np.round(np.sort(frames(60) + random), places))) is None


def test_a_camera_that_changes_its_rate_keeps_its_times() -> None:
    steps = np.r_[np.full(150, 1 / 30), np.full(150, 1 / 29)]
    assert even_times(told(0.3 + np.cumsum(steps), OF_COMPUTER_S)) is None


def test_fine_times_and_few_frames_stay_as_they_are() -> None:
    assert even_times(told(frames(29.97), 3e-4)) is None  # wrong by half a step, 0.0045 of the interval
    assert even_times(told(frames(29.97), 4e-4)) is not None
    assert even_times(told(frames(50), 1e-6)) is None
    assert even_times(np.arange(100) * 0.02) is None  # rounded to 0.01 s, and even
    assert even_times(told(frames(30, count=FEWEST_FRAMES - 1), OF_COMPUTER_S)) is None
    assert even_times(told(frames(30, count=FEWEST_FRAMES), OF_COMPUTER_S)) is not None
    assert even_times(np.r_[told(frames(30), OF_COMPUTER_S), 5.0]) is None  # not rising


def test_a_table_of_a_coarse_clock_is_taken_evenly_and_it_is_said() -> None:
    true = frames(30)
    table = pd.DataFrame({"time_s": told(true, OF_COMPUTER_S), "green_x_mm": 1.3 * true, "green_y_mm": 0.2})
    said = "time_s is told in steps of 15.6 ms by a coarse or rounded clock; the frames lie evenly, 33.33 ms apart"
    found, changed = mended(table, ["green"]), without_faults(table, ["green"])
    assert found.clock_step_s == OF_COMPUTER_S
    assert [note for note in found.notes if note.startswith(said)] == changed.attrs["faults"] == found.notes
    assert np.array_equal(changed["time_s"], found.time_s)
    assert np.std(found.time_s - true) < 1e-4
    assert table["time_s"].to_numpy() == pytest.approx(told(true, OF_COMPUTER_S))  # the table given is not changed
    fine = mended(table.assign(time_s=true), ["green"])
    assert (fine.clock_step_s, fine.notes) == (0.0, [])
    assert np.array_equal(fine.time_s, true)
