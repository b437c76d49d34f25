"""A diagnosis in a few lines, for a terminal or a notebook."""

from __future__ import annotations

from typing import Any

from evaluator.report.diagnosis.knowledge import (
    finding_sentences,
    mistake_sentences,
    negligible_sentence,
    predicted_sentence,
    preferred_sentence,
)
from evaluator.report.diagnosis.words import (
    as_sentence,
    closes,
    equivalents_sentence,
    gap_sentence,
    in_words,
    next_runs_sentence,
    separations_sentence,
    verdict_sentence,
)
from evaluator.report.numbers import true_minus

SENTENCES = 4  # about where the disagreement is; all are in diagnosis.json


def verdict_lines(content: dict[str, Any]) -> list[str]:
    """The content of diagnosis.json in a few lines."""
    lines = [*mistake_sentences(content), verdict_sentence(content), as_sentence(in_words(content["reason"]))]
    lines += [*finding_sentences(content), negligible_sentence(content)]
    for effect in content["effects"]:
        lines.append(f"{effect['id']}, probability {effect['probability']:.3f}:")
        for name, value in effect["parameters"].items():
            text = f"  {name} = {value['value']:.4g}  [95 %: {value['low']:.4g} to {value['high']:.4g}]"
            lines.append(true_minus(text))
        lines.append(equivalents_sentence(effect))
    lines += [gap_sentence(content), predicted_sentence(content), preferred_sentence(content)]
    if content.get("runs_not_followed") and closes(content):
        lines.append(f"Not followed, look at these recordings first: {', '.join(content['runs_not_followed'])}.")
    lines += [as_sentence(item["sentence"]) for item in content["where"][:SENTENCES]]
    lines += [next_runs_sentence(content), separations_sentence(content)]
    return [line for line in lines if line]
