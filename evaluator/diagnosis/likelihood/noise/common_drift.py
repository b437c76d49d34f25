"""Drift that both marks share within a run: the camera moves against the plate, by some micrometres in seconds.

Warm air over a lamp makes it wander, a stand that warms or a tripod that settles makes it creep. The distance of the
marks does not show it (see drift.py) and fast modes do not either. In the path of one run it cannot be told from
motion; but it does not repeat itself from run to run, and it leaves the heading alone. So its size is asked of the
slow left-overs of all runs together, with start poses, random effects and common parameters free: an effect, which
repeats itself, must then bring more than such a drift explains.
Source: restricted maximum likelihood, Patterson & Thompson (1971), Biometrika 58, 545.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from evaluator.diagnosis.likelihood.features import Compression
from evaluator.diagnosis.likelihood.mixed_model import Linearized, MixedModel, reduce_runs
from evaluator.diagnosis.likelihood.noise.drift import BELIEVED
from evaluator.diagnosis.likelihood.noise.tracking import NO_DRIFT, Drift, correlated

Floats = NDArray[np.float64]

# Of what wanders, the size after one second, mm, and of what creeps the speed, mm/s. Below a quarter of a micrometre
# they change no verdict; of more than 10 µm, a tenth of a pixel and more, someone touched the camera. What lasts long
# is seen by what it has done so far, its size over the root of its time: so both are hardly confounded.
RATES_MM = (0.0, *np.geomspace(2.5e-4, 1e-2, 9).tolist())
LASTING_S = (1.0, 4.0, 16.0)  # a shorter one is seen in the spectrum, of a longer one a run shows the beginning
BEGIN = (5, 1, 5)  # of size, time and creep: in the middle of each


def drift_of(rate: int, time: int, creep: int) -> Drift:
    """The drift at a place of the grid."""
    return Drift(RATES_MM[rate] * float(np.sqrt(LASTING_S[time])), LASTING_S[time], RATES_MM[creep])


# What a model is fitted with before the drift is known: friction and gains of single runs must not have to follow it.
USUAL_DRIFT = drift_of(*BEGIN)


@dataclass(frozen=True)
class _Run:
    """One run in features of which the noise without drift has unit variance, and of what wanders are independent.

    view: its linear view. wanders: variances (k,) that 1 mm of it adds to the features of each coordinate of the
    midpoint. creeps: what 1 mm/s adds to them, (k,).
    """

    view: Linearized
    wanders: Floats
    creeps: Floats


def common_drift(
    views: Sequence[Linearized],
    compressions: Sequence[Compression],
    times_s: Sequence[Floats],
    prior_precision: Floats,
    assumed: Drift,
) -> Drift:
    """The drift of the midpoint that runs show in their linear views, columns of common parameters included.

    times_s: of the frames used. prior_precision: (p,) of the common parameters. assumed: what the views are whitened
    with. Nothing where no drift explains them as well within what chance allows.
    """
    frames = list(zip(compressions, times_s, strict=True))

    @cache
    def lasting(time: int) -> list[_Run]:
        return [_run(view, *frame, LASTING_S[time], assumed) for view, frame in zip(views, frames, strict=True)]

    @cache
    def log_evidence(rate: int, time: int, creep: int) -> float:
        return _log_evidence(lasting(time), drift_of(rate, time, creep), prior_precision)

    best, last = BEGIN, None
    while best != last:  # uphill: the evidence has one maximum
        last = best
        best = max(_around(best), key=lambda place: log_evidence(*place))
    if log_evidence(*best) - log_evidence(0, best[1], 0) <= BELIEVED:
        return NO_DRIFT
    return drift_of(*best)


def _around(place: tuple[int, int, int]) -> list[tuple[int, int, int]]:
    """A place of the grid and its neighbours."""
    rate, time, creep = place
    steps = [(0, 0, 0), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
    near = [(rate + i, time + j, creep + k) for i, j, k in steps]
    most = len(RATES_MM)
    return [(i, j, k) for i, j, k in near if 0 <= i < most and 0 <= j < len(LASTING_S) and 0 <= k < most]


def _run(view: Linearized, compression: Compression, time_s: Floats, lasting_s: float, assumed: Drift) -> _Run:
    """The run in the features that make both the noise without drift and what wanders diagonal."""
    functional = compression.functional[0]
    wanders = functional.T @ correlated(time_s, lasting_s, functional)
    noise = np.eye(len(wanders)) - functional.T @ assumed.times(time_s, functional)
    variances, vectors = eigh(wanders, noise)
    creeps = vectors.T @ (functional.T @ (time_s - time_s[0]))
    return _Run(_of_midpoint(vectors.T, view), np.maximum(variances, 0.0), creeps)


def _of_midpoint(matrix: Floats, view: Linearized) -> Linearized:
    """The view with the features of each coordinate of the midpoint, the first ones, times a matrix (k, k)."""
    count = len(matrix)

    def turned(block: Floats) -> Floats:
        return np.concatenate([matrix @ block[:count], matrix @ block[count : 2 * count], block[2 * count :]])

    return Linearized(*(turned(part) for part in (view.response, view.common, view.start, view.scatter)))


def _log_evidence(runs: Sequence[_Run], drift: Drift, prior_precision: Floats) -> float:
    """Log evidence of all runs with such a drift, start poses free."""
    views, widths = [], 0.0
    for run in runs:
        variance = 1 + drift.size_mm**2 * run.wanders
        creeps = drift.creep_mm_s * run.creeps / np.sqrt(variance)
        square = float(creeps @ creeps)
        # of 1 + c·cᵀ, to the power -1/2: it lessens what lies along c
        less = (1 - 1 / np.sqrt(1 + square)) / max(square, 1e-300)
        white = (np.eye(len(creeps)) - less * np.outer(creeps, creeps)) / np.sqrt(variance)
        view = _of_midpoint(white, run.view)
        views.append(view)
        widths += 2 * float(np.sum(np.log(variance)) + np.log1p(square))
        widths += float(np.linalg.slogdet(view.start.T @ view.start)[1])
    model = MixedModel(reduce_runs(views), prior_precision)
    return model.posterior(range(len(prior_precision))).log_evidence - widths / 2
