"""What figures of whole pages draw: circular test, trends, the paper's turns, slip curves, and plots for notebooks."""

from __future__ import annotations

from datetime import date
from math import nan
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pandas as pd
import pytest

from calibration.camera import camera_above
from evaluator.report import plots
from evaluator.report.figures import paper_slip, paper_turns
from evaluator.report.pages import circular_test, trends
from evaluator.report.pages.colors import GREEN, INK, PURPLE
from evaluator.report.style import MEASURED, SIMULATED
from evaluator.trends.changes import Change, Level
from evaluator.trends.series import Series
from evaluator.trends.sessions import Session
from evaluator.turning.circular_test import Estimate
from evaluator.turning.circular_test import Series as Turns
from tests.evaluator.report.shown import labels, lines, undrawn


def circle_tests(factor: float) -> Any:
    """A circular test of two series with runs of 10 and 20 mm radius; one run belongs to neither."""
    series = [
        Turns("constant command", "forward", side, 0.5, ("a",), Estimate(factor, factor, factor), curvature_per_mm=slow)
        for side, slow in (("left", 0.2), ("right", 0.1))
    ]
    points = pd.DataFrame(
        {
            "run": ["a", "b", "c"], "series": [0, 1, -1], "radius_mm": [10 * factor, 20 * factor, 1.0],
            "sideslip_deg": [2 * factor, 3 * factor, 1.0], "lateral_acceleration_mm_s2": [0.5 * factor, 0.7, 0.1],
            "speed_mm_s": 1.0, "yaw_rate_deg_s": 1.0,
        }
    )  # fmt: skip
    return SimpleNamespace(series=tuple(series), points=points)


def test_a_circular_test_is_drawn_relative_to_its_slow_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    axes = [MagicMock(), MagicMock()]
    undrawn(monkeypatch, circular_test)
    drawing: Any = MagicMock()
    drawing.return_value.__enter__.return_value = MagicMock(axes=axes, svg="")
    monkeypatch.setattr(circular_test, "drawing", drawing)
    found = circular_test.circular_test_section(
        SimpleNamespace(measured=circle_tests(1.0), simulated=circle_tests(1.1), out=None)
    )  # type: ignore[arg-type]
    assert found is not None
    assert drawing.call_args.kwargs["columns"] == 2
    for drawn, wanted in zip(lines(axes[0]), (([0.5, 0.7], [2.0, 2.0]), ([0.55, 0.7], [2.2, 2.2])), strict=True):
        np.testing.assert_allclose(drawn, wanted)
    for drawn, wanted in zip(lines(axes[1]), (([0.5, 0.7], [2.0, 3.0]), ([0.55, 0.7], [2.2, 3.3])), strict=True):
        np.testing.assert_allclose(drawn, wanted)
    assert [call.kwargs["label"] for call in axes[0].plot.call_args_list] == ["measured", "simulated"]
    assert (axes[0].axhline.call_args.args, axes[1].axhline.call_args.args) == ((1,), (0,))
    words = ("radius / radius of slow turns", "sideslip at the centre, out of the turn, °")
    assert [labels(each) for each in axes] == [("lateral acceleration, mm/s²", word) for word in words]
    rows = found.tables[0].rows
    assert [row[1::2][:2] for row in rows] == [
        *(("forward, left", "measured"), ("forward, left", "simulated")),
        *(("forward, right", "measured"), ("forward, right", "simulated")),
    ]
    assert [row[4] for row in rows[:2]] == ["1.000 (1.000 to 1.000)", "1.100 (1.100 to 1.100)"]
    for measured in (None, SimpleNamespace(series=(), points=None)):
        nothing: Any = SimpleNamespace(measured=measured, simulated=circle_tests(1.0))
        assert circular_test.circular_test_section(nothing) is None


def mean(value: float, half: float) -> Any:
    return SimpleNamespace(mean=value, low=value - half, high=value + half)


@pytest.fixture
def moved() -> Any:
    """Three sessions; the radius changed before the second, by more than the size of an effect, which is in two."""
    change = Change(1, mean(10.0, 0.1), mean(9.5, 0.2), -0.5, -0.62, -0.38, 0.00123)
    levels = tuple(Level(value, 0.05, 1e9) for value in (10.0, 9.5, 9.4))
    radius = Series("radius, 30 / -20 rpm", "mm", levels, (change,))
    all_turns = Series("all turns together, radius", "%", levels, ())
    size = Series("plate-tilt, angle", "°", (Level(nan, nan, nan), *levels[1:]), ())
    days = (date(2026, 3, 1), date(2026, 3, 2), None)
    sessions = tuple(Session(f"s{k}", Path(f"out/s{k}"), day, {}) for k, day in enumerate(days))
    found: Any = SimpleNamespace(
        sessions=sessions, series=(all_turns, radius, size), table=lambda: pd.DataFrame({"a": [1]})
    )
    return found


def test_levels_are_drawn_as_bands_between_the_changes_of_a_series(monkeypatch: pytest.MonkeyPatch, moved: Any) -> None:
    axes = undrawn(monkeypatch, trends)
    found = trends._figure(moved, moved.series[1])
    bands = [call.args for call in axes[0].fill_between.call_args_list]
    assert bands == [([-0.5, 0.5], 9.9, 10.1), ([0.5, 2.5], 9.3, 9.7)]
    assert lines(axes[0]) == [([-0.5, 0.5], [10.0, 10.0]), ([0.5, 2.5], [9.5, 9.5])]
    axes[0].axvline.assert_called_once()
    assert axes[0].axvline.call_args.args == (0.5,)
    places, values = axes[0].errorbar.call_args.args
    assert (places.tolist(), values.tolist()) == ([0, 1, 2], [10.0, 9.5, 9.4])
    np.testing.assert_allclose(axes[0].errorbar.call_args.kwargs["yerr"], 1.96 * 0.05, rtol=1e-3)
    assert axes[0].set_xticks.call_args.args[1] == ["2026-03-01", "2026-03-02", "s2"]
    assert axes[0].set_xlim.call_args.args == (-0.5, 2.5)
    assert axes[0].set_ylabel.call_args.args == ("radius, mm",)
    assert found.title == "Radius, 30 / −20 rpm"
    assert found.caption.endswith(
        "9.50 mm since 2026-03-02 (s1), 10.00 mm before; the change is −0.62 to −0.38 mm (95 %)."
    )
    np.testing.assert_allclose(found.data["high"] - found.data["low"], 2 * 1.96 * 0.05, rtol=1e-3)
    unchanged = trends._figure(moved, moved.series[0])
    assert axes[1].set_ylabel.call_args.args == ("mean of its command, %",)
    assert unchanged.caption.endswith("No change.")
    assert not axes[1].fill_between.called


def test_changes_stand_in_a_table_and_in_sentences_and_radii_come_before_effects(
    monkeypatch: pytest.MonkeyPatch, moved: Any
) -> None:
    undrawn(monkeypatch, trends)
    names = [(section.name, len(section.figures)) for section in trends._sections(moved)]
    assert names == [("trend-radius", 2), ("trend-plate-tilt", 1)]
    (table,) = trends._changes(moved).tables
    assert table.rows == (
        *(("radius, 30 / −20 rpm", "2026-03-02", "10.00 mm", "9.50 mm", "−0.50 mm", "−0.62 to −0.38", "0.001"),),
    )
    assert trends._changes(SimpleNamespace(series=(moved.series[0],), sessions=moved.sessions)).tables == ()  # type: ignore[arg-type]
    assert trends._sessions(moved).tables[0].rows == (
        *(("s0", "2026-03-01", "out/s0"), ("s1", "2026-03-02", "out/s1"), ("s2", "–", "out/s2")),
    )
    first, last = trends.change_sentences(moved)
    assert first.startswith("Radius, 30 / −20 rpm: 9.50 mm since 2026-03-02 (s1), 10.00 mm before;")
    assert last == "3 quantities over 3 sessions were compared; the probability of any false change is 5 %."
    moved.series = moved.series[:1]
    assert trends.change_sentences(moved) == ("No significant change; 1 quantity over 3 sessions was compared.",)
    assert trends._when(moved, 2) == "since s2"


def test_turns_of_the_paper_are_drawn_with_ours_and_the_published_radius(monkeypatch: pytest.MonkeyPatch) -> None:
    axes = undrawn(monkeypatch, paper_turns)
    circles = pd.DataFrame({"case": ["9a", "9a", "9b", "9b"], "x_mm": [0.0, 1, 2, 3], "y_mm": [-2.0, 6.0, 1.0, 2.0]})
    found = paper_turns.trajectory_figure("9", circles, {"9a": 4.5, "9b": 7.0})
    assert lines(axes[0]) == [([0.0, 1.0], [-2.0, 6.0]), ([2.0, 3.0], [1.0, 2.0]), ([0], [0])]
    said = [call.kwargs["label"] for call in axes[0].plot.call_args_list]
    assert said == ["a: 4.00 mm (paper 4.5)", "b: 0.50 mm (paper 7)", "start, heading right"]
    assert "shared" in found.title
    assert "growing" in paper_turns.trajectory_figure("10", circles, {"9a": 1.0, "9b": 1.0}).title
    assert labels(axes[0]) == ("x, mm", "y, mm")
    paper_turns.speed_figure(pd.DataFrame({"rpm": [10.0], "speed_mm_s": [0.5]}), 0.05, 0.01)
    np.testing.assert_allclose(lines(axes[2])[0], ([0, 105], [0.01, 5.26]))
    assert lines(axes[2])[1] == ([10.0], [0.5])
    table = pd.DataFrame({"ratio": [0.1, 0.5], "radius_mm": [80.0, 7.0]})
    paper_turns.ratio_figure(table, (2.5, -1.5), (2.0, -1.0))
    assert lines(axes[3])[0] == ([0.1, 0.5], [80.0, 7.0])
    for (ratio, radius), factor, exponent in zip(lines(axes[3])[1:], (2.5, 2.0), (-1.5, -1.0), strict=True):
        assert (ratio[0], ratio[-1], len(ratio)) == (0.1, pytest.approx(0.7), 121)
        np.testing.assert_allclose(radius, factor * np.power(ratio, exponent))
    assert axes[3].plot.call_args_list[1].kwargs["label"] == "paper: 2.5000 $r^{-1.5000}$"
    assert axes[3].plot.call_args_list[2].kwargs["label"] == "ours: 2.0000 $r^{-1.0000}$"
    assert axes[3].set_xlabel.call_args.args == ("ratio r of the difference to the left wheel",)


def test_curves_of_the_paper_have_a_line_for_each_of_their_cases(monkeypatch: pytest.MonkeyPatch) -> None:
    axes = undrawn(monkeypatch, paper_turns)
    tire = pd.DataFrame({"wheel": ["tire", "magnetic"] * 2, "right_rpm": [60, 60, 70, 70], "radius_mm": [4.0, 3, 2, 1]})
    paper_turns.tire_figure(tire)
    assert lines(axes[0]) == [([60, 70], [4.0, 2.0]), ([60, 70], [3.0, 1.0])]
    assert [call.kwargs["label"] for call in axes[0].plot.call_args_list] == ["tire", "magnetic"]
    speeds = [20, 25, 30, 35, 40, 45, 50]
    turning = pd.DataFrame({"left_rpm": speeds * 2, "difference_rpm": [5] * 7 + [10] * 7, "radius_mm": range(14)})
    paper_turns.difference_figure(turning)
    assert lines(axes[1])[0] == ([5, 10], [0, 7])
    assert [call.kwargs["label"] for call in axes[1].plot.call_args_list] == [f"{speed} rpm" for speed in speeds]
    assert labels(axes[1]) == ("difference of rotational frequency, rpm", "minimum turning radius, mm")
    rows = [
        (number, wheel, 4.0 if number == "18" else 19.0, 60.0 + len(wheel))
        for number in ("18", "22")
        for wheel in ("barrel", "column")
    ]
    prototype = pd.DataFrame(rows, columns=["figure", "wheel", "difference_rpm", "radius_mm"])
    paper_turns.prototype_figure(prototype)
    calls = axes[2].plot.call_args_list
    assert [call.kwargs["label"] for call in calls] == [
        *("barrel, 33 rpm left", "column, 33 rpm left", "barrel, 33.3 rpm left", "column, 33.3 rpm left"),
    ]
    assert [call.kwargs["ls"] for call in calls] == ["-", "--", "none", "none"]
    assert [call.kwargs["marker"] for call in calls] == ["s", "o", "D", "D"]
    assert lines(axes[2])[3] == ([19.0], [66.0])


def test_forces_of_a_bench_have_two_sigmas_and_the_color_of_their_curve(monkeypatch: pytest.MonkeyPatch) -> None:
    axes = undrawn(monkeypatch, paper_slip)
    names = ["panel", "slip_ratio", "slip_angle_deg", "longitudinal", "lateral"]
    curves = pd.DataFrame(
        [("a", 0.5, 15.0, 0.2, 9.0), ("a", 0.5, 0.0, 0.3, 9.0), ("b", 0.4, 30.0, 9.0, 0.6)], columns=names
    )
    points = pd.DataFrame(
        {
            "slip_ratio": [0.1, -0.39, 0.62], "slip_angle_deg": [0.0, 15.0, 15.0], "longitudinal": [0.1, 0.2, 0.3],
            "longitudinal_sigma": 0.01, "lateral": [nan, 0.5, 0.6], "lateral_sigma": 0.02,
        }
    )  # fmt: skip
    first, second = paper_slip.slip_figures("f-", "title", "caption", curves, points)
    assert (first.name, first.title, second.name, second.title) == (
        *("f-a", "title, longitudinal", "f-b", "title, lateral"),
    )
    assert lines(axes[0]) == [([0.5], [0.3]), ([0.5], [0.2])]  # by their angle
    assert [call.kwargs["label"] for call in axes[0].plot.call_args_list] == ["0°", "15°"]
    assert [call.kwargs["color"] for call in axes[0].plot.call_args_list] == list(paper_slip.COLORS[:2])
    assert lines(axes[1]) == [([30.0], [0.6])]
    assert axes[1].plot.call_args.kwargs["label"] == "0.4"
    bars = [[np.asarray(part).tolist() for part in call.args] for call in axes[0].errorbar.call_args_list]
    assert bars == [[[0.1], [0.1], [0.02]], [[-0.39, 0.62], [0.2, 0.3], [0.02, 0.02]]]
    across = axes[1].errorbar.call_args_list
    assert [call.kwargs["color"] for call in across] == [paper_slip.COLORS[2], paper_slip.COLORS[3]]  # of 0.4 and 0.6
    assert [np.asarray(call.args[1]).tolist() for call in across] == [[0.5], [0.6]]
    assert (GREEN in paper_slip.COLORS, paper_slip.COLORS[-1]) == (True, PURPLE)
    assert labels(axes[0]) == ("slip ratio", "longitudinal force / vertical force")
    assert labels(axes[1]) == ("slip angle, degrees", "lateral force / vertical force")
    assert [one.legend.call_args.kwargs["title"] for one in axes] == ["slip angle", "slip ratio"]
    assert first.data["panel"].tolist() == ["a", "a", "bench", "bench", "bench"]
    assert paper_slip.slip_figures("f-", "t", "c", curves)[0].data["panel"].tolist() == ["a", "a"]


def test_plots_of_a_notebook_have_the_places_of_what_they_show() -> None:
    poses: Any = SimpleNamespace(x_mm=np.array([nan, 1.0, 2.0]), y_mm=np.array([nan, 3.0, 4.0]), heading_rad=0)
    turning: Any = SimpleNamespace(
        radius_mm=-5.0, radius_low_mm=4.9, radius_high_mm=5.1, center_x_mm=10.0, center_y_mm=20.0
    )
    axes = MagicMock()
    assert plots.plot_turn(poses, turning, axes) is axes
    (path, start, circle), calls = lines(axes), axes.plot.call_args_list
    np.testing.assert_equal(path, (poses.x_mm, poses.y_mm))
    assert start == ([1.0], [3.0])
    assert [calls[0].args[2], calls[0].kwargs["color"]] == [MEASURED.line, MEASURED.color]
    np.testing.assert_allclose(np.hypot(np.subtract(circle[0], 10), np.subtract(circle[1], 20)), 5.0)
    assert (circle[0][0], circle[1][90]) == pytest.approx((15.0, 25.0))
    assert calls[2].kwargs == {"color": INK, "label": "radius 5.000 mm, 95 % 4.900 to 5.100"}
    assert labels(axes) == ("x, mm", "y, mm")
    assert axes.legend.called
    turning.center_x_mm = nan
    plots.plot_turn(poses, turning, axes := MagicMock())
    assert len(lines(axes)) == 2
    lost: Any = SimpleNamespace(x_mm=np.array([nan]), y_mm=np.array([nan]), heading_rad=0, u_mm_s=1.0)
    plots.plot_run(lost, axes := MagicMock())
    assert len(lines(axes)) == 1
    assert axes.plot.call_args.args[2] == SIMULATED.line
    assert not axes.legend.called


def test_the_grid_of_a_camera_leads_from_corner_to_corner_of_its_field() -> None:
    camera = camera_above(size_px=(640, 480), focal_px=2000, distance_mm=150, tilt_deg=10)
    plots.plot_camera(camera, axes := MagicMock(), height_mm=6.5)
    assert axes.set_title.call_args.args == ("field of the camera, 6.5 mm above the plate",)
    corners = camera.plate_from_image(np.array([[0.0, 0.0], [639.0, 0.0], [0.0, 479.0], [639.0, 479.0]]), 6.5)
    drawn = [np.transpose(line) for line in lines(axes)]
    assert {line.shape for line in drawn} == {(21, 2)}
    assert len(drawn) == 42
    np.testing.assert_allclose(np.array([drawn[0][0], drawn[0][-1], drawn[20][0], drawn[20][-1]]), corners)
    np.testing.assert_allclose(np.array([drawn[21][0], drawn[41][0], drawn[21][-1], drawn[41][-1]]), corners)


def test_bars_of_a_diagnosis_are_its_gaps_and_the_line_its_noise_floor() -> None:
    gap = {
        "before": {"fit": 0.4, "held_out": 0.5},
        "after": {"fit": 0.1, "held_out": None},
        "noise_floor": 0.02,
        "unit": "mm",
    }
    plots.plot_diagnosis({"gap": gap}, axes := MagicMock())
    assert [call.args for call in axes.bar.call_args_list] == [(0, 0.4), (1, 0.5), (2, 0.1)]
    assert [call.kwargs["color"] for call in axes.bar.call_args_list] == [SIMULATED.color] * 2 + [MEASURED.color]
    alphas = [call.kwargs["alpha"] for call in axes.bar.call_args_list]
    assert alphas[0] == alphas[2] != alphas[1]
    assert axes.axhline.call_args.args == (0.02,)
    assert axes.set_xticks.call_args.args[1] == ["before\nfit", "before\nheld out", "after\nfit", "after\nheld out"]
    assert axes.set_ylabel.call_args.args == ("gap, mm RMS",)
