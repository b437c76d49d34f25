"""Size of unmodelled motion on open ground, from the residuals of the current model.

A microrobot on a plate repeats its runs to some micrometres, so that all that is slow and not explained is an effect.
A robot of a metre on a floor or outdoors does not: the same command, driven twice, ends decimetres apart within two
seconds. Its slow left-overs are therefore part of the noise, as the residual variance is in a regression, and are
estimated anew whenever the model has improved. Models then compete by how much less they leave, and none can be called
inadequate by its left-overs alone. Friction and gains of single runs are part of it, not beside it: see
problem.Problem.open_ground.
Source: Kennedy & O'Hagan (2001), J. R. Stat. Soc. B 63, 425.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.noise.tracking import Drift, Noise

Floats = NDArray[np.float64]

FAR_OUT = 2.0  # times the usual left-over of runs: Huber's limit, beyond which a run counts less
# Of mean squares made of a few slow modes: median over mean of chi-square with three degrees of freedom.
MEDIAN_OVER_MEAN = 0.79


def with_discrepancy(
    noise: Sequence[tuple[Noise, ...]], times_s: Sequence[Floats], left_over_mm: Floats
) -> list[tuple[Noise, ...]]:
    """The noise of every run's channels with a part that lasts as long as the run, of the size of its left-overs.

    left_over_mm: (n, 2) of every run, from left_over. A run that leaves more than FAR_OUT times what is usual (it was
    pushed, or rested though it should have moved) gets more of it.
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
    """RMS left-overs (2,), mm, of the midpoint (a coordinate) and of the direction, the start pose at its best.

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
