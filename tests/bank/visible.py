"""How visible a hidden effect is in the data of a drawn experiment, apart from how the diagnosis answered.

The best model without the effect is fitted to the marks as they are, and to the same marks freed of what the effect did
to them. By how much the first fit is worse, in sigmas, is what leaving out the true effect costs. Start poses, nominal
values within their tolerances, the run-to-run scatter, which nobody knows beforehand, and the other hidden effects are
free in both.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.assessment.model_comparison import is_free
from evaluator.diagnosis.inference.fit import fit_model
from evaluator.diagnosis.likelihood.features import channels_of
from evaluator.diagnosis.likelihood.point import Point
from evaluator.diagnosis.result import Diagnosis

Floats = NDArray[np.float64]

LIKELIEST = 3  # sets of named effects, none among them


def visible_sigmas(diagnosis: Diagnosis, shifts: Sequence[Floats], others: Collection[str]) -> float:
    """Sigmas by which leaving an effect out worsens the fit; infinite where nothing can then be fitted.

    shifts: what the effect does to the marks (n, 4) of every run, mm; others: the other hidden effects.
    """
    problem, search = diagnosis.problem, diagnosis.search
    if problem is None or search is None:
        return float("nan")
    terms = [search.terms[effect] for effect in others if not search.terms[effect].stepwise]
    near = {effect: values for fit in search.fits.values() for effect, values in fit.point.terms.items()}
    start = Point(search.null.point.per_run, search.null.point.nominal, {t.id: near.get(t.id, t.absent) for t in terms})
    misfit = []
    for shift in ([np.zeros(1)] * len(shifts), shifts):
        data = tuple(
            replace(run, marks_mm=run.marks_mm - moved) for run, moved in zip(problem.data, shift, strict=True)
        )
        changed = replace(problem, data=data, channels=tuple(channels_of(run.marks_mm) for run in data))
        try:
            misfit.append(fit_model(changed, start, terms, search.tolerance).posterior.misfit)
        except FloatingPointError:
            misfit.append(np.inf)
    return float(np.sqrt(max(misfit[0] - misfit[1], 0.0))) if np.isfinite(misfit[1]) else float("nan")


def sigmas_beyond_named(diagnosis: Diagnosis, shifts: Sequence[Floats]) -> float:
    """How many sigmas the shifts stand out with the likeliest named effects free: what these cannot imitate."""
    named = [ids for ids in diagnosis.standing.sets if not any(map(is_free, ids))] if diagnosis.standing else []
    return min((visible_sigmas(diagnosis, shifts, ids) for ids in named[:LIKELIEST]), default=float("nan"))
