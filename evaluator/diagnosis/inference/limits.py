"""What the runs exclude: the largest size of every effect that the model lacks, if it acted beside the effects in it.

"Nothing is missing" means that no effect is needed. How large an effect could be without being needed depends on the
runs: this is the interval of its parameters, with all values within their tolerances and the scatter of the runs free.
Each effect is linearized where it is absent, so that limits hold for effects whose consequence grows in proportion to
their size, up to the limit. Effects without such a response (a dead band, a speed limit above all commands, a magnet at
an unknown place) have none.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special

from evaluator.diagnosis.inference.screening import Screen, screen
from evaluator.diagnosis.inference.search import Search
from simulator.effects.catalogue import EFFECTS
from simulator.effects.coordinates import Candidate, Coordinate
from simulator.effects.parameter import Parameter

Floats = NDArray[np.float64]

DRAWS, SEED = 4000, 20120612  # an end is then known to 4 % of a standard deviation; the same input, the same limits
SHARE = 0.95  # probability that a size lies within its limits
# An interval of more steps, each just visible in the marks, is wider than a linearization holds; one of more than this
# share of the physical range says nothing. The runs then do not limit the size.
MOST_STEPS, MOST_OF_RANGE = 100.0, 0.75


@dataclass(frozen=True)
class Limit:
    """95 % interval of a parameter of an effect that is not in the model, with the value at which it is absent.

    An end is None where the effect is absent and no value possible beyond: a drag is not negative.
    """

    effect: str
    parameter: str
    low: float | None
    high: float | None


def limits(search: Search, chosen: frozenset[str]) -> tuple[Limit, ...]:
    """Limits of all named effects that a fitted set lacks, in the order of the catalogue.

    None on open ground, where the noise is estimated from the residuals of the model itself.
    """
    if search.problem.open_ground:
        return ()
    others = [replace(term, starts=()) for id_, term in search.terms.items() if id_ not in chosen and _is_linear(term)]
    view = screen(search, search.fits[chosen].point, sorted(chosen), others)
    offers = dict(view.offers)
    found = (limit for term in others for limit in _of_effect(view, term, offers[term.id]))
    order = {effect: place for place, effect in enumerate(EFFECTS)}
    return tuple(sorted(found, key=lambda limit: order[limit.effect]))


def _is_linear(term: Candidate) -> bool:
    """Whether an effect has one response to a small size, wherever on the plate its cause is."""
    return term.id in EFFECTS and not term.stepwise and not (term.starts and EFFECTS[term.id].of_plate)


def _of_effect(view: Screen, term: Candidate, columns: tuple[int, ...]) -> Iterator[Limit]:
    """The limits of one effect; columns: of its coordinates."""
    shown = [place for place, column in enumerate(columns) if _is_shown(view, column)]
    draws = _drawn(view, term, shown, [columns[place] for place in shown])
    sizes = _sizes(term, [place for place in shown if _is_limited(draws[:, place], term.coordinates[place])])
    physical = [term.physical(tuple(row)) for row in draws] if sizes else []
    for declared in EFFECTS[term.id].parameters:
        if declared.name in sizes and declared.period is None:
            yield Limit(term.id, declared.name, *_ends(np.array([item[declared.name] for item in physical]), declared))


def _is_limited(values: Floats, item: Coordinate) -> bool:
    """Whether the values (n,) of a coordinate leave much of its range, and its linearization holds for them."""
    least, most = np.quantile(values, [(1 - SHARE) / 2, (1 + SHARE) / 2])
    return bool(most - least < min(MOST_OF_RANGE * (item.high - item.low), MOST_STEPS * item.step))


def _ends(values: Floats, declared: Parameter) -> tuple[float | None, float | None]:
    """The ends of the interval of values (n,); None on the side where the effect is absent and no value possible.

    An effect that is not in the model may be absent: where the runs lean to one side, the interval reaches to there.
    """
    if declared.low >= declared.absent:
        return None, float(np.quantile(values, SHARE))
    if declared.high <= declared.absent:
        return float(np.quantile(values, 1 - SHARE)), None
    low, high = np.quantile(values, [(1 - SHARE) / 2, (1 + SHARE) / 2])
    return min(float(low), declared.absent), max(float(high), declared.absent)


def _is_shown(view: Screen, column: int) -> bool:
    """Whether the runs respond to a coordinate, otherwise than to the values in the model."""
    return bool(view.beyond.whole[column, column] > 0 and not view.beyond.redundant[:, column].any())


def _sizes(term: Candidate, shown: Sequence[int]) -> set[str]:
    """Parameters that some shown coordinates are, and those that the size changes: not the place of an anchor."""
    if 0 not in shown:
        return set()
    absent, first = term.absent, term.coordinates[0]
    small, none = term.physical((first.absent + first.step, *absent[1:])), term.physical(absent)
    named = {term.coordinates[place].name for place in shown} & none.keys()
    return named | {name for name in none if small[name] != none[name]}


def _drawn(view: Screen, term: Candidate, shown: Sequence[int], columns: Sequence[int]) -> Floats:
    """Coordinates (DRAWS, n) of an effect: those shown from their normal distribution, each within its bounds."""
    draws = np.tile(np.array(term.absent), (DRAWS, 1))
    if not shown:
        return draws
    posterior = view.beyond.posterior(columns)
    sigma = np.sqrt(np.diag(posterior.covariance))
    normal = np.random.default_rng(SEED).multivariate_normal(
        np.zeros(len(shown)), posterior.covariance / np.outer(sigma, sigma), DRAWS, method="svd"
    )
    for k, place in enumerate(shown):
        item = term.coordinates[place]
        mean = item.absent + posterior.mean[k]
        low, high = (item.low - mean) / sigma[k], (item.high - mean) / sigma[k]
        draws[:, place] = np.clip(mean + sigma[k] * _within(normal[:, k], low, high), item.low, item.high)
    return draws


def _within(normal: Floats, low: float, high: float) -> Floats:
    """Standard normal numbers (n,), moved in their order to the distribution between two bounds."""
    if low > 0:  # in the lower tail, where probabilities are not rounded to 1
        return -_within(-normal, -high, -low)
    below, above = special.ndtr(low), special.ndtr(high)
    return np.asarray(special.ndtri(below + (above - below) * special.ndtr(normal)))
