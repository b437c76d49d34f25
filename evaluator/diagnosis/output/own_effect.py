"""The free-form term that explains the runs, as a file of a user-defined effect."""

from __future__ import annotations

from evaluator.diagnosis.candidates.free_form import FreeTerm
from evaluator.diagnosis.candidates.free_form_words import unit_of_coefficient
from evaluator.diagnosis.result import Diagnosis
from simulator.own_effects.template import TermRow, template

ID = "found-by-diagnosis"


def own_effect(found: Diagnosis, effect_id: str = ID) -> str | None:
    """Text of effects/ID.toml with the free-form terms of an unknown verdict; None if there are none."""
    terms = [term for effect in sorted(found.chosen) if isinstance(term := (found.terms or {})[effect], FreeTerm)]
    if not terms or not found.follows:
        return None
    rows = []
    for term in terms:
        for item, coordinate, value in zip(term.items, term.coordinates, found.fit.point.terms[term.id], strict=True):
            wheels = "" if item.pattern == "common" else f"_{item.pattern}"
            name = f"{item.channel}_by_{item.basis}{wheels}".replace("-", "_")
            if item.twin:
                name = "by_own_command" if item.channel[0] == item.basis[0] else "by_other_command"
            bounds = float(coordinate.low), float(coordinate.high), float(coordinate.step)
            rows += [
                TermRow(
                    part.channel,
                    part.basis,
                    name,
                    part.pattern,
                    unit_of_coefficient(part.channel, part.basis),
                    *bounds,
                    float(value),
                )
                for part in (item, item.twin)
                if part is not None
            ]
    words = " and ".join(term.describe() for term in terms)
    return template(effect_id, rows, words, f"{words[:1].upper()}{words[1:]}.")
