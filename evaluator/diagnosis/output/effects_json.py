"""The effects of diagnosis.json: what was chosen, its sizes with intervals, and what the runs cannot tell from it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.assessment.disagreement import Interval, root_mean_squares
from evaluator.diagnosis.assessment.model_comparison import SAME_SIGMAS, is_free
from evaluator.diagnosis.candidates.coordinates import Parameters, Term
from evaluator.diagnosis.candidates.free_form import FreeTerm
from evaluator.diagnosis.diagnosis import Diagnosis
from simulator.effects.catalogue import EFFECTS

Json = dict[str, Any]
Floats = NDArray[np.float64]

MISMATCH, SCALE = "drive-speed-mismatch", "drive-speed-scale"
DRAWS = 4000
DRAW_SEED = 20120612  # intervals of directions and anchors are read from draws; the same input gives the same output


def effects(diagnosis: Diagnosis) -> list[Json]:
    """What was chosen; where no term that was fitted says what is unknown, the disagreement itself."""
    said = diagnosis.verdict != "unknown" or (diagnosis.follows and any(map(is_free, diagnosis.chosen)))
    if said or diagnosis.pieces is None or diagnosis.pieces.empty:
        return _without_repetition([_effect(diagnosis, effect) for effect in sorted(diagnosis.chosen)], diagnosis)
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


def _without_repetition(found: list[Json], diagnosis: Diagnosis) -> list[Json]:
    """Effects with one cause told once: one wheel that is off makes a mismatch, and both together a scale."""
    ids = [effect["id"] for effect in found]
    if diagnosis.verdict != "effect" or not {MISMATCH, SCALE} <= set(ids):
        return found
    assert diagnosis.terms is not None
    drawn = _drawn(diagnosis, (diagnosis.terms[MISMATCH], diagnosis.terms[SCALE]))
    ratio, mean = drawn["left_over_right"], drawn["factor"]
    left_sound, right_sound = (
        bool(np.percentile(speed, 2.5) <= 1.0 <= np.percentile(speed, 97.5))
        for speed in (mean * 2 * ratio / (1 + ratio), mean * 2 / (1 + ratio))
    )
    if left_sound == right_sound:
        return found
    mismatch = found[ids.index(MISMATCH)]
    mismatch["name"] += f": the {'left' if right_sound else 'right'} wheel alone is off"
    return [effect for effect in found if effect["id"] != SCALE]


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
    best, drawn = term.physical(values), _drawn(diagnosis, (term,))
    return {name: _interval(name, best, drawn[name]) for name in best}


def _drawn(diagnosis: Diagnosis, terms: Sequence[Term]) -> dict[str, Floats]:
    """Draws of all physical parameters of some terms of the chosen set together, by name, (DRAWS,) each."""
    fit = diagnosis.fit
    mean, covariance = np.array([fit.point.value(column) for column in fit.columns]), fit.posterior.covariance
    # the scatter is estimated from few runs: the spread over its grid is in the covariance, Student's tail is not
    # nor is a covariance that rounding has made a little uneven (effects that all but stand for each other) an error
    draws = np.random.default_rng(DRAW_SEED).multivariate_normal(
        mean, covariance, DRAWS, check_valid="ignore", method="svd"
    )
    for term in terms:
        if term.id in diagnosis.ridges:
            draws = diagnosis.ridges[term.id].bend(draws, mean, covariance)
    found: dict[str, Floats] = {}
    for term in terms:
        own = [i for i, column in enumerate(fit.columns) if column.key == term.id]
        physical = [term.physical(term.clipped(tuple(row))) for row in draws[:, own] + np.array(term.neutral)]
        found |= {name: np.array([item[name] for item in physical]) for name in physical[0]}
    return found


def _interval(name: str, best: Parameters, draws: Floats) -> Json:
    value = best[name]
    if name.endswith(("azimuth_deg", "phase_deg", "direction_deg")):
        period = 180.0 if name == "direction_deg" else 360.0
        turned = (draws - value + period / 2) % period - period / 2
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
