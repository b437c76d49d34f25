"""Marks of a robot that stands: what moves both of them alike is told, and nothing else."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from evaluator.tracking.before_start import motion_at_rest

TIMES = np.arange(90) / 60.0
NAMES = ["green", "yellow"]
PLACES = {"green": (1.0, 2.0), "yellow": (1.5, -1.6)}
WANDERS = 0.03 * np.sin(9.0 * TIMES)  # mm, about 1 s a period


def standing(green: np.ndarray | float, yellow: np.ndarray | float, sigma: float = 0.004) -> pd.DataFrame:
    """Marks that move along x by some mm, with noise of their sigma."""
    rng = np.random.default_rng(3)
    columns: dict[str, object] = {"time_s": TIMES}
    for name, way in (("green", green), ("yellow", yellow)):
        for axis, place in zip("xy", PLACES[name], strict=True):
            noise = rng.normal(0.0, sigma, len(TIMES)) if np.isfinite(sigma) else 0.0
            columns[f"{name}_{axis}_mm"] = place + noise + (way if axis == "x" else 0.0)
            columns[f"{name}_{axis}_sigma_mm"] = np.full(len(TIMES), sigma)
    return pd.DataFrame(columns)


def test_marks_that_wander_together_before_the_start_tell_of_the_camera() -> None:
    found = motion_at_rest(standing(WANDERS, WANDERS), NAMES, 0.6)
    assert found is not None
    assert found.way_mm == pytest.approx(0.036, abs=0.004)
    assert found.over_stated == pytest.approx(found.way_mm / 0.004)
    assert f"{1e3 * found.way_mm:.0f} µm before the motors start" in found.note
    assert "Switch stabilisation off" in found.note


@pytest.mark.parametrize(
    ("green", "yellow", "sigma"),
    [
        (0.0, 0.0, 0.004),  # a robot at rest
        (WANDERS, 0.4 * WANDERS, 0.004),  # a coarse first image that becomes finer
        (WANDERS, -WANDERS, 0.004),  # a robot that turns on the spot
        (WANDERS, WANDERS, 0.02),  # no more than the marks state
        (WANDERS, WANDERS, np.nan),  # which is not known
        (10.0 * np.maximum(TIMES - 0.52, 0.0), 10.0 * np.maximum(TIMES - 0.52, 0.0), 0.004),  # a start 0.08 s early
    ],
)
def test_a_robot_at_rest_errors_of_single_marks_and_an_early_start_tell_nothing(
    green: np.ndarray | float, yellow: np.ndarray | float, sigma: float
) -> None:
    assert motion_at_rest(standing(green, yellow, sigma), NAMES, 0.6) is None


def test_a_single_mark_a_short_rest_and_marks_that_are_rarely_seen_tell_nothing() -> None:
    moved = standing(WANDERS, WANDERS)
    assert motion_at_rest(moved, NAMES[:1], 0.6) is None
    assert motion_at_rest(moved, NAMES, 0.28) is None
    assert motion_at_rest(moved, NAMES, 0.0) is None
    moved.loc[8:13, ["green_x_mm", "green_y_mm"]] = np.nan
    assert motion_at_rest(moved, NAMES, 0.6) is None
