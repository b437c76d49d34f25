"""User-defined effects, effects/ID.toml beside an experiment: list, write, remove, and proposals of a diagnosis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from evaluator.diagnosis.candidates.free_form import Item, coefficient
from evaluator.diagnosis.candidates.free_form_words import BASIS_WORDS, CHANNEL_WORDS, unit_of_coefficient
from evaluator.errors import InputError
from evaluator.workflow.editing.documents import change_document, read_document, replace_text, version_of
from simulator.dynamics.terms import CAMERA_X, CHANNELS, PATTERNS, SPEED
from simulator.effects.free_form import faults
from simulator.own_effects.files import FOLDER, faults_of_content, is_built_in
from simulator.own_effects.template import TermRow, template

KEYS = tuple(field.name for field in fields(TermRow) if field.name != "value")  # of a term that a form sets
OF_COEFFICIENT = ("unit", "low", "high", "step")  # stated once, with the first term of the coefficient


@dataclass(frozen=True)
class OwnEffect:
    """The file of an effect: version ("" if it is not written yet), id, name, sentence, terms, and its fault."""

    version: str
    id: str
    name: str
    sentence: str
    terms: tuple[dict[str, Any], ...]
    fault: str = ""


def own_effects_folder(experiment: Path) -> Path:
    """Folder of user-defined effects beside an experiment, which need not exist."""
    return experiment.resolve().parent / FOLDER


def own_effects(experiment: Path) -> list[OwnEffect]:
    """The effects beside an experiment, by id."""
    found = []
    for path in sorted(own_effects_folder(experiment).glob("*.toml")):
        try:
            found.append(_read(path))
        except InputError as error:
            found.append(OwnEffect(version_of(path), path.stem, path.stem, "", (), str(error)))
    return found


def offered_effect(file: Path) -> OwnEffect | None:
    """The free-form term of a diagnosis as an effect that is not written yet; None without one."""
    if not file.is_file():
        return None
    found = _read(file)
    return OwnEffect("", found.id, found.name, found.sentence, found.terms)


def write_own_effect(experiment: Path, effect: OwnEffect) -> Path:
    """Write effects/ID.toml beside an experiment; keys of an existing file that a form does not show are kept.

    Raises ChangedMeanwhileError if the file has another version, InputError for an invalid effect.
    """
    terms = [{key: term[key] for key in KEYS if term.get(key) is not None} for term in effect.terms]
    sentence = effect.sentence or effect.name
    content = {"format": 1, "id": effect.id, "name": effect.name, "sentence": sentence, "term": terms}
    if wrong := faults_of_content(content):
        raise InputError("; ".join(wrong))
    if is_built_in(effect.id):
        raise InputError(f"{effect.id} is an effect of the catalogue; choose another id")
    path = own_effects_folder(experiment) / f"{effect.id}.toml"
    if effect.version:
        change_document(path, effect.version, lambda document: _change(document, content))
        return path
    if path.exists():
        raise InputError(f"there is an effect {effect.id} already; choose another id")
    if any("low" not in term or "high" not in term for term in terms):
        raise InputError("give the bounds of each coefficient")
    replace_text(path, "", template(effect.id, [TermRow(**term) for term in terms], effect.name, sentence))
    return path


def _change(document: Any, content: Mapping[str, Any]) -> None:
    """Change a file to the values of a form; comments and keys that the form does not show are kept."""
    import tomlkit

    document["name"], document["sentence"] = content["name"], content["sentence"]
    tables, terms = document["term"], content["term"]
    while len(tables) > len(terms):
        del tables[-1]
    for number, term in enumerate(terms):
        if number == len(tables):
            tables.append(tomlkit.table())
        for key, value in term.items():
            if tables[number].get(key) != value:
                tables[number][key] = value


def remove_own_effect(experiment: Path, effect_id: str, version: str) -> None:
    """Remove effects/ID.toml of a known version. Raises ChangedMeanwhileError, InputError if it does not exist."""
    path = next((one for one in own_effects_folder(experiment).glob("*.toml") if one.stem == effect_id), None)
    if path is None:
        raise InputError(f"there is no effect {effect_id} beside the experiment")
    replace_text(path, version, "")
    path.unlink()


def term_grammar() -> dict[str, Any]:
    """Components of terms: channels, with their bases, units, bounds and steps; patterns over the wheels.

    Bounds and steps are those of free-form terms for a robot of the paper's size.
    """
    channels = [
        {
            "id": channel,
            "words": words,
            "of_wheels": SPEED <= CHANNELS[channel] < CAMERA_X,
            "bases": [_basis(channel, basis) for basis in BASIS_WORDS if _fits(channel, basis)],
        }
        for channel, (words, _) in CHANNEL_WORDS.items()
    ]
    return {"channels": channels, "patterns": list(PATTERNS)}


def _fits(channel: str, basis: str) -> bool:
    return not any(faults({"channel": channel, "basis": basis, "coefficient": 1.0}))


def _basis(channel: str, basis: str) -> dict[str, Any]:
    usual = coefficient("", Item(channel, basis))
    numbers = {key: float(f"{getattr(usual, key):.3g}") for key in ("low", "high", "step")}
    return {"id": basis, "words": BASIS_WORDS[basis][0], "unit": unit_of_coefficient(channel, basis), **numbers}


def _read(path: Path) -> OwnEffect:
    """Read an effect's file. Raises InputError."""
    document, version = read_document(path)
    content: Mapping[str, Any] = document.unwrap()
    if wrong := faults_of_content(content):
        raise InputError(f"{path.name}: {'; '.join(wrong)}")
    first: dict[str, Mapping[str, Any]] = {}
    terms = [_filled(row, first.setdefault(row["coefficient"], row)) for row in content["term"]]
    return OwnEffect(version, content["id"], content["name"], content.get("sentence", ""), tuple(terms))


def _filled(row: Mapping[str, Any], first: Mapping[str, Any]) -> dict[str, Any]:
    """A term with all fields of a form; fields of a shared coefficient are those of its first term."""
    usual = {"pattern": "common", "unit": ""}
    return {key: (first if key in OF_COEFFICIENT else row).get(key, usual.get(key)) for key in KEYS}
