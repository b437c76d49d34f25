"""Model comparison: probabilities, drop-one tests, and effects that these data cannot distinguish."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.candidates.free_form import PREFIX
from evaluator.diagnosis.inference.fit import LAGGING
from evaluator.diagnosis.inference.fitted_model import Fit, prior_precision
from evaluator.diagnosis.inference.screening import screen
from evaluator.diagnosis.inference.search import Search, fit_set, log_prior
from evaluator.diagnosis.likelihood.linear.mixed_model import MixedModel, Reduced, reduce_runs
from evaluator.diagnosis.likelihood.linear.random_effects import place_runs

Floats = NDArray[np.float64]
Set = frozenset[str]

# Separation below which two effects are reported as indistinguishable: at four sigmas the wrong one is more probable in
# Φ(-4/2) = 2 % of experiments.
SAME_SIGMAS = 4.0
FREE_PRIOR = 0.05  # one laboratory in twenty has physics that is not in the catalogue


def is_free(effect: str) -> bool:
    """Whether a term is a free-form one."""
    return effect.startswith(PREFIX)


def score(search: Search, ids: Set, families: int) -> float:
    """Log evidence plus log prior of a set, free-form terms included.

    A lower bound if the fit did not converge; minus infinity if there is none.
    """
    named = [effect for effect in ids if not is_free(effect)]
    free = len(ids) - len(named)
    candidates = sum(not is_free(effect) for effect in search.terms)
    prior = log_prior(len(named), candidates) + free * (np.log(FREE_PRIOR) - np.log(max(families, 1)))
    return search.evidence(ids) + float(prior)


@dataclass(frozen=True)
class Standing:
    """All fitted sets with their scores, best first."""

    sets: tuple[Set, ...]
    scores: Floats

    @property
    def probability(self) -> Floats:
        """Probability of every set, if one of the fitted ones is true."""
        weight = np.exp(self.scores - self.scores.max())
        return np.asarray(weight / weight.sum())

    def of(self, ids: Set) -> float:
        """Score of a set."""
        return float(self.scores[self.sets.index(ids)])

    def share_of(self, sets: Iterable[Set], among: Iterable[Set]) -> float:
        """Probability that one of these sets is true, if one of those among which they are is true."""
        scores = {ids: self.of(ids) for ids in among}
        weight = {ids: np.exp(score - max(scores.values())) for ids, score in scores.items()}
        return float(sum(weight[ids] for ids in sets) / sum(weight.values()))

    def containing(self, effect: str, among: Iterable[Set]) -> float:
        """Probability that an effect acts, if one of these sets is true."""
        sets = list(among)
        return self.share_of([ids for ids in sets if effect in ids], sets)


def standing(search: Search, families: int) -> Standing:
    """Rank every fitted set."""
    scores = {ids: score(search, ids, families) for ids in search.fits}
    order = sorted(scores, key=lambda ids: (-scores[ids], sorted(ids)))
    return Standing(tuple(order), np.array([scores[ids] for ids in order]))


def separations(search: Search, ids: Set, most: int | None = None) -> dict[str, dict[str, float]]:
    """Separation in sigmas of every other effect from each effect of a fitted set, by these runs.

    The prediction of effect A at its fitted size is fitted by B with nuisance parameters, scatter and the rest of the
    set free; the norm of the residual is the mean separation in experiments of this kind. This is a linearization
    without bounds: therefore the nearest B, at most `most` of them, are fitted in place of A. The separation of a B
    that is fitted follows from its odds.
    """
    fit = search.fits[ids]
    named = [term for effect, term in search.terms.items() if not is_free(effect)]
    inside = [effect for effect in sorted(ids) if not search.terms[effect].stepwise]
    view = screen(search, fit.point, inside, [term for term in named if term.id not in ids])
    at = np.array([_nearest(view.model, fit.posterior.scatter)])
    result: dict[str, dict[str, float]] = {}
    for effect in inside:
        own = [i for i in view.base if view.columns[i].key == effect]
        size = np.array([fit.point.value(view.columns[i]) for i in own])
        rest = [i for i in view.base if i not in own]
        found: dict[str, float] = {"": _left_over(view.model, int(at[0]), own, size, rest)}
        for name, extra in view.offers:
            left = _left_over(view.model, int(at[0]), own, size, [*rest, *extra])
            found[name] = min(found.get(name, np.inf), left)
        near = sorted((left, name) for name, left in found.items() if name and left < SAME_SIGMAS)[:most]
        result[effect] = found | _by_odds(search, ids, effect, {name: left for left, name in near})
        for name in found:
            instead = search.fits.get(ids - {effect} | {name}) if name else None
            if instead is not None and name not in ids:
                result[effect][name] = _odds_sigmas(fit, instead.posterior.log_evidence)
    return result


def _by_odds(search: Search, ids: Set, effect: str, near: Mapping[str, float]) -> dict[str, float]:
    """Fit near effects in place of one of a set; return separations of those that cannot be fitted there.

    Their separation is at least that of a linearization at the set without either effect, if its fit converged: beside
    an effect that depends on load, a weaker magnet resembles a smaller effect; without it, it does not. If a fit ends
    far below, from there and from the whole set, the separation is that of its evidence: by a linearization, magnets
    were half a sigma from a spring that moved straight runs by 0.2 mm.
    """
    fit, without = search.fits[ids], search.reached(ids - {effect})
    if without is None or not near:
        return {}
    smooth = [name for name in sorted(without.terms) if not search.terms[name].stepwise]
    view = screen(search, without.point, smooth, [search.terms[name] for name in near])
    found = {}
    for offer in sorted(view.offers, key=view.evidence):
        name, begin = offer[0], {offer[0]: view.start_of(offer)}
        rival, evidence = without.terms | {name}, view.evidence(offer) if without.converged else np.inf
        instead = fit_set(search, rival, begin, without, search.explained)
        if instead is None and _lags(search, rival):
            instead = fit_set(search, rival, begin, fit, search.explained)
        if instead is None:
            if _lags(search, rival):
                evidence = min(evidence, search.evidence(rival))
            found[name] = max(near[name], _odds_sigmas(fit, evidence))
    return found


def _lags(search: Search, ids: Set) -> bool:
    """Whether the fit of a set ended because it stayed far below a model that explains the runs; see fit_model."""
    return -np.inf < search.evidence(ids) < search.explained - LAGGING


def _odds_sigmas(fit: Fit, evidence: float) -> float:
    """Difference of a log evidence from that of a fit, in sigmas; 0 if it is higher."""
    return float(np.sqrt(2 * max(fit.posterior.log_evidence - evidence, 0.0)))


def _left_over(model: MixedModel, at: int, own: Sequence[int], size: Floats, others: Sequence[int]) -> float:
    """Norm of the response to own columns at size, orthogonal to the others, in sigmas."""
    (G,) = model.inner(at=[at])
    H = G[np.ix_(others, others)] + np.diag(model.prior[list(others)])
    scale = np.sqrt(np.maximum(np.diag(H), 1e-300))
    cross = G[np.ix_(others, own)] @ size
    solved = np.linalg.lstsq(H / np.outer(scale, scale), cross / scale, rcond=1e-10)[0] / scale
    square = float(size @ G[np.ix_(own, own)] @ size - cross @ solved)
    return float(np.sqrt(max(square, 0.0)))


def _nearest(model: MixedModel, scatter: Floats) -> int:
    return int(np.argmin(np.sum((np.log(model.tau) - np.log(scatter)) ** 2, axis=1)))


def evidence_of_runs(search: Search, fit: Fit, rows: Sequence[int]) -> float:
    """Log evidence of a fitted model from some of its runs (indices in fit.runs), by its linearization."""
    keep = np.asarray(rows, dtype=np.int64)
    reduced = Reduced(*(getattr(fit.reduced, item.name)[keep] for item in fields(fit.reduced)))
    return MixedModel(reduced, prior_precision(fit.columns, search.tolerance)).log_evidence(range(len(fit.columns)))


def predictive_score(search: Search, fit: Fit, runs: Sequence[int]) -> float:
    """Log predictive density of runs that were not fitted, with the posterior of a fit and its scatter."""
    columns = fit.columns
    theta = np.array([fit.point.value(column) for column in columns])
    point = place_runs(search.problem, fit.point, runs, fit.posterior.scatter)
    reduced = reduce_runs(search.problem.linearized(point, columns, runs))
    model = MixedModel(reduced, prior_precision(columns, search.tolerance))
    at = _nearest(model, fit.posterior.scatter)
    (G,), g, s = model.inner(at=[at]), model.g[at], model.s[at]
    excess = g - G @ theta
    covariance = fit.posterior.covariance
    inner = np.linalg.solve(np.eye(len(columns)) + covariance @ G, covariance)
    misfit = s - 2 * g @ theta + theta @ G @ theta - excess @ inner @ excess
    logdet = model.logdet[at] + np.linalg.slogdet(np.eye(len(columns)) + covariance @ G)[1]
    return float(-0.5 * (misfit + logdet))


def confirmation(part: Search, fit: Fit, held_out: Sequence[int]) -> float:
    """Gain in log density of held-out runs over the null; NaN if the null cannot be simulated there."""
    try:
        return predictive_score(part, fit, held_out) - predictive_score(part, part.null, held_out)
    except FloatingPointError:
        return float("nan")
