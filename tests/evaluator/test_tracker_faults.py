"""Places that a tracker repeats for a mark it lost do not count, and marks that it exchanged are put back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from evaluator.errors import InputError
from evaluator.interchange.tracker_faults import mended, without_faults
from evaluator.interchange.tracks import Tracks, read_any_marks
from evaluator.marks import columns_of, write_marks
from evaluator.robot_geometry import read_geometry
from evaluator.workflow.turning_tables import Request, measure_table

NAMES = ("green", "yellow")
ROWS = 200


def table_of(noise_mm: float = 0.005, speed: float = 0.03, digits: int = 5) -> pd.DataFrame:
    """A robot whose marks are 3.66 mm apart, on a straight path, speed in mm per row."""
    noise = np.random.default_rng(2).normal(size=(ROWS, 4)) * noise_mm
    way, zero = speed * np.arange(ROWS), np.zeros(ROWS)
    places = np.column_stack([way, zero + 1.83, way, zero - 1.83]) + noise
    return pd.DataFrame(np.round(places, digits), columns=columns_of(NAMES)).assign(time_s=np.arange(ROWS) / 60)


def hold(table: pd.DataFrame, begin: int, end: int) -> pd.DataFrame:
    columns = columns_of(["yellow"])
    held = table.copy()
    held.loc[begin : end - 1, columns] = held.loc[begin, columns].to_numpy()
    return held


def lost(table: pd.DataFrame) -> list[int]:
    return np.flatnonzero(without_faults(table, NAMES)["yellow_x_mm"].isna()).tolist()


@pytest.mark.parametrize(("begin", "end"), [(60, 190), (100, 130), (0, 150)])
def test_repeated_places_of_a_lost_mark_are_missing_and_counted(begin: int, end: int) -> None:
    table = hold(table_of(), begin, end)
    found, rows = without_faults(table, NAMES), list(range(begin + 1, end))
    assert np.flatnonzero(found["yellow_y_mm"].isna()).tolist() == rows
    assert not found[["green_x_mm", "green_y_mm", "time_s"]].isna().to_numpy().any()
    assert f"yellow in {len(rows)} of {ROWS} rows" in " ".join(found.attrs["faults"])
    assert table["yellow_x_mm"].notna().all()  # the table itself is not changed


@pytest.mark.parametrize(("rows", "missing"), [(3, []), (4, [101, 102, 103])])
def test_four_equal_places_in_a_row_are_repeated_and_three_are_not(rows: int, missing: list[int]) -> None:
    assert lost(hold(table_of(speed=0.5), 100, 100 + rows)) == missing


@pytest.mark.parametrize(("away_mm", "missing"), [(0.08, True), (0.06, False)])
def test_a_mark_is_lost_if_the_distance_of_both_changes_by_more_than_two_percent(
    away_mm: float, *, missing: bool
) -> None:
    """2 % of 3.66 mm are 0.073 mm, by which the other mark goes away from one that stays."""
    table = hold(table_of(noise_mm=0.0, speed=1e-9, digits=12), 100, 121)
    table.loc[100:120, "green_y_mm"] += np.linspace(0, away_mm, 21)
    assert bool(lost(table)) is missing


def test_a_mark_is_lost_if_the_distance_changes_by_more_than_six_sigmas_of_its_noise() -> None:
    """Noise of 0.02 mm in either mark is one of 0.028 mm in their distance, beyond 2 % of which 0.17 mm are."""
    for away_mm, missing in ((0.3, True), (0.11, False)):
        table = table_of(noise_mm=0.02, speed=0.0)
        table.loc[100:104, columns_of(NAMES)] = [0.0, 1.83 + away_mm, 0.0, -1.83]
        assert bool(lost(table)) is missing


def test_a_robot_at_rest_and_one_of_rounded_places_lose_nothing() -> None:
    rest = table_of(noise_mm=0.0, speed=0.0)
    slow = table_of(digits=1)  # places to a tenth of a millimetre, three rows each
    for table in (rest, slow):
        found = without_faults(table, NAMES)
        pd.testing.assert_frame_equal(found, table, check_flags=False)
        assert found.attrs["faults"] == []
    assert without_faults(hold(table_of(), 60, 190), ["green"]).attrs["faults"] == []


def test_marks_of_a_file_are_read_without_repeated_places(tmp_path: Path) -> None:
    path = tmp_path / "marks.csv"
    write_marks(hold(table_of(), 60, 190), path)
    read = read_any_marks(path, Tracks(), marks=NAMES)
    assert read["yellow_x_mm"].isna().sum() == 129
    assert "yellow in 129 of 200 rows" in " ".join(read.attrs["faults"])


def turning(yaw_per_row: float = 0.02) -> pd.DataFrame:
    """A robot on a circle, with standard deviations and states of its marks."""
    heading = yaw_per_row * np.arange(ROWS)
    middle = np.column_stack([20 * np.sin(heading), -20 * np.cos(heading)])
    left = 1.83 * np.column_stack([-np.sin(heading), np.cos(heading)])
    table = pd.DataFrame(np.hstack([middle + left, middle - left]), columns=columns_of(NAMES))
    table = table.assign(time_s=np.arange(ROWS) / 60, green_status="ok", yellow_status="faint")
    return table.assign(green_x_sigma_mm=0.004, yellow_x_sigma_mm=0.006)


def exchange(table: pd.DataFrame, rows: slice) -> pd.DataFrame:
    changed, columns = table.copy(), [name for name in table if str(name).startswith("green")]
    others = [str(name).replace("green", "yellow") for name in columns]
    changed.loc[table.index[rows], columns] = table.loc[table.index[rows], others].to_numpy()
    changed.loc[table.index[rows], others] = table.loc[table.index[rows], columns].to_numpy()
    return changed


@pytest.mark.parametrize("rows", [slice(150, None), slice(60, 120), slice(199, None), slice(0, 80)])
@pytest.mark.parametrize("gap", [0, 20])
def test_marks_that_are_exchanged_midway_are_put_back_with_all_that_is_said_of_them(rows: slice, gap: int) -> None:
    table = turning()
    table.loc[140 : 139 + gap, columns_of(NAMES)] = np.nan
    found = without_faults(exchange(table, rows), NAMES)
    seen = table["green_x_mm"].notna()
    pd.testing.assert_frame_equal(found[seen], table[seen], check_flags=False, check_dtype=False)
    assert "green and yellow are exchanged in" in found.attrs["faults"][0]


def test_marks_that_are_exchanged_twice_are_put_back_both_times() -> None:
    table = turning()
    found = without_faults(exchange(exchange(table, slice(40, 60)), slice(90, 120)), NAMES)
    pd.testing.assert_frame_equal(found, table, check_flags=False, check_dtype=False)


def test_places_of_a_diagnosis_are_put_back_and_repeated_ones_are_missing() -> None:
    table = turning()
    found = mended(exchange(hold(table, 20, 40), slice(90, 120)), NAMES)
    places = table[columns_of(NAMES)].to_numpy().reshape(ROWS, 2, 2)
    repeated = np.arange(21, 40)
    np.testing.assert_array_equal(np.delete(found.places_mm, repeated, axis=0), np.delete(places, repeated, axis=0))
    assert np.isnan(found.places_mm[repeated, 1]).all()
    assert np.flatnonzero(found.exchanged).tolist() == list(range(90, 120))


def test_marks_of_a_file_must_be_those_of_the_robot(tmp_path: Path) -> None:
    path = tmp_path / "marks.csv"
    write_marks(table_of(), path)
    with pytest.raises(InputError, match="front"):
        read_any_marks(path, Tracks(), marks=("front", "back"))


@pytest.mark.parametrize(("times", "notes"), [(0.9, 1), (0.7, 0)])
def test_marks_that_are_a_quarter_too_near_each_other_are_not_exchanged_but_wrong(times: float, notes: int) -> None:
    table = turning()
    green, yellow = (table.loc[100, columns_of([name])].to_numpy(float) for name in NAMES)
    table.loc[100, columns_of(["green"])] = yellow + times * (yellow - green)
    assert len(without_faults(table, NAMES).attrs["faults"]) == notes


@pytest.mark.parametrize(("turned_deg", "exchanged"), [(110.0, 0), (130.0, 80), (-130.0, 80), (-110.0, 0)])
def test_marks_are_exchanged_where_they_turn_at_once_by_a_third_of_a_revolution(
    turned_deg: float, exchanged: int
) -> None:
    """A robot that a hand turns by less between two rows is no exchange of its marks."""
    table = turning()
    green, yellow = (table[columns_of([name])].to_numpy() for name in NAMES)
    middle, half = (green + yellow) / 2, (green - yellow) / 2
    angle = np.radians(turned_deg) * (np.arange(ROWS) >= 120)
    cos, sin = np.cos(angle), np.sin(angle)
    half = np.column_stack([cos * half[:, 0] - sin * half[:, 1], sin * half[:, 0] + cos * half[:, 1]])
    table[columns_of(NAMES)] = np.hstack([middle + half, middle - half])
    assert mended(table, NAMES).exchanged.sum() == exchanged


def test_the_smaller_part_is_put_back() -> None:
    found = without_faults(exchange(turning(), slice(20, None)), NAMES)
    pd.testing.assert_frame_equal(found, exchange(turning(), slice(None)), check_flags=False, check_dtype=False)
    assert "in 20 of 200 rows" in found.attrs["faults"][0]


def test_a_robot_that_turns_while_nothing_is_seen_is_not_exchanged() -> None:
    table = turning(0.1)  # 2 radians in 20 rows, half a revolution in 31
    table.loc[100:130, columns_of(NAMES)] = np.nan
    assert without_faults(table, NAMES).attrs["faults"] == []
    two = turning()
    two.loc[100, columns_of(["green"])] = two.loc[100, columns_of(["yellow"])].to_numpy()  # both on one mark
    assert without_faults(two, NAMES).attrs["faults"] == []


@pytest.mark.parametrize(("robot", "unit"), [(None, "mm"), ("barrel", "mm"), (None, "px")])
def test_turning_of_a_table_puts_marks_back_and_says_so(tmp_path: Path, robot: str | None, unit: str) -> None:
    exchanged = exchange(turning(), slice(150, None)).rename(columns=lambda name: name.replace("_mm", f"_{unit}"))
    write_marks(exchanged, tmp_path / "marks.csv")
    request = Request(robot=None if robot is None else read_geometry(Path(robot)))
    found = measure_table(tmp_path / "marks.csv", request)
    assert any("green and yellow are exchanged in 50 of 200 rows" in line for line in found.lines)
    write_marks(turning().rename(columns=lambda name: name.replace("_mm", f"_{unit}")), tmp_path / "marks.csv")
    assert measure_table(tmp_path / "marks.csv", request).lines == tuple(
        line for line in found.lines if "exchanged" not in line
    )
