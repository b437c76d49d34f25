"""The effects of diagnosis.json: what was chosen, its sizes with intervals, and what the runs cannot tell from it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from evaluator.discrepancy.diagnosis import Diagnosis
from evaluator.discrepancy.free import FreeTerm
from evaluator.discrepancy.rivals import SAME_SIGMAS, is_free
from evaluator.discrepancy.terms import Parameters, Term
from evaluator.discrepancy.where import Interval, root_mean_squares
from simulator.effects.catalogue import EFFECTS

Json = dict[str, Any]

DRAWS = 4000
DRAW_SEED = 20120612  # intervals of directions and anchors are read from draws; the same input gives the same output


def effects(diagnosis: Diagnosis) -> list[Json]:
    """What was chosen; where nothing that could be fitted follows the marks, the disagreement itself."""
    explained = diagnosis.chosen and diagnosis.follows
    if explained or diagnosis.verdict != "unknown" or diagnosis.pieces is None or diagnosis.pieces.empty:
        return [_effect(diagnosis, effect) for effect in sorted(diagnosis.chosen)]
    sizes = root_mean_squares(diagnosis.pieces)
    return [
        {
            "id": "free-form",
            "name": "; ".join(["an error of the robot's speed", *(item.sentence for item in diagnosis.where[:1])]),
            "parameters": {f"rms_{name}": _bounded(values) for name, values in sizes.items()},
            "equivalent": [],
            "probability": 1.0,
            "fitted": False,
            "terms": [
                {
                    "channel": item.quantity,
                    "basis": item.by,
                    "parity": item.parity or None,
                    "coefficients": [_bounded(values) for values in item.sizes],
                }
                for item in diagnosis.where
            ],
        }
    ]


def _bounded(values: Interval) -> Json:
    value, low, high = values
    return {"value": rounded(value), "low": rounded(low), "high": rounded(high)}


def _effect(diagnosis: Diagnosis, effect: str) -> Json:
    assert diagnosis.terms is not None
    assert diagnosis.standing is not None
    term = diagnosis.terms[effect]
    probability = diagnosis.standing.containing(effect)
    shown: Json = {
        "id": "free-form" if is_free(effect) else effect,
        "name": term.describe() if isinstance(term, FreeTerm) else EFFECTS[effect].name,
        "parameters": parameters(diagnosis, term),
        "equivalent": equivalents(diagnosis, effect),
        "probability": round(probability, 4),
    }
    if isinstance(term, FreeTerm):
        shown["terms"] = [
            {"channel": item.channel, "basis": item.basis, "pattern": item.pattern} for item in term.items
        ]
    return shown


def equivalents(diagnosis: Diagnosis, effect: str) -> list[str]:
    """Effects that these runs cannot tell from a named one, the nearest first."""
    apart = dict((diagnosis.separation or {}).get(effect, {}))
    apart.pop("", None)
    near = sorted((distance, other) for other, distance in apart.items() if distance < SAME_SIGMAS)
    return [other for _, other in near]


def parameters(diagnosis: Diagnosis, term: Term) -> Json:
    """Value and 95 % interval of every physical parameter of a term of the chosen set."""
    fit = diagnosis.fit
    values = fit.point.terms[term.id]
    if term.leaps:
        return _leap(term, values)
    own = [i for i, column in enumerate(fit.columns) if column.key == term.id]
    covariance = fit.posterior.covariance[np.ix_(own, own)]
    # the scatter is estimated from few runs: the spread over its grid is in the covariance, Student's tail is not
    # nor is a covariance that rounding has made a little uneven (effects that all but stand for each other) an error
    draws = np.random.default_rng(DRAW_SEED).multivariate_normal(
        values, covariance, DRAWS, check_valid="ignore", method="svd"
    )
    physical = [term.physical(term.clipped(tuple(row))) for row in draws]
    best = term.physical(values)
    return {name: _interval(name, best, [item[name] for item in physical]) for name in best}


def _interval(name: str, best: Parameters, draws: Sequence[float]) -> Json:
    value = best[name]
    if name.endswith(("azimuth_deg", "phase_deg", "direction_deg")):
        period = 180.0 if name == "direction_deg" else 360.0
        turned = (np.array(draws) - value + period / 2) % period - period / 2
        low, high = value + np.percentile(turned, [2.5, 97.5])
    else:
        low, high = np.percentile(draws, [2.5, 97.5])
    return _bounded((value, float(low), float(high)))


def _leap(term: Term, values: Sequence[float]) -> Json:
    """A dead band lies anywhere between two commands that were given."""
    low, high = next(edges for edges in term.between if edges[0] <= values[0] <= edges[1])
    return {"rpm": _bounded((values[0], low, high))}


def rounded(value: float) -> float | None:
    """Six significant digits; None for what JSON cannot say."""
    return float(f"{value:.6g}") if math.isfinite(value) else None
