"""Trends: changes of level over sessions are found where they are, and not where sessions merely scatter."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from evaluator.cli.measurement.trends import trends as command
from evaluator.errors import InputError
from evaluator.trends.changes import Level, changes
from evaluator.trends.trends import compare_sessions

FOUR_RUNS = 3.0  # degrees of freedom


def levels(values: list[float], error: float = 0.01, **more: object) -> list[Level]:
    return [Level(value, error, FOUR_RUNS, **more) for value in values]  # type: ignore[arg-type]


def test_a_step_is_found_where_it_is_with_its_size() -> None:
    (found,) = changes(levels([10.0, 10.01, 9.99, 10.5, 10.51, 10.49]), 1)
    assert found.at == 3
    assert found.difference == pytest.approx(0.5, abs=1e-9)
    assert found.low < 0.5 < found.high


def test_a_change_lies_where_the_narrowest_window_that_shows_it_says() -> None:
    # Cut after the first value the whole series differs as surely, as what follows then scatters most.
    (found,) = changes([Level(value, 0.3, 50.0) for value in (-0.7, 1.2, 6.2, 5.9, 6.3, 6.6)], 1)
    assert found.at == 2


def test_two_steps_are_measured_between_their_neighbours() -> None:
    found = changes(levels([10.0, 10.01, 9.99, 11.0, 11.01, 10.99, 10.0, 10.01, 9.99]), 1)
    assert [change.at for change in found] == [3, 6]
    assert [change.difference for change in found] == pytest.approx([1.0, -1.0], abs=1e-9)


def test_a_session_without_the_quantity_is_passed_over() -> None:
    (found,) = changes(levels([10.0, 10.01, float("nan"), 9.99, 10.5, 10.51, 10.49]), 1)
    assert found.at == 4


def test_sessions_that_scatter_have_no_change() -> None:
    rng = np.random.default_rng(20)
    false = 0
    for _ in range(60):
        scatter = rng.choice([0.0, 0.02, 0.2])
        truth = 10 + scatter * rng.standard_normal(8)
        runs = truth[:, None] + 0.02 * rng.standard_normal((8, 4))
        series = [
            Level(value, error, FOUR_RUNS)
            for value, error in zip(runs.mean(axis=1), runs.std(axis=1, ddof=1) / 2, strict=True)
        ]
        false += bool(changes(series, 1))
    assert false <= 60 * 0.135  # 5 % promised: 3.0 ± 1.7; three standard deviations above


def test_what_another_camera_leaves_open_is_no_change() -> None:
    before = levels([10.0, 10.01, 9.99], systematic=0.5, source="first")
    assert changes([*before, *levels([10.5, 10.51, 10.49], systematic=0.5, source="first")], 1)
    assert not changes([*before, *levels([10.5, 10.51, 10.49], systematic=0.5, source="second")], 1)


def test_what_many_series_together_show_by_chance_is_no_change() -> None:
    step = levels([0.0, 0.5, -0.5, 0.1, 6.0, 6.5, 5.5, 6.1], error=0.2)
    (found,) = changes(step, series=1200)
    assert found.at == 4
    assert changes(step, series=2200) == ()  # 5 % are shared among them: enough for up to 1640


def test_an_interval_of_a_session_reaches_to_the_quantile_of_student() -> None:
    assert Level(10.0, 0.5, 10.0).reach == pytest.approx(2.22814 * 0.5, rel=1e-5)


def session(folder: Path, day: str | None, radius: float, speed: float = 1.0, effect: float | None = None) -> Path:
    """Results of three repetitions of two turns, as `turnscope analyze` leaves them."""
    folder.mkdir()
    rng = np.random.default_rng(int(radius * 1000))
    rows = [
        {
            "run": f"r{run}",
            "left_rpm": left,
            "right_rpm": 14.4,
            "radius_mm": factor * (radius + 0.003 * rng.standard_normal()),
            "radius_random_mm": 0.002,
            "radius_systematic_mm": 0.001,
            "speed_mm_s": speed + 0.0005 * rng.standard_normal(),
            "speed_random_mm_s": 0.0002,
            "group": "",
        }
        for run, (left, factor) in enumerate([(33.3, 1.0), (25.0, 2.0)] * 3)
    ]
    pd.DataFrame(rows).to_csv(folder / "turning.csv", index=False)
    settings = {"name": f"session <{folder.name}>"} | ({"date": day} if day else {})
    (folder / "provenance.json").write_text(json.dumps({"settings": settings, "inputs_sha256": {}}))
    if effect is not None:
        parameters = {"deg_per_mN": {"value": effect, "low": effect - 0.1, "high": effect + 0.1}}
        said = {"verdict": "effect", "effects": [{"id": "axle-compliance", "parameters": parameters}]}
        (folder / "diagnosis.json").write_text(json.dumps(said))
    return folder


def test_a_change_between_days_is_named_with_its_date_on_page_and_terminal(tmp_path: Path) -> None:
    days = ["2026-03-19", "2026-03-01", "2026-03-12", "2026-03-02"]  # not in order: the dates are
    radii = {"2026-03-01": 15.0, "2026-03-02": 15.001, "2026-03-12": 15.3, "2026-03-19": 15.299}
    folders = [session(tmp_path / day, day, radii[day], effect=1.1) for day in days]
    found = compare_sessions(folders)
    assert [one.day.isoformat() for one in found.sessions if one.day] == sorted(days)
    changed = {series.name: [change.at for change in series.changes] for series in found.series}
    assert changed["all turns together, radius"] == [2]
    assert changed["radius, 33.3 / 14.4 rpm"] == [2]
    assert changed["speed, 33.3 / 14.4 rpm"] == []
    assert changed["axle-compliance, deg_per_mN"] == []
    page = tmp_path / "trends.html"
    done = CliRunner().invoke(command, [*map(str, folders), "-o", str(page)])
    assert done.exit_code == 0, done.output
    assert "Radius, 33.3 / 14.4 rpm: 15.29" in done.output
    html = page.read_text(encoding="utf-8")
    assert "session &lt;2026-03-12&gt;" in html
    assert "session <" not in html
    table = pd.read_csv(tmp_path / "trends.csv")
    assert set(table.loc[table["changed"], "date"]) == {"2026-03-12"}


def test_folders_that_cannot_be_compared_are_refused_in_one_sentence(tmp_path: Path) -> None:
    dated, undated = session(tmp_path / "a", "2026-03-01", 15.0), session(tmp_path / "b", None, 15.0)
    with pytest.raises(InputError, match="at least two"):
        compare_sessions([dated])
    with pytest.raises(InputError, match="a: is given twice; a session is compared with others"):
        compare_sessions([dated, undated, tmp_path / "b" / ".." / "a"])
    with pytest.raises(InputError, match="b: its experiment has no date"):
        compare_sessions([dated, undated])
    with pytest.raises(InputError, match=r"no turning\.csv"):
        compare_sessions([dated, tmp_path])
    (undated / "provenance.json").write_text("{")
    with pytest.raises(InputError, match="b: its results cannot be read"):
        compare_sessions([dated, undated])
    other = shutil.copytree(dated, tmp_path / "c")
    table = pd.read_csv(other / "turning.csv")
    table.assign(left_rpm=table["left_rpm"] + 1).to_csv(other / "turning.csv", index=False)
    with pytest.raises(InputError, match="no command was driven in two"):
        compare_sessions([dated, other])
