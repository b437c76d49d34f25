"""What the figures of a disagreement draw: residuals against their cause, with the sign of the motion, and cells."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pandas as pd
import pytest

from evaluator.diagnosis.assessment.residuals.disagreement import COLUMNS, QUANTITIES
from evaluator.report.diagnosis.view import _pieces
from evaluator.report.figures import disagreement
from evaluator.report.pages.colors import INK, PAPER, SOFT
from tests.evaluator.report.shown import labels, limits, lines, undrawn


def pieces() -> pd.DataFrame:
    """Four pieces: forward and backward, to the left and straight."""
    return pd.DataFrame(
        {
            "run": ["a", "b", "c", "d"],
            "time_s": [0.5, 1.5, 2.5, 3.5],
            "order": [0, 1, 2, 3],
            "along_mm_s": [0.1, 0.2, 0.3, 0.4],
            "across_mm_s": [-0.1, 0.2, -0.3, 0.4],
            "yaw_deg_s": [1.0, 2.0, 3.0, 4.0],
            "x_mm": [1.0, 2.0, 3.0, 4.0],
            "y_mm": [5.0, 6.0, 7.0, 8.0],
            "direction": [1.0, -1.0, 1.0, -1.0],
            "side": [1.0, 1.0, 0.0, -1.0],
            "speed_rpm": [30.0, 40.0, 50.0, 60.0],
            "difference_rpm": [3.0, 5.0, 0.0, 7.0],
            "heading_deg": [10.0, 20.0, 30.0, 40.0],
            **{f"after_{name}": [0.01, 0.02, 0.03, 0.04] for name in ("along_mm_s", "across_mm_s", "yaw_deg_s")},
        }
    )


def dependence(by: str, quantity: str = "along_mm_s", parity: str = "", sigmas: float = 5.0) -> Any:
    return SimpleNamespace(by=by, quantity=quantity, parity=parity, sigmas=sigmas)


@pytest.mark.parametrize(
    ("item", "across", "sign", "said"),
    [
        (dependence("speed"), [30, -40, 50, -60], 1, ("speed, rpm (backward negative)", "mm/s")),
        (dependence("everywhere", parity="odd"), [30, -40, 50, -60], 1, ("speed, rpm (backward negative)", "mm/s")),
        (dependence("left and right"), [3, 5, 0, -7], 1, ("right minus left, rpm", "mm/s")),
        (
            dependence("direction times side", "yaw_deg_s"),
            *([3, -5, 0, 7], 1, ("right minus left, rpm, sign reversed backward", "°/s")),
        ),
        (dependence("heading", parity="even"), [10, 20, 30, 40], 1, ("heading on the plate, °", "mm/s")),
        (
            dependence("twice the heading", "yaw_deg_s", "odd"),
            *([10, 20, 30, 40], [1, -1, 1, -1], ("heading on the plate, °", "°/s, sign reversed backward")),
        ),
        (
            dependence("the first second", parity="odd"),
            *([0.5, 1.5, 2.5, 3.5], [1, -1, 1, -1], ("time since the command, s", "mm/s, sign reversed backward")),
        ),
        (
            dependence("order of the runs", "yaw_deg_s", "odd"),
            *([0, 1, 2, 3], [1, 1, 0, -1], ("run of the session", "°/s, sign reversed in right turns")),
        ),
    ],
)
def test_residuals_are_drawn_against_what_they_depend_on_with_the_sign_of_the_motion(
    item: Any, across: list[float], sign: Any, said: tuple[str, str]
) -> None:
    axes, table = MagicMock(), pieces()
    disagreement._against(axes, table, item, after=True)
    before, after = lines(axes)
    np.testing.assert_allclose(before, (across, np.multiply(sign, table[item.quantity])))
    np.testing.assert_allclose(after, (across, np.multiply(sign, table[f"after_{item.quantity}"])))
    assert labels(axes) == said
    assert axes.set_xlim.called == ("heading" in item.by)
    disagreement._against(axes := MagicMock(), table, item, after=False)
    assert len(lines(axes)) == 1


@pytest.mark.parametrize("parity", ["even", "odd"])
def test_on_the_plate_triangles_point_the_way_of_the_residual_and_grow_with_it(parity: str) -> None:
    axes = MagicMock()
    disagreement._on_plate(axes, pieces(), dependence("place", "across_mm_s", parity))
    value = np.array([-0.1, 0.2, -0.3, 0.4]) * ([1, -1, 1, -1] if parity == "odd" else [1] * 4)
    size = 55 * np.abs(value) / np.quantile(np.abs(value), 0.95)
    for call, chosen, marker in zip(axes.scatter.call_args_list, (value >= 0, value < 0), "^v", strict=True):
        np.testing.assert_allclose(call.args, (np.arange(1, 5)[chosen], np.arange(5, 9)[chosen]))
        np.testing.assert_allclose(call.kwargs["s"], size[chosen])
        assert call.kwargs["marker"] == marker
    assert labels(axes) == ("x on the plate, mm" + (", sign reversed backward" if parity == "odd" else ""), "y, mm")


@pytest.mark.parametrize(
    ("sigmas", "text", "weight", "color", "shaded"),
    [
        (3.44, "3.4", "normal", SOFT, None),
        (3.5, "3.5", "bold", INK, 0.25 + 0.75 * 3.5 / 12),
        (6.1, "6.1", "bold", PAPER, 0.25 + 0.75 * 6.1 / 12),
        (9.94, "9.9", "bold", PAPER, 0.25 + 0.75 * 9.94 / 12),
        (9.96, "10", "bold", PAPER, 0.25 + 0.75 * 9.96 / 12),
        (40.0, "40", "bold", PAPER, 1.0),
    ],
)
def test_a_cell_is_bold_and_shaded_where_it_is_significant(
    sigmas: float, text: str, weight: str, color: str, shaded: float | None
) -> None:
    axes = MagicMock()
    disagreement._cell(axes, 2.0, -3.0, sigmas)
    assert axes.text.call_args.args == (2.0, -3.0, text)
    assert (axes.text.call_args.kwargs["fontweight"], axes.text.call_args.kwargs["color"]) == (weight, color)
    patches = [call.args[0] for call in axes.add_patch.call_args_list]
    assert [patch.get_alpha() for patch in patches] == ([] if shaded is None else [pytest.approx(shaded)])
    middles = [np.add(patch.get_xy(), (patch.get_width() / 2, patch.get_height() / 2)) for patch in patches]
    assert all(middle == pytest.approx((2, -3)) for middle in middles)


def test_cells_of_the_map_stand_in_the_row_of_their_cause_and_the_column_of_their_quantity(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    axes = undrawn(monkeypatch, disagreement)
    cells: list[tuple[float, float, float]] = []
    monkeypatch.setattr(disagreement, "_cell", lambda _, *cell: cells.append(cell))
    told = {
        "along_mm_s": [dependence("speed", sigmas=1.0), dependence("heading", parity="even", sigmas=2.0)],
        "after": [dependence("speed", "yaw_deg_s", sigmas=3.0)],
    }
    monkeypatch.setattr(
        disagreement, "every_dependence", lambda table: told["after" if table["along_mm_s"][0] < 0.05 else "along_mm_s"]
    )
    found = disagreement.disagreement_map(pieces())
    assert cells == [(0.0, 0, 1.0), (5.5, 0, 3.0), (0.0, -1, 2.0)]  # a quarter of a column between quantities
    assert axes[0].set_yticks.call_args.args[1] == ["speed", "heading, even"]
    places, names = axes[0].set_xticks.call_args.args
    assert (places, names) == ([0.0, 1.0, 2.25, 3.25, 4.5, 5.5], ["before", "after"] * 3)
    top = axes[0].secondary_xaxis.return_value.set_xticks.call_args.args
    np.testing.assert_allclose(top[0], [0.5, 2.75, 5.0])
    assert top[1] == ["along", "sideways", "yaw rate"]
    np.testing.assert_allclose(limits(axes[0]), ((-0.55, 6.05), (-1.6, 0.6)))
    assert found.data.to_numpy().tolist() == [
        *(["along", "speed", "before", 1.0], ["along", "heading, even", "before", 2.0]),
        ["yaw rate", "speed", "after", 3.0],
    ]
    cells.clear()
    disagreement.disagreement_map(pieces(), after=False)
    assert cells == [(0.0, 0, 1.0), (0.0, -1, 2.0)]
    assert axes[1].set_xticks.call_args.args == ([0.0, 1.25, 2.5], ["before"] * 3)


def test_panels_show_the_strongest_dependence_of_each_kind_once_and_six_at_most(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    axes = undrawn(monkeypatch, disagreement)
    items = [
        *(dependence("heading", parity="even", sigmas=4.0), dependence("twice the heading", parity="even", sigmas=9.0)),
        *(dependence("heading", parity="odd", sigmas=8.0), dependence("speed", sigmas=3.4)),
        dependence("place", "across_mm_s", "odd", sigmas=3.6),
    ]
    monkeypatch.setattr(disagreement, "every_dependence", lambda _: items)
    found = disagreement.disagreement_panels(pieces(), after="with values adjusted")
    assert found is not None
    titles = [one.set_title.call_args.args[0] for one in axes]
    assert titles == ["speed along the robot, 9 sigmas", "speed along the robot, 8 sigmas", "sideways speed, 4 sigmas"]
    assert "robot.toml; dots: after, with values adjusted." in found.caption
    assert found.caption.endswith(disagreement.ON_PLATE_WORDS)
    assert [line.text for line in found.legend] == ["before", "after"]
    kinds = ("speed", "difference", "the first second", "order of the runs", "direction times side")
    items[:] = [dependence(by, quantity) for by in kinds for quantity in ("along_mm_s", "across_mm_s")]
    few = disagreement.disagreement_panels(pieces(), after="")
    assert few is not None
    assert (len(few.panels), few.legend) == (6, ())
    assert disagreement.ON_PLATE_WORDS not in few.caption
    assert "dots" not in few.caption
    items[:] = items[:0]
    assert disagreement.disagreement_panels(pieces(), after="so") is None
    many = pd.concat([pieces()] * 126, ignore_index=True)  # 504 pieces
    assert len(disagreement._thinned(many)) == 168


def test_pieces_of_an_earlier_program_that_lack_a_column_are_not_drawn(tmp_path: Path) -> None:
    path, names = tmp_path / "disagreement.csv", [*COLUMNS, *(f"after_{name}" for name in QUANTITIES)]
    assert _pieces(path) is None
    for missing in ("", names[0], names[-1]):
        table = pd.DataFrame({name: [1.0, 2.0] for name in [*names, "of_a_later_one"] if name != missing})
        table.to_csv(path, index=False)
        found = _pieces(path)
        assert (found is not None and found["x_mm"].tolist() == [1.0, 2.0]) == (not missing)
