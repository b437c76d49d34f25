"""Parameters of an experiment: the common ones as columns of a linearization, and the point at which it is made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.known_to import START
from evaluator.diagnosis.likelihood.run_data import SHARED_UNIT, START_POSE, Task, is_shared
from simulator.effects.coordinates import Candidate

Floats = NDArray[np.float64]

NOMINAL_STEP = 5e-4  # relative, for differences: a hundredth of a tolerance of 5 %
NOMINAL_STEPS = {"body": 5e-3}  # larger, because mass has little influence except by inertia
SHARED_STEP = 0.05 * SHARED_UNIT  # a twentieth of a standard deviation
STEP_SHARE = 0.2  # of a visible step: with larger steps, curvature would separate effects that equal random effects


@dataclass(frozen=True)
class Column:
    """A common parameter: a nominal value (term is None) or one coordinate of a term, with derivatives at start values.

    to: coordinates to which the term is changed as a whole; the parameter is then the share of this change.
    """

    key: str
    coordinate: int = 0
    term: Candidate | None = None
    start: tuple[float, ...] | None = None
    to: tuple[float, ...] | None = None

    @property
    def step(self) -> float:
        """Step of the finite difference."""
        if self.to is not None:
            return 1.0
        if self.term is None:
            return SHARED_STEP if is_shared(self.key) else NOMINAL_STEPS.get(self.key.split(".")[0], NOMINAL_STEP)
        return STEP_SHARE * self.term.coordinates[self.coordinate].step

    @property
    def has_two_sides(self) -> bool:
        """Whether the motion depends smoothly on it; a start before the first frame hides how the robot starts."""
        return self.key != START

    @property
    def absent(self) -> float:
        """Value at which the parameter has no influence."""
        return 0.0 if self.term is None else self.term.coordinates[self.coordinate].absent

    @property
    def prior_sigma(self) -> float:
        """Standard deviation from the absent value before any run is seen (see Coordinate); infinite: not known."""
        if self.term is None or self.start is not None or self.to is not None:
            return np.inf
        return self.term.coordinates[self.coordinate].prior_sigma


@dataclass(frozen=True)
class Point:
    """Nominal deviations, term coordinates, and the parameters per run (n, 7) as in Task."""

    per_run: Floats
    nominal: Mapping[str, float] = field(default_factory=dict)
    terms: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    def without_absent(self, columns: Sequence[Column]) -> Point:
        """The point without those terms of these columns that have no influence, with the same motion.

        A fit that begins there can reuse the simulations of a screening.
        """
        absent = {column.key: column.term.absent for column in columns if column.term is not None}
        kept = {effect: values for effect, values in self.terms.items() if values != absent.get(effect)}
        return self if len(kept) == len(self.terms) else replace(self, terms=kept)

    def without_scatter(self) -> Point:
        """The point with the start poses of all runs, but the nominal friction, gains and starts of the motors."""
        per_run = self.per_run.copy()
        per_run[:, START_POSE:] = 0.0
        return replace(self, per_run=per_run)

    def moved(self, column: Column, amount: float) -> Point:
        """The point with one common parameter changed by amount, or to column.to if given."""
        if column.term is None:
            nominal = {**self.nominal, column.key: self.nominal.get(column.key, 0.0) + amount}
            return Point(self.per_run, nominal, self.terms)
        values = list(column.to or self.terms.get(column.key, column.start or column.term.absent))
        values[column.coordinate] += 0.0 if column.to else amount
        return Point(self.per_run, self.nominal, {**self.terms, column.key: tuple(values)})

    def beside(self, columns: Sequence[Column], way: float) -> Point:
        """The point with all these parameters changed by one step of their derivatives, ahead (1) or back (-1)."""
        point = self
        for column in columns:
            point = point.moved(column, way * column.step)
        return point

    def value(self, column: Column) -> float:
        """Value of a common parameter relative to its absent value."""
        if column.term is None:
            return self.nominal.get(column.key, 0.0)
        values = self.terms.get(column.key)
        return 0.0 if values is None else values[column.coordinate] - column.absent

    def is_within_bounds(self, column: Column) -> bool:
        """Whether a term is within its bounds; outside, simulations may take long: motors faster under load chatter."""
        values = self.terms.get(column.key, ())
        return column.term is None or column.term.clipped(values) == tuple(values)

    def at(self, columns: Sequence[Column], theta: Floats) -> Point:
        """The point with common parameters at values (p,) relative to their absent values."""
        nominal, values = dict(self.nominal), {effect: list(value) for effect, value in self.terms.items()}
        for column, value in zip(columns, theta, strict=True):
            if column.term is None:
                nominal[column.key] = float(value)
            else:
                values[column.key][column.coordinate] = float(value + column.absent)
        return Point(self.per_run, nominal, {effect: tuple(value) for effect, value in values.items()})

    def task(self, run: int, shift: Floats | None = None) -> Task:
        """Parameters for the simulation of one run; shift: added to the numbers per run, (7,)."""
        per_run = self.per_run[run] if shift is None else self.per_run[run] + shift
        return Task(run, tuple(per_run.tolist()), self.nominal, self.terms)


def theta_of(point: Point, columns: Sequence[Column]) -> Floats:
    """Values (p,) of common parameters at the point of linearization; 0 for a term at its start values."""
    return np.array([0.0 if column.start is not None else point.value(column) for column in columns])


def points_of(point: Point, columns: Sequence[Column]) -> tuple[list[Point], dict[tuple[str, tuple[float, ...]], int]]:
    """Points for the derivatives of every run, and indices of the base points of terms with start values."""
    points = [point]
    bases: dict[tuple[str, tuple[float, ...]], int] = {}
    for column in columns:  # a term with start values has a base point of its own
        if column.start is not None and (column.key, column.start) not in bases:
            bases[column.key, column.start] = len(points)
            points.append(replace(point, terms={**point.terms, column.key: column.start}))
    return points + [point.moved(column, column.step) for column in columns], bases
