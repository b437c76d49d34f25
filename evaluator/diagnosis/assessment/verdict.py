"""The verdict: significance of each effect, comparison with free-form terms, and remaining doubts."""

from __future__ import annotations

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
    predicts_better,
)
from evaluator.diagnosis.assessment.knowledge import ALIKE, far, strained, together
from evaluator.diagnosis.assessment.model_comparison import Set, Standing, is_free, score
from evaluator.diagnosis.inference.search import LARGEST_SET, Search
from evaluator.diagnosis.likelihood.known_to import START
from evaluator.wording import counted

Verdict = Literal["none", "effect", "unknown", "insufficient"]

# An effect stays in the model where leaving it out costs this much of the log posterior, by the size of the set: odds
# of 3000 to 1, for a second one as for the first, or for a free-form term. Odds of 90 to 1 were enough in worlds whose
# errors are exactly those of the model; in the second world (tests/laboratory), whose errors are not, an untidy
# experiment earned 1100 to 1 (7.0), and a second effect beside a true one 900 to 1 (6.8), a gradient of friction on a
# plate without one: that something is missing says nothing of what else is. An effect that shows by five sigmas earns
# about nine. Several named effects together can imitate physics that has no name, so sets of three must earn more.
KEEP = (8.0, 8.0, 8.0, 12.0)
# And this much, odds of 400 to 1, where it stands for values that would have to be off by more than chance allows: then
# something is missing anyway.
RELIEVING = 6.0
# Named effects are the answer where the free-form terms together have at most this probability beside them. In
# development experiments they had 0.01 % at most where the named effects were true (34 of 34; in two made by another
# program, 15 and 17 %), and 79 % or more where these imitated something else (17 of 19; in two, where the data do not
# tell it from the named ones, 14 and 15 %).
DOUBT = 0.2
# Left-overs above noise: mean square and its standard errors. The noise of slow modes is carried over from fast ones,
# which is good to some ten per cent; beyond, motion is left.
EXCESS = 1.12
EXCESS_SIGMA = 5.0
# A free-form term is the answer where it predicts commands left out better by so much, and by so many of its standard
# errors. Of right answers in the development bank no free-form term gained more than 1.5, of wrong ones eight and more.
# One of a hundred families may gain as much by chance: it must be the more probable than without it, and with all that
# stands beside it more probable than nothing. Under heavy-tailed noise one beside a scale that was off by chance,
# together 29 times less probable than nothing, has passed for physics.
BETTER_BY, BETTER_SIGMAS = 4.0, 2.0
FALSE_POSITIVE = 0.05  # probability that the interval of any coefficient of a family excludes zero by chance
# Friction and gains that depend on something known are not chance: the probability at which that is believed.
NOT_CHANCE = 1e-3
LATE = "command-lag"  # does what a clock does that is off, where commands and poses are logs


# On open ground what the best model leaves is the noise, and a hundred families that each follow some of it pay by the
# measure above. There a term without a name is an answer only where it lessens the left-overs of the runs by this share
# (RMS): less is within what ground does anyway. A run of a few seconds has about so many slow modes that could tell.
MATERIAL, SLOW_MODES = 0.2, 3


def material_gain(runs: int) -> float:
    """Log evidence that free-form terms must bring beside what they stand with, on open ground."""
    return -SLOW_MODES * runs * math.log(1 - MATERIAL)


def least_gain(ids: Set) -> float:
    """Log odds that each effect of a set must earn."""
    return KEEP[min(len(ids), LARGEST_SET - 1 if any(map(is_free, ids)) else LARGEST_SET)]


# Values that no set may move beyond three of their tolerances, unless the model without effects does so too. Of some
# 25, one in fifteen laboratories has one so far off, one in five hundred two. Two effects that undo each other, or an
# effect and the tolerances, run away against each other and drag several with them.
STRAINED = 2


def pays(search: Search, table: Standing, families: int, ids: Set) -> bool:
    """Whether each effect of a set pays for itself, and all together, and what is known holds: it may be an answer.

    A single named effect need earn less where it stands for what else several values together would have to be off by
    more than chance allows. A set with an effect at the bound of what it may be stands for something that it is not. On
    open ground odds alone say little, as the noise is what the best model leaves: there each effect must carry over to
    commands left out, too.
    """
    return has_the_odds(search, table, families, ids) and (not search.problem.open_ground or carries_over(search, ids))


def carries_over(search: Search, ids: Set) -> bool:
    """Whether commands left out are predicted better with each effect of a set than without it, beyond chance.

    A set without an effect that does the same by what is known, beyond three of its tolerances, predicts as well, and
    yet is no answer: clocks that agree to hundredths of a second do not make motors late by a tenth.
    """
    return all(_is_stood_for(search, effect, ids) or _predicts(search, ids, ids - {effect}) for effect in ids)


def _is_stood_for(search: Search, effect: str, ids: Set) -> bool:
    """Whether a set without one of its effects moves a value that does the same beyond what is known of it."""
    without = search.fits.get(ids - {effect})
    if without is None:
        return False
    moved = far(without, search.tolerance) - far(search.fits[ids], search.tolerance)
    return any(effect == (LATE if key == START else ALIKE.get(key)) for key in moved)


def has_the_odds(search: Search, table: Standing, families: int, ids: Set) -> bool:
    """Whether each effect of a set pays for itself by its odds, and all together, and what is known holds: see pays."""
    if not may_be_right(search, ids):
        return False
    least, first = least_gain(ids), KEEP[1]
    if len(ids) == 1 and not any(map(is_free, ids)) and _relieves(search, ids):
        least = first = RELIEVING
    # two effects that undo each other cost much to part, and may together gain nothing over none
    gained = not ids or table.of(ids) - score(search, frozenset(), families) > first
    return gained and all(table.of(ids) - score(search, ids - {effect}, families) > least for effect in ids)


def may_be_right(search: Search, ids: Set) -> bool:
    """Whether a set may be an answer, however probable: it neither ends at a bound nor bends what is known."""
    return not (ids and (_strains(search, ids) or _at_bounds(search, ids)))


def _relieves(search: Search, ids: Set) -> bool:
    """Whether what is known to a tolerance is off beyond chance without a set, all together, and not with it."""
    without, with_it = (together(fit, search.tolerance) for fit in (search.null, search.fits[ids]))
    return without.is_finding and not with_it.is_finding


def _at_bounds(search: Search, ids: Set) -> bool:
    """Whether a set has an effect at or beyond the bound of what it may be: it stands for something that it is not."""
    return bool(search.fits[ids].at_bounds or search.fits[ids].unbelieved)


def _strains(search: Search, ids: Set) -> bool:
    """Whether a set stands only where values lie that no laboratory would have stated."""
    far = strained(search.fits[ids], search.null, search.tolerance, on_ground=search.problem.open_ground)
    return len(far) >= STRAINED


def best_named(search: Search, table: Standing, families: int) -> Set:
    """The best set of named effects of which each pays for itself."""
    named = (ids for ids in table.sets if not any(map(is_free, ids)))
    return next(ids for ids in named if pays(search, table, families, ids))


def decide(
    search: Search, table: Standing, families: int, named: Set, least_material: float = -math.inf
) -> tuple[Set, Verdict, str]:
    """Verdict between the best named set and everything free-form.

    Several effects of which one does not pay speak for nothing: three that were refused for imitating what has no name
    do not support two of them, and a term without a name that gains little beside named ones casts no doubt on these.
    least_material: see material_gain; minus infinity but on open ground. There a term without a name makes an unknown
    of the runs only if it predicts commands left out better, too, and if its size is told over commands.
    """

    def named_of(ids: Set) -> Set:
        return frozenset(effect for effect in ids if not is_free(effect))

    def gain(ids: Set) -> float:
        return table.of(ids) - score(search, named_of(ids), families)

    within = [ids for ids in table.sets if not _at_bounds(search, ids)]
    free = [ids for ids in within if ids != named_of(ids) and gain(ids) > least_material]
    answers = [ids for ids in within if len(ids) == 1 or pays(search, table, families, ids)]
    likely = [ids for ids in answers if ids in free]
    # on open ground what is left is the noise, so that odds alone say little: it must carry over, too
    if least_material > -math.inf:
        free = [ids for ids in free if _is_significant(search, ids)]
        likely = [ids for ids in likely if ids in free and _predicts(search, ids, named)]
    doubted = bool(likely) and table.share_of(likely, answers) > DOUBT
    if doubted and pays(search, table, families, likely[0]):
        return likely[0], "unknown", "a free-form term explains the runs at least as well as the effects found"
    # also better than named effects that do not pay for themselves: chance that looks like one looks like both
    likeliest = next(ids for ids in table.sets if not any(map(is_free, ids)))
    for ids in free:
        if (
            gain(ids) > 0
            and table.of(ids) > table.of(frozenset())
            and all(_predicts(search, ids, other) for other in {named, likeliest})
        ):
            return ids, "unknown", "a free-form term predicts held-out commands better than any effect of the catalogue"
    if search.problem.open_ground and not named:
        better = next((ids for ids in table.sets if ids and has_the_odds(search, table, families, ids)), None)
        if better is not None:
            forms = len(better) - len(named_of(better))
            what = " and ".join([*sorted(named_of(better)), *([counted(forms, "free-form term")] if forms else [])])
            reason = f"a model with {what} fits better, but predicts held-out commands no better than chance"
            return named, "insufficient", f"{reason}: runs of more commands are needed"
    if named:
        return named, "effect", "each effect is significant by itself, and no free-form term explains more"
    return named, "none", "the model explains the data within noise and tolerances"


def _predicts(search: Search, ids: Set, other: Set) -> bool:
    """Whether a set predicts commands left out better than another, beyond chance; yes where that was not fitted."""
    if other not in search.fits:
        return True
    fits = search.fits[ids], search.fits[other]
    if search.problem.open_ground:
        return predicts_better(*fits, search.problem.data, search.tolerance)
    gain, error = advantage(*fits, search.problem.data, search.tolerance)
    return gain > BETTER_BY and gain > BETTER_SIGMAS * error


def _is_significant(search: Search, ids: Set) -> bool:
    """Whether each term without a name has a coefficient that is not nought, in intervals that hold over commands."""
    fit = search.fits[ids]
    sigma = np.sqrt(np.diag(covariance_over_commands(fit, search.problem.data, search.tolerance)))
    size = np.abs([fit.point.value(column) for column in fit.columns])

    def is_significant(effect: str) -> bool:
        own = [i for i, column in enumerate(fit.columns) if column.key == effect]
        return bool((size[own] > -special.ndtri(FALSE_POSITIVE / 2 / len(own)) * sigma[own]).any())

    return all(is_significant(effect) for effect in ids if is_free(effect))


def doubts(left: Adequacy, constant: Sequence[Constancy]) -> str:
    """Why what a model leaves over is not noise and chance; empty where it is."""
    if left.excess > EXCESS and left.excess_sigma > EXCESS_SIGMA:
        return f"residuals are {left.excess:.2f} times the tracking noise ({left.excess_sigma:.0f} sigmas)"
    if left.order_p < NOT_CHANCE:
        return f"the {left.depends_on}, significantly (probability {left.order_p:.1g})"
    if left.widest:
        return left.widest
    for item in constant:
        if item.probability < NOT_CHANCE:
            return f"the effect differs in size between {item.halves} (probability {item.probability:.1g})"
    return ""
