"""The free-form terms that explain the runs, each as a file of a user-defined effect."""

from __future__ import annotations

from evaluator.diagnosis.candidates.free_form import FreeTerm
from evaluator.diagnosis.candidates.free_form_words import unit_of_coefficient
from evaluator.diagnosis.result import Diagnosis
from simulator.own_effects.template import TermRow, template

ID = "found-by-diagnosis"


def own_effects(found: Diagnosis, effect_id: str = ID) -> list[str]:
    """Texts of effects/ID.toml, effects/ID-2.toml, … with the free-form terms of an unknown verdict.

    One effect for each term, so that each is tested by itself; first the one without which the runs are least probable.
    """
    search, chosen = found.search, found.chosen
    terms = [term for effect in sorted(chosen) if isinstance(term := (found.terms or {})[effect], FreeTerm)]
    if search is None or not terms or not found.follows:
        return []
    terms.sort(key=lambda term: search.evidence(chosen - {term.id}))
    names = [effect_id, *(f"{effect_id}-{number}" for number in range(2, len(terms) + 1))]
    return [_own_effect(found, term, name) for term, name in zip(terms, names, strict=True)]


def _own_effect(found: Diagnosis, term: FreeTerm, effect_id: str) -> str:
    rows = []
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
    words = term.describe()
    return template(effect_id, rows, words, f"{words[:1].upper()}{words[1:]}.")
