"""Runs that disagree with the model, by phase and quantity, relative to the residuals of the best model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from evaluator.diagnosis.assessment.residuals.disagreement import PIECE_S, QUANTITIES
from evaluator.robust import PER_MEDIAN

# Standard deviations above which a phase of a run disagrees. Among 24 runs with two phases and three quantities, chance
# exceeds this in one of fifteen experiments.
DISAGREES_SIGMAS = 3.5
NAMES = {"along_mm_s": "along", "across_mm_s": "sideways", "yaw_deg_s": "yaw_rate"}  # names in diagnosis.json


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
    """Significant entries of a table of pieces with residuals before and after (columns after_…).

    The standard deviation of a piece is that of the residuals of the best model, by median absolute deviation: it
    includes noise and variations of friction and gains within a second.
    """
    phase = np.where(table["time_s"] < PIECE_S, "start", "steady")
    found = []
    for column in QUANTITIES:
        left = table[f"after_{column}"].to_numpy(dtype=float)
        sigma = PER_MEDIAN * float(np.nanmedian(np.abs(left - np.nanmedian(left))))
        groups = table.groupby([table["run"], phase], sort=False)[column]
        for (run, when), values in groups:
            size, count = float(values.mean()), int(values.count())
            sigmas = abs(size) * np.sqrt(count) / max(sigma, 1e-12)
            if count and sigmas >= DISAGREES_SIGMAS:
                found.append(RunDisagreement(str(run), str(when), NAMES[column], size, float(sigmas)))
    return found
