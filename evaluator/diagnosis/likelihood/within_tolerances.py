"""How well a run agrees with its file if the values of the robot are taken within their tolerances.

The path of a robot whose wheels nearly lose their grip depends strongly on values that a laboratory hardly knows: on
tires without magnets, a centre of gravity 0.06 mm aside halved the turn of a run, which then fitted another command
better than its own.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from evaluator.diagnosis.likelihood.features import rms_apart
from evaluator.diagnosis.likelihood.known_to import acting, predicted_sigmas, quantities
from evaluator.diagnosis.likelihood.run_data import START_POSE, RunData, Task, aligned_starts
from evaluator.diagnosis.likelihood.simulation import Simulated
from evaluator.settings import KnownTo
from simulator.robot import Robot

Floats = NDArray[np.float64]
Points = NDArray[np.complex128]

MOST_SIGMAS = 2.0  # by which a value may deviate from the file
FRICTION_SIGMA = 0.1  # of a run: dust and humidity change friction by some per cent
ROUNDS, SHARES = 5, (1.0, 0.3, 0.1)  # of linearization, and of its steps: slipping is no linear function of the values
SLOPE = 0.1  # sigmas of a value from which its slope is taken: a whole one may lead to the other turn
RIDGE = 0.1  # see _step


def misfit_within_tolerances(run: RunData, robot: Robot) -> float:
    """RMS distance of a run's marks from the best simulation of its command within tolerances, mm.

    The start pose is free. run: with both marks in every frame. Infinite if the run cannot be simulated.
    """
    known = quantities(KnownTo(), robot, [run])
    sigmas = {item.key: item.tolerance for item in known} | {k: v for k, v in robot.tolerance.items() if v > 0}
    sigmas = acting(sigmas, {entry.id for entry in robot.effect})
    forward = Simulated([robot], [run], {}, predicted_sigmas(known))
    keys = list(sigmas)
    (start,) = np.nan_to_num(aligned_starts([run], forward))
    measured = _line(run.marks_mm)

    def task(values: Floats) -> Task:
        """Deviations of the keys, and of friction, in sigmas."""
        per_run = start.copy()
        per_run[START_POSE] = FRICTION_SIGMA * values[-1]
        return Task(0, tuple(per_run), {key: sigmas[key] * value for key, value in zip(keys, values, strict=False)})

    def misfit(marks: Floats) -> float:
        return rms_apart(measured, _line(marks)) if np.isfinite(marks).all() else np.inf

    # from the best of small steps of single values: one of them leads to each of two turns that a pivot may take
    singles = [np.zeros(len(keys) + 1), *np.eye(len(keys) + 1), *-np.eye(len(keys) + 1)]
    begun = [misfit(marks) for marks in forward.marks([task(way) for way in singles])]
    values, best = singles[int(np.argmin(begun))], np.inf
    for _ in range(ROUNDS):
        here, *beside = forward.marks([task(values + SLOPE * step) for step in (0 * values, *np.eye(len(values)))])
        best = misfit(here)
        if not np.isfinite(best):
            break
        step = _step(values, measured, _line(here), [np.nan_to_num(_line(part - here) / SLOPE) for part in beside])
        tried = [values + share * step for share in SHARES]
        found = [misfit(marks) for marks in forward.marks([task(way) for way in tried])]
        if not min(found) < best:
            break
        best, values = min(found), tried[int(np.argmin(found))]
    return best


def _line(marks: Floats) -> Points:
    """Both marks (n, 4) as points (2n,) of the complex plane."""
    return np.asarray((marks[:, ::2] + 1j * marks[:, 1::2]).ravel())


def _step(values: Floats, measured: Points, here: Points, changes: Sequence[Points]) -> Floats:
    """Step of the values, within MOST_SIGMAS of 0, that brings a path nearest to the measured one, start pose free.

    changes: of the path for a step of 1 of each value. A ridge of a tenth of the misfit holds values that have hardly
    any influence, or the same as others.
    """
    off, path = measured - measured.mean(), here - here.mean()
    turn = np.vdot(path, off)
    way = turn / max(abs(turn), 1e-300)
    columns = [*(way * change for change in changes), 1j * way * path, np.ones_like(here), 1j * np.ones_like(here)]
    design = np.array([np.concatenate([column.real, column.imag]) for column in columns]).T
    left = np.concatenate([(off - way * path).real, (off - way * path).imag])
    count = len(values)
    ridge = RIDGE * float(np.linalg.norm(left)) * np.eye(count, len(columns))
    low, high = (np.append(side * MOST_SIGMAS - values, np.full(3, side * np.inf)) for side in (-1, 1))
    target = np.concatenate([left, -np.diag(ridge) * values])
    # hundreds of rows become some thirty
    triangle = np.asarray(np.linalg.qr(np.column_stack([np.vstack([design, ridge]), target]), mode="r"))
    return np.asarray(lsq_linear(triangle[:, :-1], triangle[:, -1], (low, high), method="bvls").x[:count])
