"""The search on open ground: named effects and free-form terms together, with noise estimated from the residuals.

There physics outside the catalogue may cause most of the misfit, for example a drive that mixes its sides. As long as
it is missing, an additional effect such as a lag of the motors is not significant; an effect that imitated it remains
in the set after it is added; and the noise, estimated from residuals, is too large. Therefore sets grow from the null
by the most promising terms of both kinds, the noise is estimated again after every size, and finally each effect of the
best set is replaced in turn by all others.

A loss of speed is explained nearly as well by a drag as by a drive that limits the wheels. Which one is right shows
only with further effects, so that the best set of effects of the drive is extended as well as the best sets.

The duration of a search is proportional to the number of runs. In a long session it uses runs with commands far apart
from each other; its best sets are fitted to the runs of more commands, which decide; all others are held out.
Source: floating search: Pudil, Novovičová & Kittler (1994), Pattern Recognition Letters 15, 1119.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import Any

from evaluator.diagnosis.assessment.cross_validation import mean_gain
from evaluator.diagnosis.assessment.model_comparison import Set, is_free, score
from evaluator.diagnosis.assessment.verdict import carries_over
from evaluator.diagnosis.inference.fit import fit_model
from evaluator.diagnosis.inference.search import MOST_STEPS, RIVALS_KEPT, Search, fit_set
from evaluator.diagnosis.inference.settled_noise import settled_noise
from evaluator.diagnosis.inference.strategy import ADDITIONS_REFITTED, BEAM, SINGLES_REFITTED, extend
from evaluator.diagnosis.long_sessions import deciding_runs, searched_runs
from evaluator.diagnosis.search_input import Prepared, fitted_runs
from evaluator.progress import Progress
from simulator.effects.catalogue import EFFECTS

ROUNDS = 3  # estimates of noise after the sets have grown; it converged within two in eight subsets of two recordings
NAMED_KEPT = 2  # best sets without free-form terms that are always kept for comparison
DRIVE = "_drive."  # in the names of forms that act on the drive
DRIVES = 2  # effects of a drive that are combined whatever their places in the screening: late wheels, and limited ones
EXCHANGES = 3  # consecutive replacements of the best set
# Mean square of the residuals of a set over that of the best set of its size, from which it is left: 40 % more RMS.
# Of limited wheels a quarter of the time went into extending and fitting again what missed the runs by three times.
FAR_OFF = 2.0
# Number of sets of zero, one and two effects that are extended, and additions to each that are fitted.
# Effects that delay the motion. A later common start and friction absorb most of a delay, so that screening beside them
# tells nothing: a lag of 0.3 s lost 61 by screening, and gained 945 by its fit.
DELAYS = ("command-lag", "acceleration-limit")
GROWN = ((1, SINGLES_REFITTED), *((count, ADDITIONS_REFITTED) for count in BEAM))


def null_on_ground(ready: Prepared) -> Search:
    """A search with the model without effects alone, fitted to all runs."""
    found = Search(ready.problem, ready.terms, ready.tolerance, tuple(range(len(ready.problem.data))))
    found.fits[frozenset()] = fit_model(found.problem, ready.start, [], found.tolerance, found.runs)
    return found


def singles_on_ground(ready: Prepared, progress: Progress) -> Search:
    """A search over single effects and free-form terms on the runs that are searched."""
    whole = Search(ready.problem, ready.terms, ready.tolerance, searched_runs(ready.problem.data), asked=ready.own)
    whole.fits[frozenset()] = fit_model(whole.problem, ready.start, [], whole.tolerance, whole.runs)
    _grown(whole, len(ready.free), 0, progress)
    return whole


def searched_on_ground(singles: Search, ready: Prepared, progress: Progress) -> tuple[Search, Search]:
    """Searches on the runs that are not held out, and on all deciding runs; both are the same for a long session.

    singles: see singles_on_ground. In the first only the null is fitted, unless both are the same.
    """
    families, data = len(ready.free), ready.problem.data
    deciding = deciding_runs(data)
    whole = _settled(singles, families) or singles
    for size in range(1, len(GROWN)):
        _grown(whole, families, size, progress)
        whole = _settled(whole, families) or whole
    for number in range(ROUNDS):
        progress("other effects in place of each", 0.7 + 0.08 * number)
        exchange(whole, families)
        settled = _settled(whole, families)
        if settled is None:
            break
        whole = settled
    if whole.runs != deciding:
        progress("more commands", 0.9)
        whole = _under(whole, families, runs=deciding)
        _against_each(whole, families)
    if len(deciding) < len(data):
        return whole, whole
    part = whole.anew(runs=fitted_runs(data))
    part.fits[frozenset()] = fit_model(part.problem, whole.null.point, [], part.tolerance, part.runs)
    return part, whole


def on_runs_except(search: Search, families: int, runs: Collection[int]) -> Search:
    """The best sets of a search fitted without some of its runs, with the noise that the others leave."""
    found = _under(search, families, runs=tuple(run for run in search.runs if run not in runs))
    return _settled(found, families) or found


def _grown(search: Search, families: int, size: int, progress: Progress) -> None:
    """Fit sets with one effect more than a size."""
    progress(f"{size + 1} effects", 0.1 + 0.2 * size)
    grow(search, families, size, *GROWN[size])
    if size < DRIVES:
        try_drives(search, families, size)


def grow(search: Search, families: int, size: int, count: int, additions: int) -> None:
    """Fit the best sets of a size with the most promising additions, named or free-form.

    The best sets are `count` ones of any effects, and the best one of effects of the drive.
    """
    _afford(search)
    of_size = [ids for ids in _near(search, _ranked(search, families)) if len(ids) == size]
    for ids in dict.fromkeys([*of_size[:count], *list(filter(_is_of_drive, of_size))[:1]]):
        _extend_once(search, ids, additions)


def _near(search: Search, ranked: Sequence[Set]) -> list[Set]:
    """The sets of a ranking that do not miss the runs FAR_OFF worse than the best ones of their sizes."""
    least: dict[int, float] = {}
    for ids in ranked:
        if not search.fits[ids].at_bounds:
            least[len(ids)] = min(search.fits[ids].excess, least.get(len(ids), math.inf))
    return [ids for ids in ranked if search.fits[ids].excess <= FAR_OFF * least.get(len(ids), math.inf)]


def try_drives(search: Search, families: int, size: int) -> None:
    """Fit every candidate that acts on the drive beside the best set of such effects, whatever the screening says.

    size: of that set; beside an effect, only named candidates. The motion without them is so far off that derivatives
    there say little. Of eight steps of a Husky, a speed limit and a mixing of the sides had the most evidence after
    their fits, but places 16 and 13 in the screening. Of a hundred steps of a Warthog on asphalt, a drag was more
    promising than a speed limit beside limited acceleration, but with a third effect the limit has 70 more of evidence.
    """
    _afford(search)
    best = next((ids for ids in _ranked(search, families) if len(ids) == size and _is_of_drive(ids)), None)
    if best is not None:
        untried = [effect for effect in search.terms if effect not in best and best | {effect} not in search.fits]
        drives = [effect for effect in untried if acts_on_drive(effect) and not (best and is_free(effect))]
        if not best:
            delays = [effect for effect in drives if effect in DELAYS]
            extend(search, best, delays, len(delays), regardless=True)
        extend(search, best, drives, len(drives))


def acts_on_drive(effect: str) -> bool:
    """Whether an effect or a free-form term changes the speeds of the wheels at given commands."""
    return DRIVE in effect if is_free(effect) else EFFECTS[effect].kind == "command"


def _is_of_drive(ids: Set) -> bool:
    """Whether a set has only named effects of the drive."""
    return not any(map(is_free, ids)) and all(map(acts_on_drive, ids))


def exchange(search: Search, families: int) -> None:
    """Fit all candidates in place of each effect of the best set, until no replacement improves it.

    The sets without one effect are fitted as well; the drop-one tests use them.
    """
    for _ in range(EXCHANGES):
        best = _ranked(search, families)[0]
        _afford(search)
        for rest in [best - {effect} for effect in sorted(best)]:
            if fit_set(search, rest, {}, search.fits[best]) or search.reached(rest):
                _extend_once(search, rest)
        if len(best) < search.largest:
            _extend_once(search, best)
        if _ranked(search, families)[0] == best:
            break


def _against_each(search: Search, families: int) -> None:
    """Fit the best sets without each of their effects, for the drop-one tests."""
    _afford(search)
    for ids in _ranked(search, families)[:NAMED_KEPT]:
        for effect in sorted(ids):
            fit_set(search, ids - {effect}, {}, search.fits[ids])


def _extend_once(search: Search, ids: Set, additions: int = ADDITIONS_REFITTED) -> None:
    """Fit the most promising additions to a set, only once: screening all candidates costs as much as several fits."""
    if ids not in search.extended:
        search.extended.add(ids)
        extend(search, ids, {effect for effect in search.terms if ids | {effect} not in search.fits}, additions)


def _ranked(search: Search, families: int) -> list[Set]:
    """Fitted sets, most probable first; sets that cannot be the answer last.

    These are less probable than the null, or have an effect at a bound or one that does not improve the prediction of
    left-out commands. If the noise was estimated with an overfitted model, such effects are more probable than true
    ones. Before the null come sets that improve this prediction on average, though not significantly, because the
    noise of the null hides effects: of eight steps of a Warthog on sand, a limit of acceleration improved it by a
    factor of 1.8 on average; with the noise of this set it was significant.
    """
    of_null = score(search, frozenset(), families)

    def key(ids: Set) -> tuple[int, float]:
        own = score(search, ids, families)
        if not ids:
            return 2, -own
        if search.fits[ids].at_bounds or own <= of_null:
            return 3, -own
        if carries_over(search, ids):
            return 0, -own
        return 1 if _helps(search, ids) else 3, -own

    return sorted(search.fits, key=key)


def _helps(search: Search, ids: Set) -> bool:
    """Whether a set predicts left-out commands better on average than the null and than itself without one effect."""
    known = {ids - {effect} for effect in ids} & search.fits.keys() | {frozenset[str]()}
    fit, data = search.fits[ids], search.problem.data
    return all(mean_gain(fit, search.fits[other], data, search.tolerance) > 0 for other in known)


def _afford(search: Search) -> None:
    """Allow a search another MOST_STEPS steps."""
    search.most_steps = search.steps + MOST_STEPS


def _settled(search: Search, families: int) -> Search | None:
    """The search with the noise from the residuals of its best set, and the best sets; None if it does not change."""
    problem = settled_noise(search, _ranked(search, families)[0])
    return None if problem is None else _under(search, families, problem=problem)


def _under(search: Search, families: int, **changes: Any) -> Search:
    """The null and the best sets of a search, fitted again with another noise or to other runs."""
    found = search.anew(**changes)
    found.fits[frozenset()] = fit_model(found.problem, search.null.point, [], found.tolerance, found.runs)
    by_odds = sorted(search.fits, key=lambda ids: -score(search, ids, families))
    every = _ranked(search, families)
    ranked = [*_near(search, every)[:RIVALS_KEPT], *by_odds[:NAMED_KEPT]]
    named = _near(search, [ids for ids in every if not any(map(is_free, ids))])
    drive = list(filter(_is_of_drive, named))[:1]
    for ids in dict.fromkeys([*ranked, *named[:NAMED_KEPT], *drive]):
        if ids:
            fit_set(found, ids, {}, search.fits[ids])
    return found
