"""How visible a hidden effect is in the data of a drawn experiment, apart from how the diagnosis answered.

The effect's own change of the marks is freed of whatever start poses, nominal values within their tolerances and the
run-to-run scatter that was drawn could imitate. What is left, in standard errors of the tracking noise, is by how much
the best fit without the effect is worse than the fit with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluator.discrepancy.diagnosis import Diagnosis
from evaluator.discrepancy.features import channel_residual, channels_of
from evaluator.discrepancy.fit import model_columns, prior_precision
from evaluator.discrepancy.mixed import at_scatter, reduce_runs

Floats = NDArray[np.float64]


def visible_sigmas(diagnosis: Diagnosis, shifts: Sequence[Floats], scatter: Floats) -> float:
    """Sigmas by which removing an effect worsens the fit; shifts: what it does to the marks (n, 4) of every run, mm."""
    problem, search = diagnosis.problem, diagnosis.search
    if problem is None or search is None:
        return float("nan")
    columns = model_columns([], search.tolerance)
    changed: list[Any] = []
    for run, item in enumerate(problem.linearized(diagnosis.fit.point, columns)):
        marks = problem.data[run].marks_mm
        difference = channel_residual(channels_of(marks), channels_of(marks - shifts[run]), problem.half_distance_mm)
        features = problem.compressions[run].features(difference[problem.compressions[run].used])
        changed.append(replace(item, response=features))
    s, g, G = (np.sum(part, axis=0) for part in at_scatter(reduce_runs(changed), scatter))
    information = G + np.diag(prior_precision(columns, search.tolerance))
    return float(np.sqrt(max(s - g @ np.linalg.solve(information, g), 0.0)))
