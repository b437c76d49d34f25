"""Digits of estimates, mistakes before results, axes of the plate in an image, the path of a single mark, and the
largest disagreement where none is significant.
"""

from __future__ import annotations

from dataclasses import replace
from math import nan
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from calibration.camera import camera_above
from evaluator.diagnosis.assessment.residuals.disagreement import SHOWN_SIGMAS
from evaluator.report.diagnosis.where import where_sentences
from evaluator.report.figures.calibration import plate_axes_px
from evaluator.report.numbers import UNKNOWN, _estimate, series_row
from evaluator.report.runs import STRAIGHT_DEG, RunView
from evaluator.report.summary import mistakes_first
from evaluator.turning.circular_test import Estimate, Series
from evaluator.workflow.results.outputs import Outputs


@pytest.mark.parametrize(
    ("half", "text"),
    [
        (0.0123, "1.235 (1.222 to 1.247)"),  # two digits of half an interval
        (0.123, "1.23 (1.11 to 1.36)"),
        (30.0, "1 (−29 to 31)"),
        (0.0, "1.235 (1.235 to 1.235)"),
        (np.inf, UNKNOWN),
    ],
)
def test_an_estimate_has_the_digits_that_half_its_interval_bears(half: float, text: str) -> None:
    item: Any = SimpleNamespace(value=1.2346, low=1.2346 - half, high=1.2346 + half)
    assert _estimate(item).replace("-", "−") == text


def test_runs_with_mistakes_are_left_out_by_name_where_there_are_any() -> None:
    runs = [SimpleNamespace(id=name) for name in "abc"]
    analysis: Any = SimpleNamespace(
        mistakes=(SimpleNamespace(sentence="it drives backward", everywhere=False),), excluded_runs={"c", "b"}
    )
    analysis.experiment = SimpleNamespace(run=runs)
    assert mistakes_first(analysis) == [
        "It drives backward.",
        "Left out of all results below until this is corrected: b, c.",
    ]
    analysis.excluded_runs = set()
    assert mistakes_first(analysis) == ["It drives backward."]


@pytest.mark.parametrize(
    ("count", "last"), [(9, "r7 is stuck."), (10, "2 more mistakes are listed in the section on quality.")]
)
def test_of_many_mistakes_those_of_all_runs_and_the_first_stand_before_the_numbers(count: int, last: str) -> None:
    said = [SimpleNamespace(sentence=f"r{k} is stuck", everywhere=False) for k in range(count - 1)]
    said.append(SimpleNamespace(sentence="all runs are late", everywhere=True))
    analysis: Any = SimpleNamespace(mistakes=tuple(said), excluded_runs=())
    found = mistakes_first(analysis)
    assert len(found) == 9
    assert (found[0], found[1], found[-1]) == ("All runs are late.", "r0 is stuck.", last)


@pytest.mark.parametrize(("aside_mm", "inside"), [(0.0, True), (40.0, False)])
def test_axes_of_the_plate_begin_at_its_origin_if_that_is_in_view_and_else_at_the_middle(
    aside_mm: float, *, inside: bool
) -> None:
    camera = camera_above(size_px=(700, 490), focal_px=1400.0, distance_mm=140.0)  # 10 px a millimetre
    moved = SimpleNamespace(
        size_px=camera.size_px,
        image_from_plate=lambda points: camera.image_from_plate(np.asarray(points, float) - [aside_mm, 0.0, 0.0]),
        plate_from_image=lambda points, height: camera.plate_from_image(points, height) + np.array([aside_mm, 0.0]),
    )
    ends: Any = plate_axes_px(moved)  # type: ignore[arg-type]
    origin, middle = moved.image_from_plate([0.0, 0.0, 0.0]), np.array(camera.size_px) / 2
    np.testing.assert_allclose(ends[:, 0], [origin if inside else middle] * 2, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), 70.0, rtol=1e-6)
    assert abs(np.dot(ends[0, 1] - ends[0, 0], ends[1, 1] - ends[1, 0])) < 1e-6


def test_a_robot_of_one_mark_is_simulated_along_the_path_of_this_mark(tmp_path: Path) -> None:
    outputs = Outputs(tmp_path)
    outputs.simulated("a").parent.mkdir(parents=True)
    poses = pd.DataFrame({"time_s": [0.0, 1.0], "x_mm": [1.0, 1.0], "y_mm": [2.0, 2.0], "heading_deg": [0.0, 90.0]})
    poses.to_csv(outputs.simulated("a"), index=False)
    run = RunView("a", "", {"left_rpm": 1.0, "right_rpm": 1.0}, {}, outputs, only_mark=("green", (3.0, 0.5)))
    assert run.simulated[["x_mm", "y_mm"]].to_numpy() == pytest.approx(np.array([[4.0, 2.5], [0.5, 5.0]]))


@pytest.mark.parametrize(
    ("rpm", "turned", "radius", "claims"),
    [
        ((30.0, 30.0), 0.1, np.nan, (True, False, False)),
        ((-30.0, -30.0), 0.1, np.nan, (True, True, False)),
        ((30.0, 14.4), 90.0, 8.0, (False, False, True)),
        ((-30.0, 14.4), -90.0, 8.0, (False, True, True)),
        ((30.0, 14.4), STRAIGHT_DEG, 800.0, (False, False, False)),
        ((30.0, 14.4), 90.0, np.nan, (False, False, False)),
    ],
)
def test_a_run_is_straight_by_its_command_and_a_turn_by_what_was_measured(
    rpm: tuple[float, float], turned: float, radius: float, claims: tuple[bool, bool, bool]
) -> None:
    row = {"left_rpm": rpm[0], "right_rpm": rpm[1], "turned_deg": turned, "radius_mm": radius}
    run = RunView("a", "", row, {}, Outputs(Path()))
    assert (run.straight, run.backward, run.turns) == claims


def test_a_series_of_a_circular_test_has_the_digits_of_its_intervals() -> None:
    item = Series(
        *("constant command", "forward", "left", 0.43256, ("a", "b")),
        *(Estimate(1.23456, 1.2, 1.27), Estimate(-0.5, -0.9, -0.1), Estimate(2.0, nan, nan)),
    )
    assert series_row("measured", item) == [
        *("ratio 0.433", "forward, left", "2", "measured", "1.235 (1.200 to 1.270)", "−0.50 (−0.90 to −0.10)", "–")
    ]
    held = replace(item, method="constant radius", held=12.345678, steering=Estimate(1.0, 1.0, 1.0))
    assert series_row("", held)[0] == "radius 12.35 mm"
    assert series_row("", held)[4] == "1.000 (1.000 to 1.000)"


@pytest.mark.parametrize(
    ("effects", "opening"),
    [
        ([{"id": "plate-tilt"}], "The effects found show in the paths of all runs together; without them, no single"),
        ([], "No single"),
    ],
)
def test_the_largest_disagreement_below_the_limit_of_significance_is_not_told_as_one(
    effects: list[dict[str, Any]], opening: str
) -> None:
    """ "The robot file and the runs disagree (3 sigmas)" stood beside a figure that is bold from 3.5 sigmas on."""
    faint = {"verdict": "effect", "effects": effects, "where": [{"sentence": "it turns", "sigmas": SHOWN_SIGMAS - 0.1}]}
    first, second = where_sentences(faint, 4)
    assert first.startswith(f"{opening} dependence of the disagreement reaches 3.5 sigmas")
    assert second == "It turns."
