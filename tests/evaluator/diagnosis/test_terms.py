"""Coordinates of the candidates and the parameters that are told: each way of writing an effect says the same."""

from __future__ import annotations

import pytest

from evaluator.diagnosis.candidates.coordinates import named_terms
from simulator.effects.catalogue import EFFECTS

TERMS = named_terms(30.0, (10.0, 30.0))


@pytest.mark.parametrize("effect", sorted(EFFECTS))
def test_every_effect_has_a_term_with_its_parameters(effect: str) -> None:
    told = TERMS[effect].physical(TERMS[effect].absent)
    assert sorted(told) == sorted(EFFECTS[effect].absent())


@pytest.mark.parametrize("effect", [effect for effect in sorted(EFFECTS) if "factor" in EFFECTS[effect].absent()])
def test_factors_are_one_where_nothing_is_changed(effect: str) -> None:
    assert TERMS[effect].physical(TERMS[effect].absent) == EFFECTS[effect].absent()


def test_magnets_of_known_balance_and_unknown_level_have_a_long_interval_upward() -> None:
    strength = TERMS["magnet-strength"]
    near, far = (strength.physical((weakness, 4.25)) for weakness in (5.0, 1.5))
    assert near == pytest.approx({"driving_factor": 0.2, "driven_factor": 0.85})
    assert far["driven_factor"] / far["driving_factor"] == pytest.approx(4.25)
    assert strength.physical(TERMS["magnet-strength"].absent) == {"driving_factor": 1.0, "driven_factor": 1.0}
