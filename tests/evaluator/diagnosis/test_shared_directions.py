"""Which errors of a camera count, and what an error of a mark's middle does, in closed form."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from evaluator.diagnosis.likelihood.shared_errors import NEGLIGIBLE_MM, _fixed_to_body, _main_directions
from evaluator.pose_systematic import COMMON_PX, COMMON_SHARE

PLACES = np.column_stack([np.linspace(-8, 9, 30), 5 * np.sin(np.linspace(0, 3, 30))])
ARM = np.array([0.3, 1.8])
POINTS = {"green": PLACES + ARM, "yellow": PLACES - ARM}


def seen(move: Any) -> np.ndarray:
    """Shifts (30, 4) of both marks by a field of the plate."""
    return np.concatenate([move(POINTS[name]) for name in POINTS], axis=1)


def test_shifts_and_turns_of_a_whole_run_are_no_error_and_a_stretch_is() -> None:
    shift = seen(lambda p: np.tile([0.02, -0.01], (len(p), 1)))
    turn = seen(lambda p: 1e-3 * p[:, ::-1] * [-1.0, 1.0])
    stretch = seen(lambda p: 1e-3 * p)
    found = _main_directions([POINTS], [np.stack([shift, turn, stretch], axis=2)])
    assert found.shape == (3, 1)
    np.testing.assert_allclose(np.abs(found[:, 0]), [0.0, 0.0, 1.0], atol=1e-9)


@pytest.mark.parametrize(("share", "counts"), [(0.97, 0), (1.03, 1)])
def test_an_error_counts_from_a_twentieth_of_a_micrometre_on(share: float, counts: int) -> None:
    xy = np.concatenate(list(POINTS.values()), axis=1).reshape(-1, 2)
    spread = np.sqrt(np.sum((xy - xy.mean(axis=0)) ** 2) / xy.size)
    stretch = seen(lambda p: share * NEGLIGIBLE_MM / spread * p)
    assert _main_directions([POINTS], [stretch[:, :, None]]).shape == (1, counts)


def test_directions_are_orthonormal_combinations_over_all_runs_and_frames_without_a_mark_say_nothing() -> None:
    stretch, keystone = seen(lambda p: 1e-3 * p), seen(lambda p: 1e-4 * p * p[:, :1])
    shifts = np.stack([stretch, stretch + keystone], axis=2)
    holed = shifts.copy()
    holed[4] = np.nan
    found = _main_directions([POINTS, POINTS], [shifts, holed])
    np.testing.assert_allclose(found.T @ found, np.eye(2), atol=1e-12)


def test_error_of_a_mark_lies_along_and_across_the_line_of_the_marks() -> None:
    table = pd.DataFrame({f"{m}_{a}_px": np.tile(v, 5) for m, v in (("green", 100.0), ("yellow", 140.0)) for a in "xy"})
    for mark in ("green", "yellow"):
        for axis in "xy":
            table[f"{mark}_{axis}_sigma_mm"] = 0.02
    points = {"green": np.tile([1.0, 4.0], (5, 1)), "yellow": np.tile([1.0, 0.0], (5, 1))}
    item: Any = SimpleNamespace(table=table, marks=("green", "yellow"))
    found = _fixed_to_body(item, points)
    size = np.hypot(COMMON_SHARE * 0.02, COMMON_PX * 4 / np.hypot(40, 40))
    np.testing.assert_allclose(found[0], size * np.array([[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 0, -1], [0, 0, 1, 0]]))
    bare: Any = SimpleNamespace(table=table.drop(columns="green_x_px"), marks=("green", "yellow"))
    assert _fixed_to_body(bare, points).shape == (5, 4, 0)
