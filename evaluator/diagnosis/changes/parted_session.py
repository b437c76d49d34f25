"""A session of two parts that are explained apart and not together: something was changed between two runs.

A plate is put back on another day, marks are glued on anew, a motor driver is replaced. Every value of the laboratory
may then differ between the runs before and after, which no value common to all runs and no effect describes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from evaluator.diagnosis.assessment.gap import farthest_followed, run_gaps
from evaluator.diagnosis.assessment.knowledge import knowledge
from evaluator.diagnosis.assessment.model_comparison import Set, evidence_of_runs
from evaluator.diagnosis.assessment.verdict import KEEP
from evaluator.diagnosis.experiment import Session
from evaluator.diagnosis.inference.fit import EXPLAINED
from evaluator.diagnosis.inference.fitted_model import Fit
from evaluator.diagnosis.inference.search import Search, fit_set, log_prior
from evaluator.diagnosis.inference.watch import Watch
from evaluator.diagnosis.likelihood.known_to import Quantity
from evaluator.diagnosis.likelihood.linear.random_effects import place_runs
from evaluator.diagnosis.likelihood.problem import Problem
from evaluator.diagnosis.mistakes.repainted import FEWEST_OF_PART
from evaluator.diagnosis.search_input import prepared
from evaluator.diagnosis.search_runs import null_alone
from evaluator.turning.motion.curvature import Z_975

CHANGE_PRIOR = 0.05  # one session in twenty is continued on another day or with another part
CHANGED_SIGMAS, MOST_NAMED = 3.0, 3  # change of a value from which it is named, and number of these


@dataclass(frozen=True)
class Parted:
    """The fits of the model to both parts, their runs in the session, and the gain in log odds over one model."""

    fits: tuple[Fit, Fit]
    runs: tuple[tuple[int, ...], tuple[int, ...]]
    gain: float

    def sentence(self, ids: Sequence[str], quantities: Sequence[Quantity]) -> str:
        """What was found, in words. ids: of all runs of the session. quantities: known to a tolerance."""
        parts = " and ".join(f"{ids[runs[0]]} to {ids[runs[-1]]}" for runs in self.runs)
        changed = "; ".join(self._changed(quantities)[:MOST_NAMED])
        values = f", with values that differ: {changed}" if changed else ""
        return (
            f"the runs {parts} are each explained by themselves, and not together{values}; what was changed between "
            "them (day, plate, camera, marks, battery, driver)? Diagnose them apart"
        )

    def _changed(self, quantities: Sequence[Quantity]) -> list[str]:
        """Quantities that differ significantly, most significant first, with their deviations before and after."""
        found = []
        for before, after in zip(*(knowledge(quantities, fit) for fit in self.fits), strict=True):
            half = math.hypot(before.high - before.found, after.high - after.found)  # of the interval of the difference
            sigmas = Z_975 * abs(after.found - before.found) / max(half, 1e-300)
            if sigmas > CHANGED_SIGMAS:
                unit = "" if before.quantity.unit == "1" else f" {before.quantity.unit}"
                found.append(
                    (sigmas, f"{before.quantity.name} off by {before.found:+.2g} and {after.found:+.2g}{unit}")
                )
        return [words for _, words in sorted(found, reverse=True)]


def parted(search: Search, session: Session, watch: Watch, rivals: Sequence[Set] = ()) -> Parted | None:
    """The two parts of a session, in its order, that the model explains apart; None if one model explains all as well.

    Each part is prepared by itself, with its own noise: a disagreement of both inflates the noise of the session. The
    model without effects must explain every run of each, and their evidence together, with a prior that allows any
    split, must exceed that of the model and of the rivals for all runs, at the noise of the parts, by what an effect
    must gain.
    """
    null = search.reached(frozenset())
    ordered = sorted(search.runs, key=lambda run: search.problem.data[run].order)
    splits = range(FEWEST_OF_PART, len(ordered) - FEWEST_OF_PART + 1)
    if null is None or not splits:
        return None
    rows = [null.runs.index(run) for run in ordered]
    split = max(splits, key=lambda k: sum(evidence_of_runs(search, null, part) for part in (rows[:k], rows[k:])))
    runs = tuple(ordered[:split]), tuple(ordered[split:])
    parts = [_explained(session.of_runs(part), watch) for part in runs]
    first, second = parts
    if first is None or second is None:
        return None
    problem = _with_noise_of(search.problem, zip(runs, (first[0], second[0]), strict=True))
    whole = search.anew(problem=problem)
    for ids in dict.fromkeys([frozenset[str](), *rivals]):
        before = search.reached(ids)
        if before is not None:
            fit_set(whole, ids, before.point.terms, before)
    apart = sum(fit.posterior.log_evidence for _, fit in (first, second)) + math.log(CHANGE_PRIOR / len(splits))
    count = len(search.terms)
    best = max(whole.evidence(ids) + log_prior(len(ids), count) for ids in (*whole.fits, *whole.failed))
    gain = apart + log_prior(0, count) - best
    return Parted((first[1], second[1]), runs, gain) if gain > KEEP[1] else None


def _explained(session: Session, watch: Watch) -> tuple[Problem, Fit] | None:
    """A session's problem and its model without effects fitted; None if that does not explain every run."""
    try:
        part, fit = null_alone(prepared(session, watch, None))
        if fit is None or fit.excess >= EXPLAINED:  # one that has not converged has a lower bound of its evidence
            return None
        by_marks = part.problem.of_tracking
        placed = place_runs(by_marks, fit.point, part.runs, fit.posterior.scatter)
    except FloatingPointError:  # a run cannot be simulated on the way
        return None
    follows = (run_gaps(by_marks, placed, part.runs) <= farthest_followed(part.problem, part.runs)).all()
    return (part.problem, fit) if follows else None


def _with_noise_of(problem: Problem, parts: Iterable[tuple[Sequence[int], Problem]]) -> Problem:
    """The problem of all runs with the noise of problems of some runs each, which together are all."""
    channels, noise, compressions = list(problem.channels), list(problem.noise), list(problem.compressions)
    for runs, part in parts:
        for own, run in enumerate(runs):
            channels[run], noise[run] = part.channels[own], part.noise[own]
            compressions[run] = part.compressions[own]
    return replace(problem, channels=tuple(channels), noise=tuple(noise), compressions=tuple(compressions))
