"""When a mark is taken as the fast path fits it, with colours and fits that are made up."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from evaluator.tracking.refinement import fast_path, kernels

RADIUS, REACH, AREA = 8.0, 2.0, 200.0  # a slack of 5 px
PLAIN = {"area": AREA, "seen": (30.0, 40.0), "x": 30.0, "y": 40.0, "residual": 1.0, "inside": 1.0, "used": 1.0}


def looked(monkeypatch: pytest.MonkeyPatch, **said: Any) -> tuple[int, Any, Any]:
    """What is made of a mark that is expected at (30, 40); where its fit began, and its smear."""
    given: dict[str, Any] = {**PLAIN, "amplitude": 100.0, "scatter": 0.1, **said}
    start, disc, result = np.zeros(4), np.array([RADIUS, *[0.0] * 7]), np.zeros(kernels.RESULTS)

    def color_window(_u: Any, _v: Any, _cell: Any, x: float, y: float, half: float, _color: Any, found: Any) -> None:
        assert (x, y, half) == (30.0, 40.0, RADIUS + REACH)
        found[:] = given["area"], *given["seen"], 40.0, 0.0

    def fit_disc(*args: Any) -> None:
        assert args[4] is False  # before an even background
        args[-1][[kernels.X, kernels.Y, kernels.AMPLITUDE]] = given["x"], given["y"], given["amplitude"]
        args[-1][[kernels.RESIDUAL, kernels.USED, kernels.INSIDE]] = given["residual"], given["used"], given["inside"]

    monkeypatch.setattr(fast_path, "color_window", color_window)
    monkeypatch.setattr(fast_path, "fit_disc", fit_disc)
    usual = np.array([100.0, 30.0, given["scatter"], 1.0, AREA])
    arrays: Any = (np.zeros(1),) * 4
    verdict = fast_path.fit_mark(
        arrays[0], None, None, 0, 1, arrays[0], 30.0, 40.0, REACH, 3.0, -4.0, arrays[1], usual, disc,
        arrays[2], arrays[3], start, np.zeros(5), result,
    )  # fmt: skip
    return verdict, start.tolist(), disc[5:7].tolist()


LITTLE, ODD, WELL = fast_path.TOO_LITTLE, fast_path.UNUSUAL, fast_path.WELL


@pytest.mark.parametrize(
    ("said", "verdict"),
    [
        ({}, WELL),
        ({"area": 0.34 * AREA}, LITTLE),
        ({"area": 0.36 * AREA}, WELL),
        ({"area": 1.49 * AREA}, WELL),
        ({"area": 1.51 * AREA}, ODD),  # something of its colour is beside it
        ({"residual": 1.19}, WELL),  # two sigmas of the usual scatter
        ({"residual": 1.21}, ODD),
        ({"residual": 1.49, "scatter": 0.4}, WELL),
        ({"residual": 1.51, "scatter": 0.4}, ODD),
        ({"x": 36.9, "seen": (33.0, 40.0)}, WELL),  # the reach and half a radius and a pixel
        ({"x": 37.1, "seen": (33.0, 40.0)}, ODD),
        ({"y": 33.1, "seen": (30.0, 36.0)}, WELL),
        ({"y": 32.9, "seen": (30.0, 36.0)}, ODD),
        ({"x": 33.0, "y": 41.9}, WELL),  # beside the colour by less than that, both axes together
        ({"x": 33.0, "y": 42.1}, ODD),
        ({"inside": 0.91}, WELL),
        ({"inside": 0.89}, ODD),
        ({"used": 0.76}, WELL),
        ({"used": 0.74}, ODD),
        ({"amplitude": 390.0}, WELL),
        ({"amplitude": 410.0}, ODD),
        ({"amplitude": 26.0}, WELL),
        ({"amplitude": 24.0}, ODD),
        ({"amplitude": math.nan, "x": math.nan}, ODD),
    ],
)
def test_a_mark_is_well_that_is_where_it_was_expected_whole_and_as_bright_as_usual(
    said: dict[str, Any], verdict: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert looked(monkeypatch, **said)[0] == verdict


@pytest.mark.parametrize(
    ("said", "begins"),
    [
        ({"seen": (33.0, 41.1)}, (30.0, 40.0)),  # two fifths of its radius and a pixel from where it was expected
        ({"seen": (33.0, 41.3)}, (33.0, 41.3)),
        ({"seen": (33.0, 41.3), "area": 1.6 * AREA}, (30.0, 40.0)),  # of two things it is nobody's centre
    ],
)
def test_a_fit_begins_where_the_mark_is_expected_unless_its_colour_is_elsewhere(
    said: dict[str, Any], begins: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, start, smear = looked(monkeypatch, **said)
    assert start == [*begins, 100.0, 30.0]
    assert smear == [3.0, -4.0]
