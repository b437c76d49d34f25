"""Whether the runs suffice for the verdict "unknown", or scatter between them is as plausible.

There are two kinds of evidence for unknown physics. A model may fail to explain the motion within runs: then each run
is evidence by itself, but single runs also go wrong, so that more runs must disagree than may be outlying. Or it may
explain each run with friction, speeds and starts that depend on something known: then each run is a single number, and
the dependence must be distinguished from random scatter between runs.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Hashable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import special

from evaluator.diagnosis.assessment.adequacy import FEWEST_FREEDOM, Adequacy, tells_friction
from evaluator.diagnosis.assessment.model_comparison import FREE_PRIOR
from evaluator.diagnosis.inference.fit import EXPLAINED
from evaluator.diagnosis.likelihood.linear.mixed_model import SCATTER

Floats = NDArray[np.float64]

SEVERAL = 2  # runs that one law must explain; a single one it may have been fitted to
# Largest scatter of the friction from run to run of an ordinary laboratory. Under a wheel that was blocked, 26 %
# [16, 30] would have explained 16 runs.
USUAL_FRICTION = 0.1
BOUND = 0.025  # of a scatter, one-sided
CHANGE, FEWEST_OF_SCATTER = 3, 3  # parameters of a change over the session; degrees of freedom that tell a scatter
SIDES, WAYS = (("left", 1.0), ("right", -1.0)), (("forward", 1.0), ("backward", -1.0))
ODD_SHARE = 0.05  # share of recordings that go wrong by themselves


def most_odd(runs: int) -> int:
    """Largest number of independently disagreeing runs for which unknown physics is not the more probable cause.

    More runs go wrong less often than a laboratory has unknown physics (FREE_PRIOR): of 4 runs 1, of 24 runs 3.
    """
    return int(np.argmax(special.bdtr(np.arange(runs + 1), runs, ODD_SHARE) >= 1 - FREE_PRIOR))


def gathered(odd: Collection[int], kinds: Sequence[Hashable]) -> Hashable | None:
    """The kind of run that independent accidents would hardly have gathered in; None if they may be accidents.

    odd: indices of the runs that disagree. kinds: of all runs, equal for runs of the same command. Accidents are spread
    over the commands; several runs of one command show physics that acts at this command, even if most_odd permits
    their number. Accidents are excluded if so many of one kind are less probable than unknown physics (FREE_PRIOR,
    Bonferroni over the kinds): of 10 kinds 2 of 2 runs, or 3 of 5.
    """
    runs, missed = Counter(kinds), Counter(kinds[run] for run in odd)
    several = [kind for kind, count in missed.items() if count > 1]
    chance = {kind: float(special.bdtrc(missed[kind] - 1, runs[kind], ODD_SHARE)) for kind in several}
    least = min(chance, key=lambda kind: chance[kind], default=None)
    return least if least is not None and chance[least] * len(runs) < FREE_PRIOR else None


def not_driven(commands: Sequence[tuple[float, float]]) -> list[str]:
    """Kinds of motion that commands (rpm of the left and right wheels) lack, so that what acts there was not tested."""
    turns = {float(np.sign(right - left)) for left, right in commands} - {0.0}
    ways = {float(np.sign(left + right)) for left, right in commands} - {0.0}
    sides = ["turns"] if not turns else [f"{side} turns" for side, sign in SIDES if sign not in turns]
    return sides + [f"{way} motion" for way, sign in WAYS if ways and sign not in ways]


def fewest_runs(parameters: int) -> int:
    """Least number of runs that distinguish a law with this number of parameters from random scatter between runs."""
    return FEWEST_FREEDOM + 1 + parameters


def too_few(left: Adequacy, parameters: int, with_law: Adequacy | None = None) -> str:
    """Why these runs are insufficient for the verdict "unknown"; empty if they suffice.

    left: residuals of the model without effects. parameters: number of parameters of the law that would explain them.
    with_law: residuals with that law, if there is one. If it explains all runs that disagree by themselves, and these
    are several, they are not independent accidents.
    """
    runs, missed = len(left.by_run), int(np.count_nonzero(left.by_run > EXPLAINED))
    wanted = fewest_runs(parameters)
    mended = with_law is not None and missed >= SEVERAL and not (with_law.by_run > EXPLAINED).any()
    if mended or missed > most_odd(runs) or runs >= wanted:
        return ""
    within = (
        f"{missed} of {runs} runs contradict the model individually"
        if missed
        else "no run contradicts the model individually"
    )
    return (
        f"{within}, and so few runs cannot distinguish a missing effect from scatter between runs (friction, speeds, "
        f"an odd run): repeat these commands forward and backward, until there are {wanted} runs"
    )


def unusual_friction(left: Adequacy, order: Floats, commands: Sequence[Hashable]) -> str:
    """Why friction differs more than a plate explains from run to run, so that it may hide an effect; empty if not.

    left: of a model that explains the runs with it; order, commands: of these runs. A change over the session, at once
    or evenly, and single odd runs are of the plate. Runs of the same command share every effect: where they scatter as
    much, nothing hides.
    """
    number, seen = SCATTER.index("friction"), np.flatnonzero(tells_friction(left, order))
    values, order = left.random_effects[seen, number] / np.sqrt(left.shares[seen, number]), order[seen]
    if len(values) - CHANGE < FEWEST_OF_SCATTER:
        return ""
    line = np.column_stack([np.ones(len(values)), order])
    steps = (np.column_stack([order < at, order >= at]).astype(float) for at in np.unique(order)[1:])
    rest = min(float(np.sum((values - of @ np.linalg.lstsq(of, values, rcond=None)[0]) ** 2)) for of in (line, *steps))
    groups: dict[Hashable, list[float]] = {}
    for run, value in zip(seen.tolist(), values, strict=True):
        groups.setdefault(commands[run], []).append(float(value))
    within = sum(float(np.var(group)) * len(group) for group in groups.values())
    freedom = len(values) - len(groups)
    found = _least_scatter(rest, len(values) - CHANGE)
    if found <= USUAL_FRICTION or (freedom >= FEWEST_OF_SCATTER and _least_scatter(within, freedom) > USUAL_FRICTION):
        return ""
    scatter = 100 * np.sqrt(rest / (len(values) - CHANGE))
    return (
        f"the model explains the runs only if friction differs from run to run by {scatter:.0f} % (at least "
        f"{100 * found:.0f} %), more than plates do: an effect may hide in it; repeat runs of several commands, whose "
        "friction is then alike if it does"
    )


def _least_scatter(squares: float, freedom: int) -> float:
    """Lower bound of a scatter from squares with a number of degrees of freedom."""
    return float(np.sqrt(squares / special.chdtri(freedom, BOUND)))
