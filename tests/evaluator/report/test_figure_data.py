"""What figures draw and what their tables hold, without drawing: radii, lost frames, scale, camera, budget."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, nan
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from calibration.camera import PARAMETERS, camera_above
from evaluator.report.figures import disagreement, quality, radius
from evaluator.report.measurement import budget as section
from evaluator.report.measurement.budget import budget_section
from evaluator.turning.budget import Contribution
from tests.evaluator.report.shown import Shown, turned, undrawn

BOUNDS = {"radius_low_mm": 7.0, "radius_high_mm": 9.5}


def test_radii_are_drawn_with_their_intervals_and_simulations(monkeypatch: pytest.MonkeyPatch) -> None:
    axes = undrawn(monkeypatch, radius)
    runs = [
        turned("a", 8.0, simulated=8.2, **BOUNDS),
        replace(turned("b", 9.0, simulated=9.2, radius_low_mm=6.0, radius_high_mm=inf), group="B"),
        turned("c", 9.0, turned_deg=0.5),
    ]
    runs[1].turning["left_rpm"], runs[1].turning["right_rpm"] = -20.0, -35.0
    figure = radius.radius_against_difference(runs)
    assert figure is not None
    assert figure.data["run"].tolist() == ["a", "b"]
    assert figure.data["radius_mm"].tolist() == [8.0, 9.0]
    (x, drawn, (below, above)), _ = axes[0].errorbar.call_args
    assert (list(x), drawn.tolist(), below.tolist(), above.tolist()) == (
        *([10.0, 15.0], [8.0, 9.0], [1.0, 3.0], [1.5, 0.0]),  # a bound at infinity has no bar
    )
    (x, simulated), _ = axes[0].plot.call_args
    assert (list(x), simulated.tolist()) == ([10.0, 15.0], [8.2, 9.2])
    ratios = radius.radius_against_ratio(runs, magnetic=True)
    assert ratios is not None
    assert ratios.data["ratio"].tolist() == pytest.approx([1 / 3, 1 - 20 / 35])
    (at, theory), _ = axes[1].plot.call_args_list[-1]
    np.testing.assert_allclose(theory, 2.5735 * at**-1.5141)
    groups = radius.radius_by_group(runs)
    assert groups is not None
    assert groups.data[["run", "group", "direction"]].to_numpy().tolist() == [
        *(["a", "", "forward"], ["b", "B", "backward"]),
    ]
    assert [call.kwargs["label"] for call in axes[2].errorbar.call_args_list] == ["forward", "B, backward"]
    assert radius.radius_by_group(runs[:1]) is None
    assert radius.radius_against_difference(runs[2:]) is None


def test_frames_without_a_pose_have_their_time_and_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    @dataclass(frozen=True)
    class Seen(Shown):
        poses: Any = None

    def seen(name: str, x: list[float]) -> Seen:
        status = ["ok" if np.isfinite(value) else f"lost {k}" for k, value in enumerate(x)]
        table = pd.DataFrame({"time_s": 0.5 * np.arange(len(x)), "x_mm": x, "status": status})
        run = turned(name, 9.0)
        return Seen(run.run, "", run.turning, run.comparison, run.outputs, poses=table)

    axes = undrawn(monkeypatch, quality)
    found = quality.lost_frames([seen("a", [1.0, nan, 1.0, nan]), seen("b", [1.0, 2.0]), seen("c", [nan, 1.0])])
    assert found is not None
    assert found.data.to_numpy().tolist() == [["a", 0.5, "lost 1"], ["a", 1.5, "lost 3"], ["c", 0.0, "lost 0"]]
    assert axes[0].hlines.call_args_list[0].args == (0, 0, 1.5)
    assert quality.lost_frames([seen("b", [1.0, 2.0])]) is None
    many = [seen(f"r{k}", [nan, nan if k % 20 == 19 else 1.0]) for k in range(1000)]
    found = quality.lost_frames(many)
    assert found is not None
    assert list(dict.fromkeys(found.data["run"])) == [f"r{k}" for k in range(19, 800, 20)]
    assert found.caption.endswith("Of 1000 runs these 40 lost most frames.")


def test_distance_of_the_marks_is_drawn_in_percent_with_its_interval(monkeypatch: pytest.MonkeyPatch) -> None:
    axes = undrawn(monkeypatch, quality)
    more = {"mark_spacing_ratio": 1.02, "mark_spacing_ratio_sigma": 0.001}
    found = quality.scale_check([turned("a", 9.0, **more), turned("b", 9.0, mark_spacing_ratio=nan)])
    assert found is not None
    assert found.data["off_percent"].tolist() == pytest.approx([2.0, nan], nan_ok=True)
    assert axes[0].errorbar.call_args.args[2][0] == pytest.approx(0.196)
    assert quality.scale_check([turned("b", 9.0)]) is None


def test_uncertainty_of_a_camera_grows_with_the_distance_from_its_middle(monkeypatch: pytest.MonkeyPatch) -> None:
    """A focal length known to a thousandth: places to a thousandth of their distance, per coordinate over √2."""
    undrawn(monkeypatch, quality)
    camera = camera_above(size_px=(640, 480), focal_px=2000, distance_mm=150)
    covariance = np.zeros((len(PARAMETERS),) * 2)
    covariance[PARAMETERS.index("focal_px"), PARAMETERS.index("focal_px")] = 2.0**2
    table = quality.camera_uncertainty(replace(camera, covariance=covariance), 6.5).data
    middle = camera.value("principal_x_px"), camera.value("principal_y_px")
    off = np.hypot(table["x_px"] - middle[0], table["y_px"] - middle[1]) * (150 - 6.5) / 2000
    np.testing.assert_allclose(table["sigma_um"], off * 1e-3 * 1000 / np.sqrt(2), atol=1e-6)
    np.testing.assert_allclose(np.hypot(table["x_mm"], table["y_mm"]), off, atol=1e-6)


def test_a_budget_is_told_in_micrometres_and_percent_of_the_radius(monkeypatch: pytest.MonkeyPatch) -> None:
    undrawn(monkeypatch, section)
    items = (
        Contribution("noise", 0.012, 0.003, 0.05, measured=True),
        Contribution("mark height", 0.04, 0.0, 1e-9, measured=False),
    )
    budget: Any = SimpleNamespace(
        turning=SimpleNamespace(radius_mm=8.0), contributions=items,
        combined=lambda *, measured_only: items[0] if measured_only else replace(items[1], source="all"),
    )  # fmt: skip
    found = budget_section(turned("a", 8.0), budget)
    assert found.tables[0].rows == (
        ("noise", "12", "0.15", "3.0", "0.050", ""),
        ("mark height", "40", "0.50", "0", "0", "not in the intervals"),
        ("noise", "12", "0.15", "3.0", "0.050", ""),
        ("all", "40", "0.50", "0", "0", "not in the intervals"),
    )
    assert "of the radius in its interval: 0.15 %. Largest source of all: mark height, 0.50 %." in found.text[0]
    assert found.figures[0].data["radius_percent"].tolist() == pytest.approx([0.15, 0.5])
    unknown = Contribution("lens", nan, nan, nan)
    budget.contributions = (unknown, *items)
    assert "Largest source of all: mark height" in budget_section(turned("a", 8.0), budget).text[0]


@pytest.mark.parametrize(
    ("by", "axis"),
    [
        ("heading", "heading_deg"),
        ("place", "place"),
        ("the first second", "time_s"),
        ("time since the command", "time_s"),
        ("order of the runs", "order"),
        ("direction times side", "both"),
        ("everywhere", "speed"),
        ("speed", "speed"),
        ("difference", "difference"),
    ],
)
def test_a_disagreement_is_drawn_against_what_it_depends_on(by: str, axis: str) -> None:
    dependence: Any = SimpleNamespace(by=by)
    assert disagreement._axis(dependence) == axis
