"""A family without a name is not tried beside an effect of the user's own that says all it says."""

from __future__ import annotations

from typing import Any

from evaluator.diagnosis.candidates.equivalent_terms import included_named_effects, is_included_in
from evaluator.diagnosis.candidates.free_form import free_terms
from simulator.effects.catalogue import EFFECTS
from simulator.own_effects.files import effect_of

DRIVES = ("left", "right")
FOUR = "free:" + "+".join(f"{a}_drive.{b}_command" for a in DRIVES for b in DRIVES)
CROSSED = "free:left_drive.right_command+right_drive.left_command"
TWINS = "free:left_drive.left_command=right_drive.right_command+left_drive.right_command=right_drive.left_command"
LOAD = "free:load.abs_u.driving"


def mixing(coefficient: dict[tuple[str, str], str]) -> Any:
    """An own effect that mixes the sides, with the names of the coefficients, and a force beside."""
    rows = [
        {"channel": f"{a}_drive", "depends_on": f"{b}_command", "coefficient": name, "step": 0.01}
        for (a, b), name in coefficient.items()
    ]
    force = {"channel": "force_forward", "depends_on": "sign_u", "coefficient": "force", "step": 1.0, "times": 3.0}
    return effect_of({"format": 1, "id": "mixed", "name": "mixed", "term": [*rows, force]})


def test_families_that_an_own_effect_spans_are_said_by_it() -> None:
    four = mixing({(a, b): f"{a}_{b}" for a in DRIVES for b in DRIVES})
    alike = mixing({(a, b): "own" if a == b else "other" for a in DRIVES for b in DRIVES})
    families = free_terms()
    said = {form for form, term in families.items() if is_included_in(term, four)}
    assert said >= {FOUR, CROSSED, TWINS, "free:force_forward.sign_u"}
    assert LOAD not in said
    assert not is_included_in(families[FOUR], alike)  # four numbers, of which the effect has two
    assert not is_included_in(families[CROSSED], alike)
    assert is_included_in(families[TWINS], alike)


def test_an_effect_of_one_number_spans_its_own_terms_alone() -> None:
    row = {"channel": "load", "depends_on": "abs_u", "pattern": "driving", "coefficient": "size", "step": 0.01}
    one = effect_of({"format": 1, "id": "one", "name": "one", "term": [row]})
    assert {form for form, term in free_terms().items() if is_included_in(term, one)} == {LOAD}


def test_the_speed_of_both_sides_is_said_by_an_effect_of_the_own_command() -> None:
    four = mixing({(a, b): f"{a}_{b}" for a in DRIVES for b in DRIVES})
    alike = mixing({(a, b): "own" if a == b else "other" for a in DRIVES for b in DRIVES})
    crossed = mixing({("left", "right"): "other", ("right", "left"): "other"})
    assert included_named_effects(four) == {"drive-speed-scale", "drive-speed-mismatch"}
    assert included_named_effects(alike) == {"drive-speed-scale"}
    assert included_named_effects(crossed) == frozenset()


def test_no_family_says_what_an_effect_of_the_catalogue_says() -> None:
    sums = [effect for effect in EFFECTS.values() if effect.sum_of]
    assert not [
        (effect.id, form) for effect in sums for form, term in free_terms().items() if is_included_in(term, effect)
    ]
