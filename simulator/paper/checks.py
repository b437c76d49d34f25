"""One line of the published-against-ours table: a number with its difference, or a statement that holds or not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

AGREES, CLOSE, DIFFERS, HOLDS, FAILS = "agrees", "close", "differs", "holds", "fails"
AGREEMENT = 1e-3  # the project's aim: a published number met to 0.1 %
CLOSENESS = 0.03  # a number read off a figure or stated as "approximately"


@dataclass(frozen=True)
class Check:
    """A published number or statement beside what the model gives.

    source: equation, figure or section; difference: in % of the published value, or empty for a statement.
    """

    source: str
    quantity: str
    published: str
    ours: str
    difference: str
    verdict: str


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
    """Compare words: what the paper says, what the model does."""
    return Check(source, quantity, published, ours, "", HOLDS if holds else FAILS)
