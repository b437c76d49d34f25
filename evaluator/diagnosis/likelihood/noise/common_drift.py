"""Noise common to both marks that does not repeat between runs: drift, and friction that varies along the path.

A camera moves relative to the plate by some micrometres within seconds: warm air over a lamp causes random drift, a
stand that warms up or a tripod that settles causes creep. Neither the distance of the marks (see drift.py) nor fast
modes show it, and in a single run it cannot be distinguished from motion. But it does not repeat between runs, and does
not change the heading. Its size is therefore estimated from the slow residuals of all runs together, with start poses,
random effects and common parameters free; an effect, which repeats, must then explain more than such a drift. Varying
friction (friction_wander.py) does change the heading; it is estimated together with the drift, because each could be
taken for the other. In poses of another tracker the heading drifts as well, in proportion to its noise.
Source: restricted maximum likelihood, Patterson & Thompson (1971), Biometrika 58, 545.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from evaluator.diagnosis.inference.watch import Each
from evaluator.diagnosis.likelihood.features import Compression
from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized
from evaluator.diagnosis.likelihood.noise import friction_wander
from evaluator.diagnosis.likelihood.noise.drift import BELIEVED
from evaluator.diagnosis.likelihood.noise.drift_evidence import OF_MARKS, RunInModes, RunsInModes
from evaluator.diagnosis.likelihood.noise.tracking import NO_DRIFT, Drift, correlated

Floats = NDArray[np.float64]

# Size of a random drift after one second, mm, and speed of a creep, mm/s, in the field of view of the paper's robot.
# Below a quarter of a micrometre they change no verdict; more than 10 µm, a tenth of a pixel and more, mean that the
# camera was touched. In a field seven times as large, of a robot of 40 mm, a simulated tracker wandered by 27 µm. A
# drift is described by its size over the root of its correlation time, which determines its growth, so that rate and
# time are hardly confounded.
RATES_MM = (0.0, *np.geomspace(2.5e-4, 1e-2, 9).tolist())
# The spectrum shows shorter correlation times; a run is too short to distinguish longer ones.
LASTING_S = (1.0, 4.0, 16.0)
BEGIN = (5, 1, 5)  # of size, time and creep: in the middle of each


Place = tuple[int, int, int, int]  # on the grid: rate, time and creep of a drift, rate of friction
MIDDLE: Place = (*BEGIN, friction_wander.BEGIN)


def drift_of(rate: int, time: int, creep: int, field: float = 1.0) -> Drift:
    """The drift at a point of the grid; field: as of Problem.field_of_view."""
    return Drift(field * RATES_MM[rate] * float(np.sqrt(LASTING_S[time])), LASTING_S[time], field * RATES_MM[creep])


def usual_drift(field: float) -> Drift:
    """Drift that a fit assumes before it is estimated; without one, friction and gains of runs would follow it."""
    return drift_of(*BEGIN, field)


@dataclass(frozen=True)
class CommonNoise:
    """Drift and rate of friction that runs show, and the largest log evidence of their views over all of both.

    place: of that evidence, where a search for another model of the same runs should begin.
    """

    drift: Drift
    wander: float
    log_evidence: float
    place: Place = MIDDLE


def common_drift(
    views: Sequence[Linearized],
    compressions: Sequence[Compression],
    times_s: Sequence[Floats],
    prior_precision: Floats,
    assumed: Drift,
    friction: Sequence[Floats],
    each: Each = map,
    begin: Place = MIDDLE,
    late: Sequence[Floats] | None = None,
    field: float = 1.0,
    axes: int = OF_MARKS,
) -> CommonNoise:
    """The drift of the midpoint that runs show in their linear views, and the rate at which friction wanders.

    views: columns of common parameters included. times_s: of the frames used. prior_precision: (p,) of the common
    parameters. assumed: the drift for which the views are whitened; they are not whitened for varying friction and late
    changes.
    friction: features (d, m) of each run by the modes of wander_shifts. each: does independent pieces of work. begin:
    where the search begins on the grid. late: features (d, c) of each run by one sigma of each late change of its
    commands, if there are any. field, axes: as of Problem. Drift or rate is 0 if the views are explained as
    well without it, within chance. Evidences of several models are comparable if their views are whitened alike.
    """
    late = late or [part[:, :0] for part in friction]
    frames = list(zip(views, compressions, times_s, friction, late, strict=True))

    @cache
    def lasting(time: int) -> RunsInModes:
        return RunsInModes([_in_modes(*frame, LASTING_S[time], assumed, axes) for frame in frames], axes)

    @cache
    def log_evidence(rate: int, time: int, creep: int, walk: int) -> float:
        drift = drift_of(rate, time, creep, field)
        return lasting(time).log_evidence(drift, friction_wander.RATES[walk], prior_precision)

    def uphill(place: Place, free: Sequence[int]) -> Place:
        last = None
        while place != last:  # the evidence has one maximum
            last, near = place, _around(place, free)
            for rate, time in {at[:2] for at in near}:  # before the parallel work, which would compute them repeatedly
                lasting(time).weighted(drift_of(rate, time, 0, field).size_mm)
            evidences = list(each(lambda at: log_evidence(*at), near))
            place = near[int(np.argmax(evidences))]
        return place

    best = top = uphill(begin, range(4))
    largest = log_evidence(*top)
    even = uphill((*best[:3], 0), range(3))
    if largest - log_evidence(*even) <= BELIEVED:
        best = even
    still = uphill((0, best[1], 0, best[3]), [3] if best[3] else [])
    if log_evidence(*best) - log_evidence(*still) <= BELIEVED:
        return CommonNoise(NO_DRIFT, friction_wander.RATES[still[3]], largest, top)
    return CommonNoise(drift_of(*best[:3], field), friction_wander.RATES[best[3]], largest, top)


def _around(place: Place, free: Sequence[int]) -> list[Place]:
    """A point of the grid and its neighbours along the free axes."""
    most = len(RATES_MM), len(LASTING_S), len(RATES_MM), len(friction_wander.RATES)
    found = [place]
    for axis in free:
        for moved in (place[axis] + 1, place[axis] - 1):
            if 0 <= moved < most[axis]:
                near = list(place)
                near[axis] = moved
                found.append((near[0], near[1], near[2], near[3]))
    return found


def _in_modes(
    view: Linearized,
    compression: Compression,
    time_s: Floats,
    friction: Floats,
    late: Floats,
    lasting_s: float,
    assumed: Drift,
    axes: int,
) -> RunInModes:
    """The run in features for which the covariances of noise without drift and of random drift are diagonal."""
    functional = compression.functional[0]
    wanders = functional.T @ correlated(time_s, lasting_s, functional)
    noise = np.eye(len(wanders)) - functional.T @ assumed.times(time_s, functional)
    variances, vectors = eigh(wanders, noise)
    creeps = vectors.T @ (functional.T @ (time_s - time_s[0]))
    turned = partial(_of_first, vectors.T, axes)
    return RunInModes(changed(view, turned), np.maximum(variances, 0.0), creeps, turned(friction.T).T, turned(late.T).T)


def changed(view: Linearized, change: Callable[[Floats], Floats]) -> Linearized:
    """The linearization with its features transformed by a linear map of (m, d)."""
    parts = (change(part.T).T for part in (view.response, view.common, view.start, view.scatter))
    return Linearized(*parts)


def _of_first(matrix: Floats, axes: int, features: Floats) -> Floats:
    """Features (d,) or (m, d), those of each of the first channels times a matrix (k, k)."""
    *first, rest = np.split(features, [len(matrix) * (axis + 1) for axis in range(axes)], axis=-1)
    return np.concatenate([*(part @ matrix.T for part in first), rest], axis=-1)
