"""A row of the table published | ours: a number with its difference, or a statement that holds or not."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

AGREES, CLOSE, DIFFERS, HOLDS, FAILS = "agrees", "close", "differs", "holds", "fails"
NOT_COMPUTED = "not computed"
# Status of a row: computed from the paper's equations and numbers alone; computed with a law fitted to this figure; a
# conjecture made after the number was known; a number or claim that the model does not reproduce; not computed.
COMPUTED, FITTED, CONJECTURE = "computed", "fitted to this figure", "conjecture"
NOT_REPRODUCED, OUT_OF_SCOPE = "not reproduced", "out of scope"
AGREEMENT = 1e-3  # the project's aim: a published number met to 0.1 %
CLOSENESS = 0.03  # a number read off a figure or stated as "approximately"


@dataclass(frozen=True)
class Check:
    """A published number or statement, and the result of the model.

    source: equation, figure or section; difference: in % of the published value, or empty for a statement; standing:
    status of the row, COMPUTED and so on.
    """

    source: str
    quantity: str
    published: str
    ours: str
    difference: str
    verdict: str
    standing: str = COMPUTED

    def __post_init__(self) -> None:
        """Set the status of a row that differs from the publication to not reproduced."""
        if self.verdict in (DIFFERS, FAILS):
            object.__setattr__(self, "standing", NOT_REPRODUCED)


def standing(checks: Iterable[Check], worth: str) -> list[Check]:
    """Checks with status `worth` instead of computed; rows that are not reproduced keep that status."""
    return [replace(check, standing=worth) for check in checks]


def out_of_scope(source: str, quantity: str, published: str, reason: str) -> Check:
    """A published result that is not computed, with the reason."""
    return Check(source, quantity, published, reason, "", NOT_COMPUTED, OUT_OF_SCOPE)


def number(
    source: str, quantity: str, published: float, ours: float, unit: str = "", last_digit: float = 0.0, digits: int = 5
) -> Check:
    """Compare numbers: agrees within 0.1 % or half the last published digit, close within 3 %, else differs."""
    off = ours - published
    relative = abs(off) / abs(published)
    verdict = DIFFERS
    if relative <= AGREEMENT or abs(off) <= last_digit / 2 * (1 + 1e-9):
        verdict = AGREES
    elif relative <= CLOSENESS:
        verdict = CLOSE
    text = f"{off / abs(published):+.2%}".replace("%", " %")
    return Check(source, quantity, f"{published:g} {unit}".strip(), f"{ours:.{digits}g} {unit}".strip(), text, verdict)


def statement(source: str, quantity: str, published: str, ours: str, holds: bool | np.bool_) -> Check:
    """Compare a statement of the paper with the behaviour of the model."""
    return Check(source, quantity, published, ours.replace("%", " %"), "", HOLDS if holds else FAILS)
