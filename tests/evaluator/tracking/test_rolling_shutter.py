"""Rolling shutter: marks at the time of their row against the same motion at the times of the frames."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from evaluator.tracking.rolling_shutter import RollingShutter, of_common_readouts, place_at_frame_time
from evaluator.tracking.settings import TrackingSettings

Array = np.ndarray
SHUTTER = RollingShutter(readout_s=0.02, height_px=481)
TIMES = np.arange(90) / 60.0
SPEED_RAD_S = 4.0  # 100 px radius: 6.7 px a frame


def on_circle(time_s: Array) -> Array:
    return np.stack([320.0 + 100.0 * np.cos(SPEED_RAD_S * time_s), 240.0 + 100.0 * np.sin(SPEED_RAD_S * time_s)], -1)


def as_recorded() -> Array:
    """Places at which a rolling shutter records the mark: its time depends on the row, its row on the time."""
    when = TIMES.copy()
    for _ in range(50):
        when = TIMES + SHUTTER.lag_s(on_circle(when)[:, 1])
    return on_circle(when)


def marks(places: Array) -> Array:
    return np.column_stack([places, np.full((len(places), 2), 0.03**2), np.zeros(len(places))])


def test_marks_lie_where_they_were_when_the_middle_row_was_exposed() -> None:
    values = marks(as_recorded())
    assert np.hypot(*(values[:, :2] - on_circle(TIMES)).T).max() > 1.5
    place_at_frame_time(TIMES, {"green": values}, SHUTTER)
    assert np.hypot(*(values[:, :2] - on_circle(TIMES)).T).max() < 0.02


def test_first_and_last_row_are_half_of_the_readout_from_the_middle_one() -> None:
    np.testing.assert_allclose(SHUTTER.lag_s(np.array([0.0, 240.0, 480.0])), [-0.01, 0.0, 0.01], atol=1e-15)


def test_absent_marks_stay_absent_and_their_neighbours_are_still_moved() -> None:
    values = marks(as_recorded())
    values[[0, 20, 21, 50]] = np.nan
    place_at_frame_time(TIMES, {"green": values}, SHUTTER)
    off = np.hypot(*(values[:, :2] - on_circle(TIMES)).T)
    assert np.flatnonzero(np.isnan(off)).tolist() == [0, 20, 21, 50]
    assert np.nanmax(off) < 0.08


def test_a_centre_whose_speed_is_not_known_is_as_unsure_as_it_may_have_moved() -> None:
    values = marks(as_recorded())
    alone = 45
    values[alone - 9 : alone], values[alone + 1 : alone + 10] = np.nan, np.nan
    before = values[alone].copy()
    place_at_frame_time(TIMES, {"green": values}, SHUTTER)
    np.testing.assert_array_equal(values[alone, :2], before[:2])
    shift = 100.0 * SPEED_RAD_S * abs(SHUTTER.lag_s(before[1:2])[0])
    assert 0.9 * shift < np.sqrt(values[alone, 2] - before[2]) < 1.1 * shift


def test_without_a_rolling_shutter_nothing_moves() -> None:
    values = marks(as_recorded())
    place_at_frame_time(TIMES, {"green": values}, None)
    np.testing.assert_array_equal(values, marks(as_recorded()))


def table(times_as_fast: float = 1.0, sigma: float = 0.05, unit: str = "px", px_per_unit: float = 1.0) -> pd.DataFrame:
    """One mark on its circle, as `track` or `place_on_plate` tells it."""
    places = on_circle(times_as_fast * TIMES)
    columns = {"time_s": TIMES, "green_x_px": places[:, 0], "green_y_px": places[:, 1]}
    columns |= {f"green_{axis}_sigma_{unit}": np.full(len(TIMES), sigma) for axis in "xy"}
    columns |= {f"green_{axis}_{unit}": places[:, k] / px_per_unit for k, axis in enumerate("xy")}
    return pd.DataFrame(columns)


def test_what_common_readouts_would_do_is_what_a_rolling_shutter_does() -> None:
    seen = table()
    found = of_common_readouts(seen, ["green"], SHUTTER.height_px)
    assert found is not None
    apart = np.hypot(*(as_recorded() - on_circle(TIMES)).T)[3:-3]
    assert 1e3 * SHUTTER.readout_s * found.shift == pytest.approx(np.sqrt((apart**2).mean()), rel=0.03)
    assert found.over_stated == pytest.approx(10 * found.shift / 0.05)
    assert f"by {10 * found.shift:.2g} to {30 * found.shift:.2g} px (RMS)" in found.note
    assert "readout_ms" in found.note


def test_on_the_plate_the_shift_is_told_in_micrometres() -> None:
    px, mm = (
        of_common_readouts(table(**given), ["green"], 481)
        for given in ({}, {"unit": "mm", "px_per_unit": 12.0, "sigma": 0.004})
    )
    assert px is not None
    assert mm is not None
    assert mm.shift == pytest.approx(px.shift / 12.0 * 1e3)
    assert " µm (RMS)" in mm.note


def test_slow_marks_unsure_marks_and_marks_that_are_never_seen_need_no_shutter() -> None:
    assert of_common_readouts(table(0.1), ["green"], 481) is None
    assert of_common_readouts(table(sigma=0.5), ["green"], 481) is None
    assert of_common_readouts(table(sigma=np.nan), ["green"], 481) is None
    assert of_common_readouts(table().head(4), ["green"], 481) is None


@pytest.mark.parametrize("place_px", [1e200, 1e308, -1e308])
@pytest.mark.filterwarnings("error")
def test_a_place_far_from_every_image_ends_in_no_warning(place_px: float) -> None:
    """A file of corrections may hold any number."""
    seen = table()
    seen.loc[40, ["green_x_px", "green_y_px"]] = place_px
    seen.loc[46, ["green_x_px", "green_y_px"]] = -place_px
    of_common_readouts(seen, ["green"], SHUTTER.height_px)


@pytest.mark.parametrize(("said", "stated"), [({}, False), ({"readout_ms": 0.0}, True), ({"readout_ms": 16.0}, True)])
def test_a_readout_of_zero_states_a_global_shutter(said: dict[str, float], stated: bool) -> None:
    assert TrackingSettings(**said).shutter_stated == stated
