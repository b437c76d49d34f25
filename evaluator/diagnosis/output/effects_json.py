"""The effects of diagnosis.json: sizes with intervals, and effects that the runs cannot distinguish from them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.assessment.cross_validation import covariance_of
from evaluator.diagnosis.assessment.model_comparison import SAME_SIGMAS, Set, is_free
from evaluator.diagnosis.assessment.residuals.disagreement import Interval, root_mean_squares
from evaluator.diagnosis.assessment.verdict import may_be_right
from evaluator.diagnosis.candidates.free_form import FreeTerm
from evaluator.diagnosis.inference.steps_of_a_term import likely_interval
from evaluator.diagnosis.output.content import Bounded, DeterminedContent, EffectContent
from evaluator.diagnosis.output.silence import silent_reaches
from evaluator.diagnosis.result import Diagnosis
from simulator.effects.catalogue import EFFECTS
from simulator.effects.coordinates import Candidate

Floats = NDArray[np.float64]

DRAWS = 4000  # a bound of 95 % is then known to 4 % of a standard deviation
# Largest share of the draws for sets with a further effect, and fewest draws of one: fewer move no end of an interval.
MOST_BESIDE, FEWEST_DRAWS = 0.5, DRAWS // 40
DRAW_SEED = 20120612  # fixed: the same input gives the same intervals


def effects(diagnosis: Diagnosis) -> list[EffectContent]:
    """The chosen effects; if the verdict is "unknown" and nothing explains the runs, the disagreement itself."""
    if diagnosis.negligible:
        return []
    fitted = diagnosis.verdict != "unknown" or (diagnosis.follows and bool(diagnosis.chosen))
    if fitted or diagnosis.pieces is None or diagnosis.pieces.empty:
        return _without_repetition(
            [effect_content(diagnosis, effect) for effect in sorted(diagnosis.chosen)], diagnosis
        )
    sizes = root_mean_squares(diagnosis.pieces)
    return [
        {
            "id": "free-form",
            "name": "an error of the robot's speed",  # `where` says on what it depends
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


def _without_repetition(found: list[EffectContent], diagnosis: Diagnosis) -> list[EffectContent]:
    """The effects without those that have a single cause with another one (Effect.single_cause), which names it."""
    if diagnosis.verdict != "effect":
        return found
    assert diagnosis.terms is not None
    ids = [effect["id"] for effect in found]
    said = set()
    for effect in found:
        cause = EFFECTS[effect["id"]].single_cause if effect["id"] in EFFECTS else None
        if cause is None or cause.other not in ids:
            continue
        words = cause.words(_drawn(diagnosis, (diagnosis.terms[effect["id"]], diagnosis.terms[cause.other])))
        if words:
            effect["name"] += f": {words}"
            said.add(cause.other)
    return [effect for effect in found if effect["id"] not in said]


def _bounded(values: Interval) -> Bounded:
    value, low, high = values
    return {"value": rounded(value), "low": rounded(low), "high": rounded(high)}


def effect_content(diagnosis: Diagnosis, effect: str) -> EffectContent:
    """One effect of the chosen set."""
    assert diagnosis.terms is not None
    assert diagnosis.standing is not None
    assert diagnosis.search is not None
    term, search = diagnosis.terms[effect], diagnosis.search
    # a refused set is no alternative to the chosen one, however probable it is
    sets = [ids for ids in diagnosis.standing.sets if ids == diagnosis.chosen or may_be_right(search, ids)]
    probability = diagnosis.standing.containing(effect, sets)
    shown: EffectContent = {
        "id": "free-form" if is_free(effect) else effect,
        "name": term.describe() if isinstance(term, FreeTerm) else EFFECTS[effect].name,
        "parameters": parameters(diagnosis, term),
        "equivalent": equivalents(diagnosis, effect),
        "probability": round(probability, 4),
    }
    if term.known:
        shown["determined"] = _determined(diagnosis, term)
    if isinstance(term, FreeTerm):
        shown["terms"] = [
            {"channel": item.channel, "basis": item.basis, "pattern": item.pattern} for item in term.items
        ]
    return shown


def equivalents(diagnosis: Diagnosis, effect: str) -> list[str]:
    """Effects that these runs cannot distinguish from an effect, most similar first."""
    apart = dict((diagnosis.separation or {}).get(effect, {}))
    apart.pop("", None)
    near = sorted((distance, other) for other, distance in apart.items() if distance < SAME_SIGMAS)
    return [other for _, other in near]


def parameters(diagnosis: Diagnosis, term: Candidate) -> dict[str, Bounded]:
    """Value and 95 % interval of every physical parameter of a term of the chosen set."""
    values = diagnosis.fit.point.terms[term.id]
    if term.stepwise:
        return _stepwise(diagnosis, term, values)
    best, drawn = term.physical(values), _drawn(diagnosis, (term,))
    return {name: _interval(best[name], drawn[name], _period(term.id, name)) for name in best}


def _determined(diagnosis: Diagnosis, term: Candidate) -> dict[str, DeterminedContent]:
    """What the runs determine even where they do not determine the parameters (Candidate.known)."""
    assert term.known is not None
    best, stated = term.known(diagnosis.fit.point.terms[term.id]), term.known(term.absent)
    drawn = _drawn(diagnosis, (term,))
    return {
        name: {**_interval(value, drawn[name], None), "stated": rounded(stated[name])} for name, value in best.items()
    }


def _drawn(diagnosis: Diagnosis, terms: Sequence[Candidate]) -> dict[str, Floats]:
    """Joint draws of all parameters, and of what else is known, of terms of the chosen set, by name, (DRAWS,) each."""
    parts = [_drawn_from(diagnosis, ids, count, terms) for ids, count in _sets_drawn(diagnosis).items()]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _sets_drawn(diagnosis: Diagnosis) -> dict[Set, int]:
    """The chosen set, and sets with a further named effect that does not gain enough to be named; numbers of draws.

    The further effect, if it acts, moves the chosen ones: without this, four of 70 intervals from untidy laboratories
    missed the truth because of an effect that was not named. Sets count by their probability, the chosen one with at
    least half. Not on open ground, where intervals include the scatter between commands.
    Source: Hoeting, Madigan, Raftery & Volinsky (1999), Statistical Science 14, 382.
    """
    search, standing, chosen = diagnosis.search, diagnosis.standing, diagnosis.chosen
    assert search is not None
    if standing is None or search.problem.open_ground:
        return {chosen: DRAWS}
    wider = [ids for ids in standing.sets if ids > chosen and not any(map(is_free, ids - chosen))]
    wider = [ids for ids in wider if may_be_right(search, ids)]
    shares = {ids: standing.share_of([ids], [chosen, *wider]) for ids in wider}
    scale = min(1.0, MOST_BESIDE / max(sum(shares.values()), MOST_BESIDE))
    counts = {ids: round(DRAWS * scale * share) for ids, share in shares.items()}
    counts = {ids: count for ids, count in counts.items() if count >= FEWEST_DRAWS}
    return {chosen: DRAWS - sum(counts.values()), **counts}


def _drawn_from(diagnosis: Diagnosis, ids: Set, count: int, terms: Sequence[Candidate]) -> dict[str, Floats]:
    """Joint draws from the posterior of one fitted set, by name, (count,) each."""
    assert diagnosis.search is not None
    fit = diagnosis.search.fits[ids]
    mean = np.array([fit.point.value(column) for column in fit.columns])
    covariance = covariance_of(fit, diagnosis.search.problem, diagnosis.search.tolerance)
    # the covariance includes the uncertainty of the scatter between runs, except the tails of Student's t; it may be
    # slightly indefinite by rounding if two effects are almost equivalent, which is not an error
    draws = np.random.default_rng(DRAW_SEED).multivariate_normal(
        mean, covariance, count, check_valid="ignore", method="svd"
    )
    for term in terms:
        if ids == diagnosis.chosen and term.id in diagnosis.profiles:
            draws = diagnosis.profiles[term.id].transform(draws, mean, covariance)
    for i, reach in silent_reaches(diagnosis.search.problem, fit).items():
        draws[:, i] = np.minimum(draws[:, i], mean[i] + reach)
    found: dict[str, Floats] = {}
    for term in terms:
        own = [i for i, column in enumerate(fit.columns) if column.key == term.id]
        places = [term.clipped(tuple(row)) for row in draws[:, own] + np.array(term.absent)]
        physical = [{**term.physical(place), **(term.known(place) if term.known else {})} for place in places]
        found |= {name: np.array([item[name] for item in physical]) for name in physical[0]}
    return found


def _period(effect: str, name: str) -> float | None:
    declared = EFFECTS[effect].parameter(name) if effect in EFFECTS else None
    return declared.period if declared else None


def _interval(best: float, draws: Floats, period: float | None) -> Bounded:
    """Value with the 95 % interval of its draws; draws of an angle are moved to within half a period of the value."""
    if period is not None:
        draws = best + (draws - best + period / 2) % period - period / 2
    low, high = np.percentile(draws, [2.5, 97.5])
    return _bounded((best, float(low), float(high)))


def _stepwise(diagnosis: Diagnosis, term: Candidate, values: Sequence[float]) -> dict[str, Bounded]:
    """Parameters of a stepwise response: every value between two steps is equally probable."""
    search = diagnosis.search
    assert search is not None
    edges = likely_interval(search.problem, diagnosis.fit, term, search.tolerance)
    best, low, high = (term.physical((value,)) for value in (values[0], *edges))
    return {name: _bounded((best[name], low[name], high[name])) for name in best}


def rounded(value: float | None) -> float | None:
    """Six significant digits; None for a number that is not finite, and for none."""
    return float(f"{value:.6g}") if value is not None and math.isfinite(value) else None
