"""Free-form terms that are equivalent to a user-defined effect and need not be tested beside it.

A user who turns a free-form finding into an effect has an effect with the terms of that family. No data distinguish the
two, so that their sizes would be undetermined.
"""

from __future__ import annotations

import numpy as np

from evaluator.diagnosis.candidates.free_form import FreeTerm, own_commands
from simulator.dynamics.terms import Term
from simulator.effects.definition import Effect

SPANNED = 1e-9  # residual, relative to the terms of a coefficient, that counts as rounding


def included_named_effects(effect: Effect) -> frozenset[str]:
    """Ids of the effects of the catalogue that an effect of the user includes, for some values of its parameters.

    Only effects of the drive speeds are compared: a factor on both commands, and factors on each side's command.
    """
    same = {"drive-speed-scale": own_commands(alike=True), "drive-speed-mismatch": own_commands(alike=False)}
    return frozenset(name for name, family in same.items() if is_included_in(family, effect))


def is_included_in(family: FreeTerm, effect: Effect) -> bool:
    """Whether an effect includes the family: for any coefficients there are equivalent values of its parameters."""
    if not effect.sum_of:
        return False
    own = [[term for name, term in effect.sum_of if name == item.name] for item in effect.parameters]
    units = np.eye(len(family.items))
    wanted = [family.kernel_terms(tuple(row)) for row in units.tolist()]
    keys = dict.fromkeys(_key(term) for part in (*own, *wanted) for term in part)
    rows = {key: row for row, key in enumerate(keys)}
    basis, asked = (np.zeros((len(rows), len(parts))) for parts in (own, wanted))
    for table, parts in ((basis, own), (asked, wanted)):
        for column, part in enumerate(parts):
            for term in part:
                table[rows[_key(term)], column] += term.coefficient
    left = asked - basis @ np.linalg.lstsq(basis, asked, rcond=None)[0]
    return bool((np.linalg.norm(left, axis=0) <= SPANNED * np.linalg.norm(asked, axis=0)).all())


def _key(term: Term) -> tuple[int, int, str | tuple[float, ...]]:
    return term.channel, term.basis, term.pattern
