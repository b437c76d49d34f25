"""Drift that both marks share within a run: the camera moves against the plate, by some micrometres in seconds.

A stand that warms, a tripod that settles, warm air over a lamp. The distance of the marks does not show it (see
drift.py) and fast modes do not either. In the path of one run it cannot be told from motion; but it does not repeat
itself from run to run, and it leaves the heading alone. So its size is asked of the slow left-overs of all runs
together, with start poses, random effects and common parameters free: an effect, which repeats itself, must then bring
more than such a drift explains.
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

# Size after one second, mm. Below a quarter of a micrometre it changes no verdict; of more than 10 µm, a tenth of a
# pixel and more, someone touched the camera. A drift that lasts long is seen by what it has done so far, its size over
# the root of its time: in these coordinates the two are hardly confounded.
RATES_MM = (0.0, *np.geomspace(2.5e-4, 1e-2, 9).tolist())
LASTING_S = (1.0, 4.0, 16.0)  # a shorter one is seen in the spectrum, of a longer one a run shows the beginning
BEGIN = (5, 1)  # of both: in the middle


@dataclass(frozen=True)
class _Run:
    """One run in features of which the noise without drift has unit variance, and those of drift are independent.

    view: its linear view. drift: variances (d,) that a drift of 1 mm adds to its features.
    """

    view: Linearized
    drift: Floats


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
    def log_evidence(rate: int, time: int) -> float:
        return _log_evidence(lasting(time), _drift(rate, time).size_mm, prior_precision)

    best, last = BEGIN, None
    while best != last:  # uphill: the evidence has one maximum
        last = best
        around = [(best[0] + i, best[1] + j) for i, j in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))]
        inside = [(i, j) for i, j in around if 0 <= i < len(RATES_MM) and 0 <= j < len(LASTING_S)]
        best = max(inside, key=lambda place: log_evidence(*place))
    if log_evidence(*best) - log_evidence(0, best[1]) <= BELIEVED:
        return NO_DRIFT
    return _drift(*best)


def _drift(rate: int, time: int) -> Drift:
    return Drift(RATES_MM[rate] * float(np.sqrt(LASTING_S[time])), LASTING_S[time])


def _run(view: Linearized, compression: Compression, time_s: Floats, lasting_s: float, assumed: Drift) -> _Run:
    """The run in the features that make both the noise without drift and the drift diagonal."""
    functional = compression.functional[0]
    of_drift = functional.T @ correlated(time_s, lasting_s, functional)
    noise = np.eye(len(of_drift)) - assumed.size_mm**2 * (
        functional.T @ correlated(time_s, assumed.lasting_s, functional)
    )
    variances, vectors = eigh(of_drift, noise)
    count = len(variances)

    def turned(block: Floats) -> Floats:
        return np.concatenate([vectors.T @ block[:count], vectors.T @ block[count : 2 * count], block[2 * count :]])

    blocks = (turned(part) for part in (view.response, view.common, view.start, view.scatter))
    drift = np.zeros(len(view.response))
    drift[: 2 * count] = np.tile(np.maximum(variances, 0.0), 2)
    return _Run(Linearized(*blocks), drift)


def _log_evidence(runs: Sequence[_Run], size_mm: float, prior_precision: Floats) -> float:
    """Log evidence of all runs with a drift of this size, start poses free."""
    views, widths = [], 0.0
    for run in runs:
        variance = 1 + size_mm**2 * run.drift
        weight = 1 / np.sqrt(variance)
        parts = (run.view.response, run.view.common, run.view.start, run.view.scatter)
        view = Linearized(*(part * (weight if part.ndim == 1 else weight[:, None]) for part in parts))
        views.append(view)
        widths += float(np.sum(np.log(variance))) + float(np.linalg.slogdet(view.start.T @ view.start)[1])
    model = MixedModel(reduce_runs(views), prior_precision)
    return model.posterior(range(len(prior_precision))).log_evidence - widths / 2
