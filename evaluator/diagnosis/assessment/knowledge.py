"""Where the data want what a laboratory knows only to within a tolerance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from evaluator.diagnosis.inference.fit import Fit
from evaluator.diagnosis.likelihood.known_to import Quantity

TWO_SIDED_95 = 1.96
FINDING_SIGMAS = 3.0  # a preference beyond so many stated tolerances is told: once in 370 by chance


@dataclass(frozen=True)
class Knowledge:
    """One quantity: as it is taken to be known (1 sigma), and the value that the data prefer with its 95 % interval."""

    quantity: Quantity
    found: float
    low: float
    high: float

    @property
    def is_finding(self) -> bool:
        """Whether the data want it farther away than anyone who knows it so well would be."""
        return abs(self.found) > FINDING_SIGMAS * self.quantity.sigma

    @property
    def sentence(self) -> str:
        """What the data want, in plain words."""
        item = self.quantity
        if item.key == "start_common_s":
            way = "later" if self.found > 0 else "earlier"
            return f"motion starts {1e3 * abs(self.found):.0f} ms {way} than start_s in all runs"
        unit = "" if item.unit == "1" else f" {item.unit}"
        return f"{item.name}: off by {self.found:+.2g}{unit}, taken as known to {item.sigma:.2g}{unit}"


def knowledge(quantities: Sequence[Quantity], fit: Fit) -> tuple[Knowledge, ...]:
    """All quantities with the values that a fit prefers; those it does not hold stay as they are known."""
    sigma = np.sqrt(np.diag(fit.posterior.covariance))
    at = {column.key: i for i, column in enumerate(fit.columns) if column.term is None}
    result = []
    for item in quantities:
        if item.key in at:
            found = fit.point.value(fit.columns[at[item.key]]) * item.per_unit
            half = TWO_SIDED_95 * float(sigma[at[item.key]]) * item.per_unit
        else:
            found, half = 0.0, TWO_SIDED_95 * item.sigma
        result.append(Knowledge(item, float(found), float(found - half), float(found + half)))
    return tuple(result)
