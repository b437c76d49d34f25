"""Runs that disagree with the model, by phase and quantity, relative to the residuals of the best model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from evaluator.diagnosis.assessment.disagreement import PIECE_S, QUANTITIES

# Standard deviations from which on a phase of a run is said to disagree. Of some hundred of them, 24 runs in two phases
# and three quantities, chance reaches this in one of fifteen experiments.
DISAGREES_SIGMAS = 3.5
NAMES = {"along_mm_s": "along", "across_mm_s": "sideways", "yaw_deg_s": "yaw_rate"}  # as diagnosis.json says them


@dataclass(frozen=True)
class RunDisagreement:
    """One phase of one run: "start", the first second after the motors come on, or "steady", the rest of it.

    quantity: along, sideways, yaw_rate. size: measured minus predicted, mm/s or deg/s, mean over the phase.
    """

    run: str
    phase: str
    quantity: str
    size: float
    sigmas: float


def disagreeing_runs(table: pd.DataFrame) -> list[RunDisagreement]:
    """What stands out of a table of pieces with what the model misses before and after (columns after_…).

    A standard deviation of a piece is what the best model leaves over, by median absolute deviation: noise, and what
    friction and gains of a run make in one second of it.
    """
    phase = np.where(table["time_s"] < PIECE_S, "start", "steady")
    found = []
    for column in QUANTITIES:
        left = table[f"after_{column}"].to_numpy(dtype=float)
        sigma = 1.4826 * float(np.nanmedian(np.abs(left - np.nanmedian(left))))
        groups = table.groupby([table["run"], phase], sort=False)[column]
        for (run, when), values in groups:
            size, count = float(values.mean()), int(values.count())
            sigmas = abs(size) * np.sqrt(count) / max(sigma, 1e-12)
            if count and sigmas >= DISAGREES_SIGMAS:
                found.append(RunDisagreement(str(run), str(when), NAMES[column], size, float(sigmas)))
    return found
