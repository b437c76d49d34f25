"""Fitted values of quantities known to a tolerance, and tests of whether they contradict it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from evaluator.diagnosis.inference.bounds import bounds
from evaluator.diagnosis.inference.fitted_model import Fit
from evaluator.diagnosis.likelihood.known_to import (
    BESIDE,
    CLOCK,
    GRAVITY,
    LATER,
    LEVEL,
    RADIUS_DIFFERENCE,
    SCALE,
    START,
    Quantity,
)
from evaluator.turning.motion.curvature import Z_975
from evaluator.wording import verb

Floats = NDArray[np.float64]

# Effects with the same response as a quantity: a value far outside its tolerance may be such an effect.
ALIKE = {
    CLOCK: "time-base",
    SCALE: "plane-scale",
    RADIUS_DIFFERENCE: "drive-speed-mismatch",
    **dict.fromkeys(LEVEL, "plate-tilt"),
    **dict.fromkeys(GRAVITY, "mass-offset"),
    **dict.fromkeys(("wheels.radius_mm", "wheel.radius_mm"), "drive-speed-scale"),
    "slip.lateral_friction": "friction-across",
}
# Further ones: slip depends on ratios of speeds, so that a robot with faster wheels moves like one that was filmed with
# a slow clock.
ALSO_ALIKE = {CLOCK: ("drive-speed-scale",), **dict.fromkeys(("wheels.radius_mm", "wheel.radius_mm"), ("time-base",))}
OF_A_MARK = ("_x_mm", "_y_mm")  # suffixes of the keys of positions of marks and of the centre of gravity
DETERMINED = 0.5  # share by which the runs reduce the prior variance of a combination that they determine
ROUNDING = 1e-6  # of a variance, in those of the prior
MOST_NAMED = 4  # values in a sentence; all are in diagnosis.json
AT_END = 1e-3  # of the range of a value: distance from its bound below which a fit is at the bound
FINDING_SIGMAS = 3.0  # deviation in tolerances from which a value is reported: once in 370 by chance


@dataclass(frozen=True)
class Knowledge:
    """A quantity with its tolerance (1 sigma), and its fitted deviation with the 95 % interval."""

    quantity: Quantity
    found: float
    low: float
    high: float

    @property
    def is_finding(self) -> bool:
        """Whether the fitted deviation contradicts the tolerance; not of a change, which is told as that.

        On open ground the interval includes the scatter between commands and may be wider than the tolerance: a clock
        that was right was told as 4.1 tolerances off, which were 2.2 of its own standard errors.
        """
        least = FINDING_SIGMAS * max(self.quantity.sigma, (self.high - self.low) / (2 * Z_975))
        return not self.quantity.since and abs(self.found) > least

    @property
    def alike(self) -> str | None:
        """Id of the effect with the same response, if there is one."""
        key = self.quantity.key
        return ALIKE.get(key, "mark-offset" if key.endswith(OF_A_MARK) else None)

    @property
    def equivalent(self) -> tuple[str, ...]:
        """Ids of the effects that these runs cannot distinguish from the deviation."""
        return (*([self.alike] if self.alike else []), *ALSO_ALIKE.get(self.quantity.key, ()))

    @property
    def sentence(self) -> str:
        """The deviation in words."""
        item = self.quantity
        if item.key == "start_common_s":
            way = "later" if self.found > 0 else "earlier"
            return f"motion starts {1e3 * abs(self.found):.0f} ms {way} than start_s in all runs"
        unit = "" if item.unit == "1" else f" {item.unit}"
        same = self.equivalent
        tail = f" (equivalent to the {verb(len(same), 'effect', 'effects')} {' or '.join(same)})" if same else ""
        interval = f"[95 %: {self.low:.2g} to {self.high:.2g}]"
        return f"{item.name}: off by {self.found:+.2g}{unit} {interval}, tolerance {item.sigma:.2g}{unit}{tail}"


def knowledge(quantities: Sequence[Quantity], fit: Fit, covariance: Floats | None = None) -> tuple[Knowledge, ...]:
    """All quantities with their fitted deviations; quantities that are not in the fit keep their tolerance.

    Those that act beside an effect which the model lacks are omitted. covariance: of the parameters of the fit, if not
    its own: see cross_validation.covariance_of.
    """
    sigma = np.sqrt(np.diag(fit.posterior.covariance if covariance is None else covariance))
    at = {column.key: i for i, column in enumerate(fit.columns) if column.term is None}
    result = []
    for item in quantities:
        if item.key in at:
            found = fit.point.value(fit.columns[at[item.key]]) * item.per_unit
            half = Z_975 * float(sigma[at[item.key]]) * item.per_unit
            result.append(Knowledge(item, float(found), float(found - half), float(found + half)))
        elif item.key not in BESIDE:
            result.append(as_taken(item))
    return tuple(result)


def as_taken(item: Quantity) -> Knowledge:
    """A quantity that the runs do not determine, with its tolerance."""
    half = Z_975 * item.sigma
    return Knowledge(item, 0.0, -half, half)


@dataclass(frozen=True)
class Together:
    """Joint test of all values known to a tolerance.

    square: sum of the squared deviations in tolerances; freedom: number of combinations that the runs determine. If the
    model is complete, square is chi-square distributed with this freedom. furthest: keys with deviations in tolerances,
    largest first.
    """

    square: float
    freedom: int
    furthest: tuple[tuple[str, float], ...]

    @property
    def probability(self) -> float:
        """Of so large a square by chance."""
        return float(special.chdtrc(self.freedom, self.square)) if self.freedom else 1.0

    @property
    def is_finding(self) -> bool:
        """Whether the deviations are significant jointly, at the probability of FINDING_SIGMAS."""
        return self.probability < 2 * float(special.ndtr(-FINDING_SIGMAS))

    def sentence(self, quantities: Sequence[Quantity]) -> str:
        """The largest deviations in words."""
        names = {item.key: item.name for item in quantities}
        most = ", ".join(f"{names.get(key, key)} {sigmas:+.1f}" for key, sigmas in self.furthest[:MOST_NAMED])
        return (
            f"the values with a tolerance deviate jointly by more than chance (probability "
            f"{self.probability:.1g}; largest deviations, in tolerances: {most})"
        )


def together(fit: Fit, tolerance: Mapping[str, float], covariance: Floats | None = None) -> Together:
    """Joint test of the values of a fit, except for the start of motion, because cameras are started by hand.

    With prior covariance 1 (in tolerances) and posterior covariance S, deviations have the covariance 1 - S if the
    model is complete. Of its eigenvectors, those count that the runs determine. Of the values, those are told that the
    runs do not determine worse than their tolerance, as they may on open ground. covariance: see knowledge.
    Source: Box (1980), J. R. Stat. Soc. A 143, 383 (prior predictive check).
    """
    at = [
        i
        for i, column in enumerate(fit.columns)
        if column.term is None and column.key != START and not column.key.endswith(LATER)
    ]
    if not at:
        return Together(0.0, 0, ())
    sigma = np.array([tolerance[fit.columns[i].key] for i in at])
    found = np.array([fit.point.value(fit.columns[i]) for i in at]) / sigma
    left = (fit.posterior.covariance if covariance is None else covariance)[np.ix_(at, at)] / np.outer(sigma, sigma)
    determined, combinations = np.linalg.eigh(np.eye(len(at)) - left)
    counts = determined > DETERMINED
    preferred = (combinations.T @ found)[counts]
    order = np.argsort(-np.abs(found))
    told = np.diag(left) < 1.0 + ROUNDING
    furthest = tuple((fit.columns[at[k]].key, float(found[k])) for k in order if told[k])
    return Together(float(np.sum(preferred**2 / determined[counts])), int(counts.sum()), furthest)


def far(fit: Fit, tolerance: Mapping[str, float]) -> frozenset[str]:
    """Values known to a tolerance that a fit moves beyond FINDING_SIGMAS of it."""
    nominal = [column for column in fit.columns if column.term is None]
    return frozenset(
        column.key for column in nominal if abs(fit.point.value(column)) > FINDING_SIGMAS * tolerance[column.key]
    )


def strained(fit: Fit, without: Fit, tolerance: Mapping[str, float], *, on_ground: bool = False) -> frozenset[str]:
    """Values known to a tolerance that a fit moves beyond FINDING_SIGMAS of it, and the fit without effects does not.

    The start of motion does not count, because cameras are started by hand. On open ground, values at their bounds
    count even if the fit without effects moves them too, because that fit explains nothing there.
    """
    ended: frozenset[str] = frozenset()
    if on_ground:
        low, high = bounds(fit.columns, tolerance)
        values = np.array([fit.point.value(column) for column in fit.columns])
        at_end = np.minimum(values - low, high - values) <= AT_END * (high - low)
        ended = frozenset(column.key for column, end in zip(fit.columns, at_end, strict=True) if end)
    return far(fit, tolerance) - (far(without, tolerance) - ended) - {START}
