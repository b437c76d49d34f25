"""The result of a diagnosis: verdict, effects, fits and evidence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import pandas as pd

from evaluator.diagnosis.assessment.adequacy import Adequacy
from evaluator.diagnosis.assessment.cross_validation import Constancy
from evaluator.diagnosis.assessment.gap import Gap
from evaluator.diagnosis.assessment.knowledge import Knowledge, Together
from evaluator.diagnosis.assessment.model_comparison import Set, Standing
from evaluator.diagnosis.assessment.relevance import Changes
from evaluator.diagnosis.assessment.residuals.disagreement import Dependence
from evaluator.diagnosis.assessment.verdict import Verdict
from evaluator.diagnosis.design.next_runs import NextRuns
from evaluator.diagnosis.experiment import Session
from evaluator.diagnosis.inference.fitted_model import Fit
from evaluator.diagnosis.inference.limits import Limit
from evaluator.diagnosis.inference.profile_likelihood import Profile
from evaluator.diagnosis.inference.search import Search
from evaluator.diagnosis.likelihood.point import Point
from evaluator.diagnosis.likelihood.problem import Problem
from simulator.effects.coordinates import Candidate


@dataclass(frozen=True)
class Diagnosis:
    """Result of a diagnosis; fields that do not apply are None or empty."""

    verdict: Verdict
    reason: str
    session: Session
    held_out: tuple[int, ...] = ()
    problem: Problem | None = None
    search: Search | None = None  # over all runs
    fit_search: Search | None = None  # without the runs held out
    standing: Standing | None = None
    chosen: Set = frozenset()
    named: Set = frozenset()  # the best set of named effects
    profiles: Mapping[str, Profile] = field(default_factory=dict)  # of effects whose posterior is not normal
    separation: Mapping[str, Mapping[str, float]] | None = None
    leftover: Adequacy | None = None
    gap: Gap | None = None
    confirmation: float = float("nan")  # gain in log density of the runs held out
    terms: Mapping[str, Candidate] | None = None
    pieces: pd.DataFrame | None = None
    where: tuple[Dependence, ...] = ()
    pieces_after: pd.DataFrame | None = None  # with the residuals of the chosen model, fitted to all runs
    left: tuple[Dependence, ...] = ()  # all tested dependences of pieces_after, significant or not
    limits: tuple[Limit, ...] = ()  # of effects that the model lacks
    next_runs: NextRuns | None = None
    outlying: tuple[int, ...] = ()  # runs that the chosen model does not explain
    follows: bool = True  # whether the chosen model explains nearly all runs
    constancy: tuple[Constancy, ...] = ()  # of the best named effects
    changes: Mapping[str, Changes] = field(default_factory=dict)  # largest changes by each detected effect
    negligible: Set = frozenset()  # detected effects that are not relevant
    known: tuple[Knowledge, ...] = ()  # fitted values of quantities known to a tolerance
    known_together: Together | None = None  # joint test of these
    stopped: bool = False  # whether it was stopped by the time limit
    nominal: Point | None = None  # the model of the robot file, with the start poses of the runs

    @property
    def fit(self) -> Fit:
        """The fit of the chosen set on all runs."""
        assert self.search is not None
        return self.search.fits[self.chosen]

    @property
    def summary(self) -> str:
        """The verdict in a few words."""
        return f"{self.verdict} ({', '.join(sorted(self.chosen))})" if self.chosen else self.verdict
