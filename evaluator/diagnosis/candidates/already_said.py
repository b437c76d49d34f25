"""Free-form terms that are equivalent to a user-defined effect and need not be tested beside it.

Who takes up a form that a diagnosis found has an effect of the same terms. Nothing would distinguish the family from
it, and each would have any share of what both do.
"""

from __future__ import annotations

import numpy as np

from evaluator.diagnosis.candidates.free_form import FreeTerm, own_commands
from simulator.dynamics.terms import Term
from simulator.effects.definition import Effect

SPANNED = 1e-9  # of the size of a coefficient's terms, what may be left of them: rounding


def named_that_say_no_more(effect: Effect) -> frozenset[str]:
    """Ids of the effects of the catalogue that some values of an own effect's parameters do.

    Of one speed for both sides a rotation by the own command alike on both says as much, of two speeds one for each.
    """
    same = {"drive-speed-scale": own_commands(alike=True), "drive-speed-mismatch": own_commands(alike=False)}
    return frozenset(name for name, family in same.items() if is_said_by(family, effect))


def is_said_by(family: FreeTerm, effect: Effect) -> bool:
    """Whether some values of an effect's parameters do what the family does, whatever its coefficients."""
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
