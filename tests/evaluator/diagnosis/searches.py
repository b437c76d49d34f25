"""Searches and fits without a simulation, for tests of what a search does with them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from evaluator.diagnosis.inference.search import Search
from evaluator.diagnosis.likelihood.point import Point
from simulator.effects.coordinates import Candidate, Coordinate

NONE = frozenset[str]()


def candidate(name: str, *coordinates: Coordinate) -> Candidate:
    return Candidate(name, coordinates, lambda values: dict(zip("xyz", values, strict=False)))


LINE = candidate("line", Coordinate("size", 0.0, 1.0))


def searching(**more: Any) -> Search:
    runs: Any = SimpleNamespace(horizon_s=np.inf, watch=SimpleNamespace(so_far=""), open_ground=False)
    return Search(runs, {"a": LINE, "b": LINE}, {}, (0, 1), **more)


def of(evidence: float, *, excess: float = 1.0, converged: bool = True, shortfall: float = 0.0) -> Any:
    found = SimpleNamespace(posterior=SimpleNamespace(log_evidence=evidence), excess=excess, converged=converged)
    found.steps, found.overreaches, found.terms, found.shortfall = 3, False, NONE, shortfall
    found.point, found.columns = Point(np.ones((2, 7)), {"key": 1.0}), ()
    found.counting = lambda parameters: of(evidence - parameters) if parameters else found
    return found
