"""The verdict: which effects pay for themselves, when a free-form term answers better, and what is left to doubt."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from evaluator.discrepancy.adequacy import Adequacy
from evaluator.discrepancy.crossval import Constancy, advantage
from evaluator.discrepancy.rivals import Set, Standing, is_free, score
from evaluator.discrepancy.search import LARGEST_SET, Search

Verdict = Literal["none", "effect", "unknown", "insufficient"]

# An effect stays in the model where leaving it out costs this much of the log posterior, by the size of the set: odds
# of 90 to 1 for the first, or for a free-form term where no effect is named, 30 to 1 for a second, as something is
# missing then anyway. At odds of 20 to 1 one of 61 clean experiments of earlier blind banks was misread. Several named
# effects together can imitate physics that has no name, so sets of three must earn more.
KEEP = (4.5, 4.5, 3.5, 12.0)
# Named effects are the answer where the free-form terms together have at most this probability beside them. In
# development experiments they had 8 % at most where the named effects were true (26 of 26), 15 and 17 % in two made by
# another program, and 25 % or more where these imitated something else (6 of 8; two, hardly visible, had 7 %).
DOUBT = 0.2
# Left-overs above noise: mean square and its standard errors. The noise of slow modes is carried over from fast ones,
# which is good to some ten per cent; beyond, motion is left.
EXCESS = 1.12
EXCESS_SIGMA = 5.0
# A free-form term is the answer where it predicts commands left out better by so much, and by so many of its standard
# errors. Of right answers in the development bank no free-form term gained more than 1.5, of wrong ones eight and more.
# One of a hundred families may gain as much by chance: it must be the more probable than nothing too.
FORETOLD, FORETOLD_SIGMA = 4.0, 2.0
# Friction and gains that depend on something known are not chance: the probability at which that is believed.
NOT_CHANCE = 1e-3


def kept(search: Search, table: Standing, families: int) -> Set:
    """The best set of named effects of which each pays for itself."""
    for ids in table.sets:
        if any(is_free(effect) for effect in ids):
            continue
        if all(table.of(ids) - score(search, ids - {effect}, families) > KEEP[len(ids)] for effect in ids):
            return ids
    return frozenset()


def decide(search: Search, table: Standing, named: Set) -> tuple[Set, Verdict, str]:
    """Verdict between the best named set and everything free-form."""
    free = [ids for ids in table.sets if any(is_free(effect) for effect in ids)]
    # sets of three that did not earn to be named do not speak against what they may imitate
    likely = [ids for ids in table.sets if ids in free or len(ids) <= max(len(named), LARGEST_SET - 1)]
    if free and table.of(free[0]) - table.of(frozenset()) > KEEP[1] and table.share_of(free, likely) > DOUBT:
        return free[0], "unknown", "a free-form term explains the runs as well as the named effects, or better"
    # also better than named effects that do not pay for themselves: chance that looks like one looks like both
    likeliest = next(ids for ids in table.sets if ids not in free)
    for ids in [ids for ids in free if table.of(ids) > table.of(frozenset())]:
        if all(_foretells(search, ids, other) for other in {named, likeliest}):
            return ids, "unknown", "a free-form term foretells commands left out better than any named effect"
    if named:
        return named, "effect", "each effect pays for itself, and nothing is left that a free-form term could explain"
    return named, "none", "the model explains the data within noise and tolerances"


def _foretells(search: Search, ids: Set, other: Set) -> bool:
    """Whether a set predicts commands left out better than another, beyond chance."""
    gain, error = advantage(search.fits[ids], search.fits[other], search.problem.data, search.tolerance)
    return gain > FORETOLD and gain > FORETOLD_SIGMA * error


def doubts(left: Adequacy, constant: Sequence[Constancy]) -> str:
    """Why what a model leaves over is not noise and chance; empty where it is."""
    if left.excess > EXCESS and left.excess_sigma > EXCESS_SIGMA:
        return f"left-overs are {left.excess:.2f} times the tracking noise ({left.excess_sigma:.0f} sigmas)"
    if left.order_p < NOT_CHANCE:
        return f"the {left.depends_on}, which is not chance (probability {left.order_p:.1g})"
    for item in constant:
        if item.probability < NOT_CHANCE:
            return f"the effect differs in size between {item.halves} (probability {item.probability:.1g})"
    return ""
