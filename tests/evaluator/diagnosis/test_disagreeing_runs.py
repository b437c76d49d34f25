"""A phase of a run disagrees where it is off by more than what the best model leaves over."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from evaluator.diagnosis.assessment.residuals.disagreeing_runs import disagreeing_runs

SIGMA = 0.01
PIECES = 7  # of a run, the first of them within a second of the start


def table() -> pd.DataFrame:
    """Eight runs that agree: noise before and after."""
    rng = np.random.default_rng(4)
    rows = [{"run": f"r{run}", "time_s": 0.5 + piece} for run in range(8) for piece in range(PIECES)]
    found = pd.DataFrame(rows)
    for column in ("along_mm_s", "across_mm_s", "yaw_deg_s"):
        found[f"after_{column}"] = SIGMA * rng.normal(size=len(found))
        found[column] = found[f"after_{column}"]
    return found


def test_runs_that_agree_are_not_named() -> None:
    assert disagreeing_runs(table()) == []


@pytest.mark.parametrize(("off", "named"), [(0.7, False), (2.4, True)])
def test_the_steady_phase_is_judged_by_the_mean_of_its_pieces(off: float, named: bool) -> None:
    pieces = table()
    pieces.loc[(pieces["run"] == "r3") & (pieces["time_s"] > 1), "across_mm_s"] += off * SIGMA
    found = disagreeing_runs(pieces)
    assert [(item.run, item.phase, item.quantity) for item in found] == [("r3", "steady", "sideways")] * named
    if named:
        assert found[0].size == pytest.approx(off * SIGMA, abs=1.2 * SIGMA)


@pytest.mark.parametrize(("off", "named"), [(1.5, False), (6.0, True)])
def test_the_start_is_judged_by_its_single_piece(off: float, named: bool) -> None:
    pieces = table()
    pieces.loc[(pieces["run"] == "r5") & (pieces["time_s"] < 1), "yaw_deg_s"] -= off * SIGMA
    found = disagreeing_runs(pieces)
    assert [(item.run, item.phase, item.quantity) for item in found] == [("r5", "start", "yaw_rate")] * named
