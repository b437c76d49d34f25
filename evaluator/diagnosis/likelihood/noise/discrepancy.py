"""Size of unmodelled motion on open ground, from the residuals of the current model.

A microrobot on a plate repeats its runs to some micrometres, so that slow residuals indicate an effect. A robot of a
metre on a floor or outdoors does not: two runs with the same command end decimetres apart within two seconds. Its slow
residuals are therefore treated as noise, like the residual variance of a regression, and estimated again whenever the
model has improved. Models are then compared by the size of their residuals, and no model is inadequate because of its
residuals alone. Friction and gains of single runs are part of this noise: see problem.Problem.open_ground.
Source: Kennedy & O'Hagan (2001), J. R. Stat. Soc. B 63, 425.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.noise.tracking import Drift, Noise

Floats = NDArray[np.float64]

FAR_OUT = 2.0  # times the usual residual of runs: Huber's limit, above which a run has less weight
# Of mean squares made of a few slow modes: median over mean of chi-square with three degrees of freedom.
MEDIAN_OVER_MEAN = 0.79


def with_discrepancy(
    noise: Sequence[tuple[Noise, ...]], times_s: Sequence[Floats], left_over_mm: Floats
) -> list[tuple[Noise, ...]]:
    """The noise of every run's channels with an added part as long as the run, of the size of its residuals.

    left_over_mm: (n, 2) of every run, from left_over. A run with more than FAR_OUT times the usual residual (it was
    pushed, or rested instead of moving) has a larger added part.
    """
    usual = np.sqrt(np.median(left_over_mm**2, axis=0) / MEDIAN_OVER_MEAN)
    result = []
    for parts, time, own in zip(noise, times_s, left_over_mm, strict=True):
        size = usual * np.sqrt(np.maximum(own / (FAR_OUT * usual + 1e-300), 1.0))
        lasting_s = max(float(time[-1] - time[0]), 1e-9)
        drifting = tuple(
            replace(part, drift=Drift(float(np.sqrt(max(amount**2 - part.sigma_mm**2, 0.0))), lasting_s))
            for part, amount in zip(parts[:3], size[[0, 0, 1]], strict=True)
        )
        result.append((*drifting, *parts[3:]))
    return result


def left_over(measured: Floats, predicted: Floats, half_distance_mm: float) -> Floats:
    """RMS residuals (2,), mm, of the midpoint (per coordinate) and of the direction, with the best start pose.

    measured, predicted: channels (n, 4), see features.channels_of; NaN where the marks are not seen. NaN for a run that
    cannot be simulated.
    """
    seen = np.isfinite(measured).all(axis=1)
    here, there = measured[seen], predicted[seen]
    places = [part[:, 0] + 1j * part[:, 1] for part in (here, there)]
    off, model = (part - part.mean() for part in places)
    # the turn that is best for both: places weigh by their distance, directions by that of the marks
    turns = np.exp(1j * (here[:, 2] - there[:, 2]))
    turn = np.angle(np.sum(off * np.conj(model)) + half_distance_mm**2 * np.sum(turns))
    place = np.mean(np.abs(off - np.exp(1j * turn) * model) ** 2) / 2
    direction = np.mean((half_distance_mm * np.angle(turns * np.exp(-1j * turn))) ** 2)
    return np.asarray(np.sqrt([place, direction]))
