"""Whether the runs suffice for the verdict "unknown", or scatter between them is as plausible.

Two things speak for physics without a name. A model may miss what happens within runs: there every run is evidence by
itself, but runs also go wrong by themselves, so more of them must disagree than may be odd. Or it may fit each run and
leave friction, speeds and starts of the runs in an order that is not chance: there a run counts as one number, and the
scatter between runs has to be told from the law.
"""

from __future__ import annotations

import numpy as np
from scipy import special

from evaluator.diagnosis.assessment.adequacy import FEWEST_FREEDOM, Adequacy
from evaluator.diagnosis.assessment.model_comparison import FREE_PRIOR
from evaluator.diagnosis.inference.search import EXPLAINED

SEVERAL = 2  # runs: a law has to mend one that it might not have been made for
ODD_SHARE = 0.05  # of recordings that go wrong by themselves: one in twenty


def most_odd(runs: int) -> int:
    """How many of so many runs may disagree, each by itself, before physics without a name is the likelier cause.

    More than these go wrong less often than a laboratory has such physics (FREE_PRIOR): of 4 runs 1, of 24 runs 3.
    """
    return int(np.argmax(special.bdtr(np.arange(runs + 1), runs, ODD_SHARE) >= 1 - FREE_PRIOR))


def fewest_runs(parameters: int) -> int:
    """Runs from which on a law of so many parameters can be told from what is left to chance between runs."""
    return FEWEST_FREEDOM + 1 + parameters


def too_few(left: Adequacy, parameters: int, with_law: Adequacy | None = None) -> str:
    """Why these runs cannot carry that something without a name is missing; empty where they can.

    left: what the model without effects leaves over. parameters: of the law that would explain it. with_law: what is
    left over with that law, if there is one. Where it takes along all runs that miss the model by themselves, and they
    are several, they did not go wrong each by itself: one law would hardly mend two accidents.
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
