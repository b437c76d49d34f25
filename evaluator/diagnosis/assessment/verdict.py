"""The verdict: significance of each effect, comparison with free-form terms, and remaining doubts."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
from scipy import special

from evaluator.diagnosis.assessment.adequacy import Adequacy
from evaluator.diagnosis.assessment.cross_validation import (
    Constancy,
    advantage,
    covariance_over_commands,
    mean_gain,
    predicts_better,
)
from evaluator.diagnosis.assessment.knowledge import ALIKE, far, strained, together
from evaluator.diagnosis.assessment.model_comparison import Set, Standing, is_free, score
from evaluator.diagnosis.candidates.free_form import grows_with_time
from evaluator.diagnosis.inference.fit import EXCESS, EXPLAINED
from evaluator.diagnosis.inference.search import LARGEST_SET, Search
from evaluator.diagnosis.likelihood.known_to import START
from evaluator.wording import NOTHING_MISSING, counted, verb

Verdict = Literal["none", "effect", "unknown", "insufficient"]

# An effect stays in the model if its removal costs this much of the log posterior, by the size of the set: odds of
# 3000 to 1 for the first effect, for a second one, and for a free-form term. Odds of 90 to 1 were sufficient for
# simulated experiments whose errors are exactly those of the model; in the second world (tests/laboratory), whose
# errors are not, an untidy experiment without effect reached 1100 to 1 (7.0), and a gradient of friction beside a true
# effect, on a plate without gradient, 900 to 1 (6.8). An effect that is significant by five sigmas gains about nine.
# Several named effects together can imitate physics outside the catalogue, so sets of three must gain more.
KEEP = (8.0, 8.0, 8.0, 12.0)
# Log odds, three to one, below which sets as large are not distinguished.
TIE = math.log(3.0)
# Log odds, twenty to one, that a set needs over one as large that states less (strong evidence: Kass & Raftery 1995, J.
# Am. Stat. Assoc. 90, 773): a plate of 9 degrees was a spring with its anchor 1.5 m away at odds of 4 to 1.
STATES_MORE = math.log(20.0)
# Log odds, 20 to 1, from which on an effect that is not named is not excluded either. In sixty sessions without an
# effect, of four banks, the largest were 9 to 1.
UNDECIDED = math.log(20.0)
# An effect that explains otherwise significant deviations of known values needs only this much, odds of 400 to 1,
# because the model is then known to be incomplete.
RELIEVING = 6.0
# Named effects are not the answer if alternatives with free-form terms are together twice as probable. If the named
# effects were true, these had at most 17 % (36 development experiments) and 54 % (an attraction of 0.77 to one side in
# the second world); if the named ones imitated something else, at least 76 % (18 of 20; 14 and 15 % in two whose data
# do not distinguish it from them). From ALIKE_WELL on the reason mentions them. A free-form term that grows with time,
# beside the named effects or beside none, must also predict left-out commands better by BETTER_SIGMAS, because it
# follows friction that changes with time: in three untidy sessions of the twelfth world it gained −0.3 to 1.1 standard
# errors. A term of place or velocity need not: what acts at one place may act in a single run.
DOUBT, ALIKE_WELL = 2 / 3, 1 / 3
EXCESS_SIGMA = 5.0  # standard errors by which the residuals must exceed noise, beside fit.EXCESS
# A free-form term is the answer if it predicts left-out commands better by this log density, and by so many of its
# standard errors. In the development bank free-form terms gained at most 1.5 over right answers, and eight or more over
# wrong ones. One of a hundred families may gain as much by chance: therefore it must also gain what any effect needs
# (KEEP) over its set without it, and the set must be more probable than the null. Of 18 verdicts "unknown" in three
# banks, the two that were wrong rested on this rule alone, with gains of 1.6 and 3.1.
BETTER_BY, BETTER_SIGMAS = 4.0, 2.0
FALSE_POSITIVE = 0.05  # probability that the interval of any coefficient of a family excludes zero by chance
# Probability below which a dependence of friction and gains on something known is significant.
NOT_CHANCE = 1e-3
LATE = "command-lag"  # has the same response as a wrong clock if commands and poses are logs


# On open ground the noise is estimated from the residuals, and many of a hundred families are significant by the
# criterion above. There a free-form term is an answer only if it reduces the residuals by this share (RMS); smaller
# reductions are within the variation of the ground. A run of a few seconds has about three independent slow modes.
MATERIAL, SLOW_MODES = 0.2, 3


def material_gain(runs: int) -> float:
    """Log evidence that free-form terms must gain on open ground over the named effects of their set."""
    return -SLOW_MODES * runs * math.log(1 - MATERIAL)


def least_gain(ids: Set) -> float:
    """Log odds that each effect of a set must gain."""
    return KEEP[min(len(ids), LARGEST_SET - 1 if any(map(is_free, ids)) else LARGEST_SET)]


# Log odds on open ground from which a model that is not confirmed, and does without a named effect, casts doubt on it.
# Residuals are taken for noise there, so that a few tens mean little; compliant axles of a rigid robot, told with a
# probability below 0.001, were displaced by 104.
DISPLACED = 50.0
# Number of values moved beyond three of their tolerances from which a set is rejected, unless the model without effects
# moves them too. Of some 25 values, one deviates so far in one of fifteen laboratories, two in one of five hundred.
# Effects that cancel each other, or an effect that cancels tolerances, reach extreme sizes and move several.
STRAINED = 2


def pays(search: Search, table: Standing, families: int, ids: Set) -> bool:
    """Whether a set may be an answer: each effect and the whole set are significant, and known values are respected.

    A single named effect needs smaller odds if it explains significant deviations of known values. A set with an effect
    at a bound is no answer, because it imitates something else. On open ground odds are insufficient, because the noise
    is estimated from the residuals: there each effect must also improve the prediction of left-out commands.
    """
    return has_the_odds(search, table, families, ids) and (not search.problem.open_ground or carries_over(search, ids))


def carries_over(search: Search, ids: Set) -> bool:
    """Whether left-out commands are predicted significantly better with each effect of a set than without it.

    The prediction need not be better if the set without the effect moves an equivalent known value beyond three of its
    tolerances: clocks that agree to hundredths of a second do not explain motors that are late by a tenth.
    """
    return all(_is_stood_for(search, effect, ids) or _predicts(search, ids, ids - {effect}) for effect in ids)


def _is_stood_for(search: Search, effect: str, ids: Set) -> bool:
    """Whether a set without one of its effects moves a known value equivalent to it beyond its tolerances."""
    without = search.fits.get(ids - {effect})
    if without is None:
        return False
    return _moves_in_place_of(far(without, search.tolerance) - far(search.fits[ids], search.tolerance), effect)


def _moves_in_place_of(moved: frozenset[str], effect: str) -> bool:
    """Whether one of the known values that are moved is equivalent to an effect."""
    return any(effect == (LATE if key == START else ALIKE.get(key)) for key in moved)


def has_the_odds(search: Search, table: Standing, families: int, ids: Set) -> bool:
    """Whether each effect and the whole set have sufficient odds, and known values are respected: see pays."""
    if not may_be_right(search, ids):
        return False
    least, first = least_gain(ids), KEEP[1]
    if len(ids) == 1 and not any(map(is_free, ids)) and _relieves(search, ids):
        least = first = RELIEVING
    # two effects that cancel each other are each costly to remove, but together may gain nothing over none
    gained = not ids or table.of(ids) - score(search, frozenset(), families) > first
    return gained and _needs(search, table, families, ids, ids, least)


def _needs(search: Search, table: Standing, families: int, ids: Set, effects: Set, least: float) -> bool:
    """Whether a set has log odds of more than `least` over itself without each of these effects of it."""
    return all(table.of(ids) - score(search, ids - {effect}, families) > least for effect in effects)


def may_be_right(search: Search, ids: Set) -> bool:
    """Whether a set may be an answer regardless of its odds: no effect at a bound, and known values respected."""
    return not (ids and (_strains(search, ids) or _at_bounds(search, ids)))


def _relieves(search: Search, ids: Set) -> bool:
    """Whether values known to a tolerance deviate significantly without a set, jointly, and not with it."""
    without, with_it = (together(fit, search.tolerance) for fit in (search.null, search.fits[ids]))
    return without.is_finding and not with_it.is_finding


def _at_bounds(search: Search, ids: Set) -> bool:
    """Whether a set has an effect at or beyond a bound of its size, so that it imitates something else."""
    return bool(search.fits[ids].at_bounds or search.fits[ids].unbelieved)


def _strains(search: Search, ids: Set) -> bool:
    """Whether a set needs implausible deviations of known values."""
    far = strained(search.fits[ids], search.null, search.tolerance, on_ground=search.problem.open_ground)
    return len(far) >= STRAINED


def best_named(search: Search, table: Standing, families: int) -> Set:
    """The best set of named effects in which each effect is significant, or a set nearly as good that states less.

    A spring of a wire whose anchor is far away pulls like a plate that is not level, with a parameter more.
    """
    named = (ids for ids in table.sets if not any(map(is_free, ids)))
    best = next(ids for ids in named if pays(search, table, families, ids))
    tied = [best, *itertools.takewhile(lambda ids: table.of(best) - table.of(ids) < STATES_MORE, named)]
    as_large = [ids for ids in tied if len(ids) == len(best) and (ids == best or pays(search, table, families, ids))]
    return min(as_large, key=lambda ids: sum(search.terms[effect].size for effect in ids))


def undecided(search: Search, table: Standing, chosen: Set = frozenset()) -> tuple[Set, str]:
    """Effects beside the chosen ones that may act but are not proven, and why the runs do not decide; else empty.

    They are those of the most probable set that could be right and has the chosen ones. On open ground odds decide
    nothing.
    """
    more = (ids for ids in table.sets if ids > chosen and not any(map(is_free, ids)) and may_be_right(search, ids))
    best = next(more, chosen)
    odds = table.of(best) - table.of(chosen)
    if search.problem.open_ground or odds <= UNDECIDED:
        return frozenset(), ""
    needed = f"an effect is named from {round(math.exp(KEEP[1]), -3):.0f} to 1 on"
    said = f"odds of {math.exp(odds):.0f} to 1; {needed}" if odds < KEEP[1] else f"{needed}, which not each of them has"
    which = f"{' with '.join(sorted(best - chosen))}{' besides' * bool(chosen)}"
    return best - chosen, f"{which} would make these runs more probable, but is not proven ({said})"


def decide(
    search: Search, table: Standing, families: int, named: Set, least_material: float = -math.inf
) -> tuple[Set, Verdict, str]:
    """Verdict between the best named set and all sets with free-form terms.

    Sets with an effect that is not significant do not count: three effects that were rejected as an imitation do not
    support two of them, and a free-form term that gains little beside named effects does not contradict these.
    least_material: see material_gain; minus infinity except on open ground. There a free-form term leads to "unknown"
    only if it also predicts left-out commands better than the named effects, or no worse if these are less probable,
    and if its size is significant over commands.
    """

    def named_of(ids: Set) -> Set:
        return frozenset(effect for effect in ids if not is_free(effect))

    def gain(ids: Set) -> float:
        return table.of(ids) - score(search, named_of(ids), families)

    within = [ids for ids in table.sets if not _at_bounds(search, ids)]
    free = [ids for ids in within if ids != named_of(ids) and gain(ids) > least_material]
    answers = [ids for ids in within if len(ids) == 1 or pays(search, table, families, ids)]
    likely = [ids for ids in answers if ids in free]
    # on open ground the noise is estimated from the residuals, so that odds are insufficient: see pays
    if least_material > -math.inf:
        free = [ids for ids in free if _is_significant(search, ids)]
        gained = {ids: table.of(ids) - table.of(named) > least_gain(ids) for ids in likely}
        likely = [ids for ids in likely if ids in free and _rivals(search, ids, named, probable=gained[ids])]
    share = table.share_of(likely, answers) if likely else 0.0
    # what grows with time beside the named effects, not in their place, must also predict left-out commands better
    beside = bool(likely) and named < likely[0] and any(map(grows_with_time, likely[0]))
    carries = search.problem.open_ground or not beside or _predicts(search, likely[0], named)
    if share > DOUBT and carries and pays(search, table, families, likely[0]):
        than = " at least as well as the effects found" if named else ", and no effect of the catalogue does as well"
        return likely[0], "unknown", f"a free-form term explains the runs{than}"
    # also better than named effects that are not significant, because chance may imitate both kinds
    likeliest = next(ids for ids in table.sets if not any(map(is_free, ids)))
    for ids in free:
        if (
            gain(ids) > least_gain(ids)
            and _needs(search, table, families, ids, named_of(ids), least_gain(ids))
            and table.of(ids) > table.of(frozenset())
            and all(_predicts(search, ids, other) for other in {named, likeliest})
        ):
            return ids, "unknown", "a free-form term predicts held-out commands better than any effect of the catalogue"
    other, better = _better_fit(search, table, families, named, least_material)
    if better and not named:
        return named, "insufficient", f"{better}: runs of more commands are needed"
    if _displaces(search, table, other, named):
        which = f"{' and '.join(sorted(named))} {verb(len(named), 'predicts', 'predict')} held-out commands better; yet"
        return frozenset(), "insufficient", f"{which} {better}: runs of more commands are needed"
    if named:
        which = "the effect is significant" if len(named) == 1 else "each effect is significant by itself"
        alike = ", though a free-form term explains the runs as well" if share > ALIKE_WELL else ""
        more = f"; {better}" if better else alike or ", and no free-form term explains more"
        return named, "effect", f"{which}{more}"
    return named, "none", NOTHING_MISSING


def _better_fit(search: Search, table: Standing, families: int, named: Set, least_material: float) -> tuple[Set, str]:
    """The most probable set that is significant but not confirmed by left-out commands, and a clause about it.

    The named set and an empty clause if there is none, or off open ground. Over no effect, what is within the variation
    of the ground is no better: it must gain least_material, and also lessen the residuals of left-out commands by
    MATERIAL on average. On uneven ground without an effect, forces that depend on the place gained 17; with friction
    and speeds that scatter from recording to recording, each at a place of its own, 113, and lessened them by 5 %.
    """
    if not search.problem.open_ground:
        return named, ""
    least = max(least_material, 0.0)
    gained = (ids for ids in table.sets if table.of(ids) - table.of(named) > (least_gain(ids) if named else least))
    could = (ids for ids in gained if ids != named and has_the_odds(search, table, families, ids))
    better = next((ids for ids in could if named or _lessens(search, ids)), None)
    if not better:
        return named, ""
    effects = sorted(effect for effect in better if not is_free(effect))
    forms = len(better) - len(effects)
    what = " and ".join([*effects, *([counted(forms, "free-form term")] if forms else [])])
    return better, f"a model with {what} fits better, but predicts held-out commands no better than chance"


def _displaces(search: Search, table: Standing, other: Set, named: Set) -> bool:
    """Whether a set that does without one of the named effects has so much better odds that this casts doubt on it.

    A known value that it moves in place of an effect stands for it.
    """
    moved = far(search.fits[other], search.tolerance)
    without = any(not _moves_in_place_of(moved, effect) for effect in named - other)
    return without and table.of(other) - table.of(named) > DISPLACED


def _lessens(search: Search, ids: Set) -> bool:
    """Whether a set lessens the residuals of left-out commands by MATERIAL (RMS) on average."""
    gain = mean_gain(search.fits[ids], search.null, search.problem.data, search.tolerance)
    return gain > -2 * math.log(1 - MATERIAL)


def _predicts(search: Search, ids: Set, other: Set) -> bool:
    """Whether a set predicts left-out commands significantly better than another; True if that was not fitted."""
    if other not in search.fits:
        return True
    fits = search.fits[ids], search.fits[other]
    if search.problem.open_ground:
        candidates = sum(not is_free(effect) for effect in search.terms)
        return predicts_better(*fits, search.problem.data, search.tolerance, candidates)
    gain, error = advantage(*fits, search.problem.data, search.tolerance)
    return gain > BETTER_BY and gain > BETTER_SIGMAS * error


def _rivals(search: Search, ids: Set, named: Set, *, probable: bool) -> bool:
    """Whether a set predicts left-out commands better than named effects; no worse if it is more probable.

    probable: by what an effect must gain. Scrub torque and drag imitate a drive that mixes its sides: in recordings of
    a Warthog both predict left-out commands as the mixing does, but the mixing, which the encoders confirm, has 17 to
    28 more of log evidence.
    """
    predicts = _predicts(search, ids, named)
    if predicts or not (named and probable):
        return predicts
    return mean_gain(search.fits[ids], search.fits[named], search.problem.data, search.tolerance) > 0


def _is_significant(search: Search, ids: Set) -> bool:
    """Whether each free-form term has a coefficient that differs from zero by the jackknife over commands."""
    fit = search.fits[ids]
    sigma = np.sqrt(np.diag(covariance_over_commands(fit, search.problem.data, search.tolerance)))
    size = np.abs([fit.point.value(column) for column in fit.columns])

    def is_significant(effect: str) -> bool:
        own = [i for i, column in enumerate(fit.columns) if column.key == effect]
        return bool((size[own] > -special.ndtri(FALSE_POSITIVE / 2 / len(own)) * sigma[own]).any())

    return all(is_significant(effect) for effect in ids if is_free(effect))


def doubts(left: Adequacy, constant: Sequence[Constancy], *, material: bool = True, named: bool = False) -> str:
    """The reason why residuals and random effects of a model are not random; empty if they are.

    material: whether the residuals move the marks by what matters to the user. In a filmed session without an effect,
    two of 16 runs had slow errors of tracking of 2 µm beyond noise of 5 µm, which is significant, and no physics.
    named: whether the model has an effect. It is no finding if residuals show that the model is wrong, however little
    they move the marks: of a wheel that wobbled, a mark-offset imitated a part, and left 2.5 times the noise.
    """
    counts = material or (named and left.excess > EXPLAINED)
    if counts and left.excess > EXCESS and left.excess_sigma > EXCESS_SIGMA:
        return f"residuals are {left.excess:.2f} times the tracking noise ({left.excess_sigma:.0f} sigmas)"
    if left.order_p < NOT_CHANCE:
        return f"the {left.depends_on}, significantly (probability {left.order_p:.1g})"
    if left.widest:
        return left.widest
    for item in constant:
        if item.probability < NOT_CHANCE:
            return f"the effect differs in size between {item.halves} (probability {item.probability:.1g})"
    return ""
