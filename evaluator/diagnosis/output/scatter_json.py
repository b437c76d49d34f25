"""Scatter from run to run for diagnosis.json, and whether rounded commands explain that of the wheel speeds."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from evaluator.diagnosis.inference.fitted_model import prior_precision
from evaluator.diagnosis.likelihood.linear.mixed_model import USUAL_SCATTER, MixedModel
from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.output.content import RunToRunContent
from evaluator.diagnosis.output.effects_json import rounded
from evaluator.diagnosis.result import Diagnosis

STEPS_RPM = (100.0, 50.0, 20.0, 10.0, 5.0, 2.0, 1.0, 0.5)  # to which people round
FEWEST_ROUNDED = 6  # speeds other than zero: that so many are multiples of five by chance is once in 15,000


def run_to_run(diagnosis: Diagnosis) -> RunToRunContent:
    """Scatter from run to run in the chosen model."""
    fit, search = diagnosis.fit, diagnosis.search
    assert search is not None
    model = MixedModel(fit.reduced, prior_precision(fit.columns, search.tolerance))
    tau = fit.posterior.scatter[:2]
    low, high = model.scatter_interval(range(len(fit.columns))).T
    # the interval knows no bounds of effects: where one ends at a bound, the scatter takes up what it cannot
    low, high = np.minimum(low, tau), np.maximum(high, tau)
    found: RunToRunContent = {
        "friction": rounded(float(tau[0])),
        "friction_95": [rounded(float(low[0])), rounded(float(high[0]))],
        "wheel_speed": rounded(float(tau[1])),
        "wheel_speed_95": [rounded(float(low[1])), rounded(float(high[1]))],
    }
    step = rounding_rpm([diagnosis.session.data[run] for run in fit.runs], float(low[1]), float(high[1]))
    return found if step is None else {**found, "commands_rounded_to_rpm": step}


def rounding_rpm(runs: Sequence[RunData], low: float, high: float) -> float | None:
    """The largest step to which all commands seem to be rounded, if that explains a scatter of the wheel speeds.

    low, high: 95 % interval of the scatter, relative. Rounding to a step errs by the step over the root of 12. None for
    a step that moves speeds by less than motors vary.
    """
    speeds = np.abs([speed for run in runs if run.log is None for speed in run.command if speed])
    if len(speeds) < FEWEST_ROUNDED:
        return None
    for step in STEPS_RPM:
        if np.allclose(speeds / step, np.round(speeds / step), rtol=0.0, atol=1e-6):
            expected = step / math.sqrt(12) * float(np.sqrt(np.mean(speeds**-2.0)))
            return step if max(low, USUAL_SCATTER[1]) <= expected <= high else None
    return None
