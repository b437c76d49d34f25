"""Noise estimated again from a fitted model, if the first estimate contained misfit, drift or ground."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from evaluator.diagnosis.inference.fitted_model import Fit, prior_precision
from evaluator.diagnosis.inference.search import Search
from evaluator.diagnosis.likelihood.linear.random_effects import place_runs
from evaluator.diagnosis.likelihood.noise.common_drift import MIDDLE, CommonNoise, Place, changed, common_drift
from evaluator.diagnosis.likelihood.preparation import friction_shifts, late_shifts, with_noise_of
from evaluator.diagnosis.likelihood.problem import Problem

# A search is repeated where its best model lowers the noise below this share, or on open ground lifts it as far above.
SETTLED_NOISE = 0.9


def settled_noise(search: Search, best: frozenset[str], common: CommonNoise | None = None) -> Problem | None:
    """The problem with noise estimated from the residuals of a fitted set; None if it is unchanged or larger.

    None also if a run that is held out cannot be simulated with this set. common: of this set, if it is known already.
    On open ground larger noise counts as well, because the previous estimate belongs to a set that is no longer the
    best.
    """
    fit, runs = search.fits[best], range(len(search.problem.data))
    # Without effects the drift was estimated at the beginning, or the misfit is too large to be a drift of the camera,
    # unless an effect that is not significant has just been dropped. On open ground the noise already contains all
    # residuals, of the camera, of friction or of the model.
    asked = (best or common) and not search.problem.open_ground
    drifting = _with(search.problem, common or common_noise(search, fit)) if asked else search.problem
    try:
        placed = place_runs(search.problem, fit.point, runs, fit.posterior.scatter)
    except FloatingPointError:  # a held-out run cannot be simulated with this model: its residuals are no noise
        return None
    problem = with_noise_of(drifting, placed)
    pairs = zip(problem.noise, search.problem.noise, strict=True)
    ratio = np.median([new[0].sigma_mm / old[0].sigma_mm for new, old in pairs])
    louder = search.problem.open_ground and ratio >= 1 / SETTLED_NOISE
    return problem if ratio <= SETTLED_NOISE or louder or drifting is not search.problem else None


def with_common_drift(search: Search, fit: Fit) -> Problem:
    """The problem with common drift and varying friction estimated from the residuals of a fit, compressed again.

    The same problem, if these are unchanged. A missing effect is partly attributed to drift; the effect must then
    explain more than the drift, and after it is included the drift is estimated again.
    """
    return _with(search.problem, common_noise(search, fit))


def _with(problem: Problem, common: CommonNoise) -> Problem:
    if (common.drift, common.wander) == (problem.common_drift, problem.friction_wander):
        return problem
    return replace(problem, common_drift=common.drift, friction_wander=common.wander)


def common_noise(search: Search, fit: Fit, begin: Place = MIDDLE) -> CommonNoise:
    """Common drift and varying friction that the residuals of a fit show; evidences of one search are comparable.

    begin: see common_drift.
    """
    problem = search.problem
    compressions = [problem.compressions[run] for run in fit.runs]
    views = [
        view if part.ground is None else changed(view, part.ground.undone)
        for view, part in zip(fit.linearized, compressions, strict=True)
    ]
    friction = friction_shifts(problem, fit.point, fit.runs)
    late = late_shifts(problem, fit.point, fit.runs)
    return common_drift(
        views,
        compressions,
        [problem.data[run].time_s[problem.compressions[run].used] for run in fit.runs],
        prior_precision(fit.columns, search.tolerance),
        problem.common_drift,
        [part.of_tracking(wanders).T for part, (_, wanders) in zip(compressions, friction, strict=True)],
        problem.watch.each,
        begin,
        [part.of_tracking(shifts).T for part, shifts in zip(compressions, late, strict=True)],
        problem.field_of_view,
        problem.drifting_axes,
    )
