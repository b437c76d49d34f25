"""Levels of sessions, what all commands say together, and the comparison of two stretches: worked out by hand."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from evaluator.trends.changes import Level, _change, _windows, changes
from evaluator.trends.series import find_series
from evaluator.trends.sessions import Session, read_session
from evaluator.trends.trends import Trends


def written(folder: Path, effects: object = None) -> Path:
    """Two backward repetitions of one command and a run of another, placed by a camera."""
    rows = {
        "run": ["r1", "r2", "r3", "r4"],
        "left_rpm": [-33.3, -33.3, 20.0, 50.0],
        "right_rpm": [-14.4, -14.4, 20.0, 10.0],
        "group": ["dry", "dry", None, None],
        "radius_mm": [8.0, 8.2, np.nan, np.nan],
        "radius_random_mm": [0.01, 0.01, np.nan, np.nan],
        "radius_systematic_mm": [0.020, 0.0205, np.nan, np.nan],  # 3-4-5: the camera's are 0.016 and 0.0164
        "radius_by_marks_mm": [0.012, 0.0123, np.nan, np.nan],  # the same in every session of the robot
        "curvature_per_mm": [0.125, 0.122, 1e-4, np.nan],
        "curvature_low_per_mm": [0.12, 0.12, 0.8e-4, np.nan],
        "curvature_high_per_mm": [0.13, 0.13, 1.2e-4, np.nan],
        "speed_mm_s": [-2.0, -2.2, 1.5, np.nan],
        "speed_sigma_mm_s": [0.02, 0.02, 0.03, np.nan],
    }
    pd.DataFrame(rows).to_csv(folder / "turning.csv", index=False)
    made = {"settings": {"name": "n", "date": "2026-03-12", "camera": "c.json"}, "inputs_sha256": {"c.json": "abc"}}
    (folder / "provenance.json").write_text(json.dumps(made))
    if effects is not None:
        (folder / "diagnosis.json").write_text(json.dumps(effects))
    return folder


def test_level_of_a_command_is_the_mean_of_its_runs_with_the_share_of_its_radii_that_the_camera_leaves_open(
    tmp_path: Path,
) -> None:
    found = read_session(written(tmp_path))
    assert set(found.levels) == {
        *(
            "radius, -33.3 / -14.4 rpm dry",
            "speed, -33.3 / -14.4 rpm dry",
            "curvature, 20 / 20 rpm",
            "speed, 20 / 20 rpm",
        )
    }
    radius, speed = (found.levels[f"{name}, -33.3 / -14.4 rpm dry"] for name in ("radius", "speed"))
    # Of two values the standard error is half of their difference; two thousandths are the camera's.
    assert (radius.value, radius.error, radius.freedom, radius.systematic) == pytest.approx((8.1, 0.1, 1.0, 0.0162))
    assert (speed.value, speed.error, speed.systematic) == pytest.approx((2.1, 0.1, 0.0042))
    assert (radius.source, found.units["radius, -33.3 / -14.4 rpm dry"]) == ("abc", "mm")
    alone = found.levels["speed, 20 / 20 rpm"]
    assert (alone.value, alone.error, alone.freedom, alone.systematic) == (1.5, 0.03, np.inf, 0.0)
    assert radius.repeated
    assert not alone.repeated
    straight = found.levels["curvature, 20 / 20 rpm"]
    assert (straight.value, straight.error) == pytest.approx((0.1, 0.02 / 1.96), rel=1e-4)
    assert found.units["speed, 20 / 20 rpm"] == "mm/s"


@pytest.mark.parametrize(("verdict", "count"), [("effect", 1), ("unknown", 0)])
def test_size_of_a_named_effect_is_known_to_a_quarter_of_its_interval(tmp_path: Path, verdict: str, count: int) -> None:
    parameters = {"deg_per_mN": {"value": 1.1, "low": 0.9, "high": 1.292}}
    said = {"verdict": verdict, "effects": [{"id": "axle-compliance", "parameters": parameters}]}
    found = read_session(written(tmp_path, said)).levels
    named = [level for name, level in found.items() if name == "axle-compliance, deg_per_mN"]
    assert len(named) == count
    for level in named:
        assert (level.value, level.error, level.freedom) == pytest.approx((1.1, 0.1, np.inf))


def session(name: str, **levels: Level) -> Session:
    found = {f"{quantity}, {command}": level for command, level in levels.items() for quantity in ("radius",)}
    return Session(name, Path(name), None, found, dict.fromkeys(found, "mm"))


def level(value: float, error: float = 0.01, **more: float) -> Level:
    return Level(value, error, 3.0, **more)  # type: ignore[arg-type]


def test_all_turns_together_are_percents_of_their_own_means_over_the_sessions() -> None:
    """4 and 10 mm in the mean; of a third session one command is missing, and what not all have is left out."""
    sessions = [
        session("a", one=level(3.8, systematic=0.038), two=level(10.0), three=level(1.0)),
        session("b", one=level(4.2, systematic=0.042), two=level(10.0)),
    ]
    series = find_series(sessions)
    assert [(item.name, item.unit) for item in series] == [
        ("all turns together, radius", "%"), ("radius, one", "mm"), ("radius, two", "mm"),
    ]  # fmt: skip
    first, second = series[0].levels
    assert (first.value, second.value) == pytest.approx((97.5, 102.5), rel=1e-3)
    assert first.freedom == 1.0
    assert first.error == pytest.approx(2.5, rel=0.01)  # 95 and 100 %: half of their difference
    assert (first.systematic, second.systematic) == pytest.approx((1.0, 1.0))
    assert find_series([session("a", one=level(4.0)), session("b", one=level(4.0))])[0].name == "radius, one"


def test_table_has_the_bounds_of_every_level_and_where_a_change_begins() -> None:
    sessions = [session(f"s{k}", one=level(value)) for k, value in enumerate([10.0, 10.01, 9.99, 10.5, 10.51, 10.49])]
    table = Trends(tuple(sessions), find_series(sessions)).table()
    assert table["changed"].tolist() == [False, False, False, True, False, False]
    reach = stats.t.ppf(0.975, 3) * 0.01
    np.testing.assert_allclose(table["high"] - table["value"], reach)
    np.testing.assert_allclose(table["value"] - table["low"], reach)
    assert table["session"].tolist() == [f"s{k}" for k in range(6)]


def test_both_stretches_scatter_alike_from_session_to_session() -> None:
    """10.5, 10.6 and 10.7 scatter by 0.1, of which 0.01 is noise; the single session is then known to 0.1 in all."""
    found = _change([level(10.0)], [level(10.5), level(10.6), level(10.7)], 1)
    assert (found.before.error, found.before.freedom) == pytest.approx((0.1, 2.0))
    assert found.after.error == pytest.approx(0.1 / np.sqrt(3))
    error = np.hypot(0.1, 0.1 / np.sqrt(3))
    assert found.p == pytest.approx(2 * stats.t.sf(0.6 / error, 2))
    half = stats.t.ppf(0.975, 2) * error
    assert (found.difference, found.low, found.high) == pytest.approx((0.6, 0.6 - half, 0.6 + half))
    first, second = np.array([10.0, 10.2]), np.array([10.5, 10.6, 10.7])
    found = _change([level(value, 0.0) for value in first], [level(value, 0.0) for value in second], 2)
    assert found.p == pytest.approx(stats.ttest_ind(first, second).pvalue)


def test_two_sessions_are_compared_by_the_scatter_of_their_runs_if_there_is_one() -> None:
    two = _change([level(10.0)], [level(10.5)], 1)
    assert (two.before.error, two.before.freedom) == (0.01, 3.0)
    assert two.p == pytest.approx(2 * stats.t.sf(0.5 / np.hypot(0.01, 0.01), 6))
    once = Level(10.5, 0.01, np.inf, repeated=False)
    assert not _change([level(10.0)], [once], 1).p < 1
    assert changes([level(10.0), once], 1) == ()


@pytest.mark.parametrize(("sources", "error"), [(("a", "a"), 0.01), (("a", "b"), np.hypot(0.01, 0.3))])
def test_what_two_stretches_share_cancels(sources: tuple[str, str], error: float) -> None:
    one, other = ([Level(value, 0.01, 3.0, 0.3, source)] for value, source in zip((10.0, 10.5), sources, strict=True))
    found = _change(one, other, 1)
    assert (found.before.error, found.after.error) == pytest.approx((error, error))


@pytest.mark.parametrize("count", [2, 3, 4, 7, 16, 41])
def test_windows_of_each_length_overlap_by_half_down_to_three_sessions_or_the_only_two(count: int) -> None:
    windows = _windows(count)
    lengths = sorted({stop - start for start, stop in windows}, reverse=True)
    assert (0, count) in windows
    assert lengths[-1] == min(count, 3)
    assert all(one / other < 2 for one, other in pairwise(lengths))
    assert [stop - start for start, stop in windows] == sorted(stop - start for start, stop in windows)
    for length in lengths:
        starts = [start for start, stop in windows if stop - start == length]
        assert (starts[0], starts[-1]) == (0, count - length)
        assert all(later - earlier <= length / 2 + 1 for earlier, later in pairwise(starts))
    assert _windows(1) == _windows(0) == []
