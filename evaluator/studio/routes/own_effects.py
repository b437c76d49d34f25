"""Routes of user-defined effects on the screen Diagnosis."""

from __future__ import annotations

from typing import Any

from starlette.routing import Route

from evaluator.errors import InputError
from evaluator.studio.answers import Asked, Json, Studio, endpoint, number
from evaluator.workflow import (
    Outputs,
    OwnEffect,
    diagnosis_view,
    offered_effect,
    out_folder,
    own_effects,
    own_effects_folder,
    remove_own_effect,
    term_grammar,
    write_own_effect,
)

MOST_TERMS = 40  # as many as a robot can have (simulator.dynamics.record)
NUMBERS = ("low", "high", "step")
TEXTS = ("channel", "depends_on", "pattern", "coefficient", "unit")


def routes(studio: Studio) -> list[Route]:
    """Routes of these effects."""
    own = "/api/experiments/{id}/own-effects"
    return [
        Route(own, endpoint(studio, there)),
        Route(own, endpoint(studio, write), methods=["POST"]),
        Route(own + "/remove", endpoint(studio, remove), methods=["POST"]),
    ]


def there(studio: Studio, asked: Asked) -> Json:
    """The effects beside an experiment, the proposal of an unknown verdict, and the components of terms."""
    path = studio.folder.path(asked.path["id"])
    content = diagnosis_view(path).content or {}
    offered = offered_effect(Outputs(out_folder(path)).own_effect) if content.get("verdict") == "unknown" else None
    return {
        "effects": [vars(one) for one in own_effects(path)],
        "offered": None if offered is None else vars(offered),
        "grammar": term_grammar(),
    }


def write(studio: Studio, asked: Asked) -> Json:
    """Write an effect."""
    path = studio.folder.path(asked.path["id"])
    terms = asked.body.get("terms")
    if not isinstance(terms, list) or len(terms) > MOST_TERMS:
        raise InputError(f"terms: at most {MOST_TERMS}")
    version, effect_id, name, sentence = (asked.text(key).strip() for key in ("version", "id", "name", "sentence"))
    effect = OwnEffect(version, effect_id, name, sentence, tuple(map(_term, terms)))
    target = studio.folder.inside(own_effects_folder(path) / f"{effect.id}.toml")
    studio.history.record([target], f"the effect {effect.id}", lambda: write_own_effect(path, effect))
    return {**there(studio, asked), "path": studio.folder.relative(target)}


def remove(studio: Studio, asked: Asked) -> Json:
    """Remove an effect; this can be undone."""
    path, effect = studio.folder.path(asked.path["id"]), asked.text("id")
    target, version = studio.folder.inside(own_effects_folder(path) / f"{effect}.toml"), asked.text("version")
    studio.history.record([target], f"{effect} taken away", lambda: remove_own_effect(path, effect, version))
    return there(studio, asked)


def _term(row: Any) -> Json:
    """One term of a request; numbers that are not given are omitted."""
    if not isinstance(row, dict) or not all(isinstance(row.get(key), str) for key in TEXTS):
        raise InputError("a term needs a channel, what it depends on, a pattern, a coefficient and a unit")
    numbers = {key: number(row[key], key) for key in NUMBERS if row.get(key) not in (None, "")}
    return {**{key: row[key].strip() for key in TEXTS}, **numbers}
