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
    left_out_sentence,
    next_runs_sentence,
    not_tried_sentence,
    rivals_sentence,
    separations_sentence,
    unlike_sentences,
    verdict_sentence,
    where_sentences,
)
from evaluator.report.numbers import true_minus

SENTENCES = 4  # about where the disagreement is; all are in diagnosis.json


def verdict_lines(content: dict[str, Any]) -> list[str]:
    """The content of diagnosis.json in a few lines."""
    lines = [*mistake_sentences(content), verdict_sentence(content), as_sentence(in_words(content["reason"]))]
    said = content["verdict"] == "none"  # in the sentence of the verdict
    lines += [*([] if said else finding_sentences(content)), negligible_sentence(content)]
    for effect in content["effects"]:
        # what would explain the unknown best is no more probable than that
        share = f", probability {_probability(effect['probability'])}" if content["verdict"] == "effect" else ""
        lines.append(f"{effect['id']}{share}:")
        for name, value in effect["parameters"].items():
            text = f"  {name} = {value['value']:.4g}  [95 %: {value['low']:.4g} to {value['high']:.4g}]"
            lines.append(true_minus(text))
        lines.append(equivalents_sentence(effect))
    lines += [gap_sentence(content), predicted_sentence(content), preferred_sentence(content)]
    if content.get("runs_not_followed") and closes(content):
        lines.append(f"Not followed, look at these recordings first: {', '.join(content['runs_not_followed'])}.")
    if content.get("left_out_runs"):
        lines.append(left_out_sentence({"left_out_runs": content["left_out_runs"]}))  # of others the command says it
    lines += unlike_sentences(content)
    lines += where_sentences(content, SENTENCES)
    lines += [
        rivals_sentence(content),
        not_tried_sentence(content),
        next_runs_sentence(content),
        separations_sentence(content),
    ]
    return [line for line in lines if line]


def _probability(value: float) -> str:
    """A probability, never as certainty: it holds among the sets of effects that were compared."""
    return "above 0.999" if value > 0.999 else "below 0.001" if value < 0.001 else f"{value:.3f}"
