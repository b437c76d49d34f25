"""Short text of a diagnosis, for a terminal or a notebook."""

from __future__ import annotations

from typing import Any

from evaluator.report.diagnosis.gap import gap_sentence, not_followed_sentence, predicted_sentence, scatter_sentence
from evaluator.report.diagnosis.knowledge import (
    changed_sentence,
    finding_sentences,
    mistake_sentences,
    negligible_sentence,
    preferred_sentence,
)
from evaluator.report.diagnosis.next_runs import next_runs_sentence, separations_sentence
from evaluator.report.diagnosis.values import sizes
from evaluator.report.diagnosis.where import where_sentences
from evaluator.report.diagnosis.words import (
    determined_sentence,
    equivalents_sentence,
    exact_frictions_sentence,
    left_out_sentence,
    moved_marks_sentence,
    not_tried_sentence,
    reason_sentence,
    rivals_sentence,
    smoothed_sentence,
    together_sentence,
    unlike_sentences,
    verdict_sentence,
)

SENTENCES = 4  # on disagreements; all are in diagnosis.json


def verdict_lines(content: dict[str, Any]) -> list[str]:
    """The content of diagnosis.json in a few lines."""
    verdict = verdict_sentence(content)
    lines = [*mistake_sentences(content), verdict, reason_sentence(content)]
    findings = [sentence for sentence in finding_sentences(content) if sentence[1:-1] not in verdict]  # once is enough
    lines += [changed_sentence(content), *findings, negligible_sentence(content)]
    for effect in content["effects"]:
        # a free-form term of an unknown verdict has no probability as an effect
        share = f", probability {_probability(effect['probability'])}" if content["verdict"] == "effect" else ""
        lines.append(f"{effect['id']}{share}:")
        for name, value in effect["parameters"].items():
            best, low, high = sizes(name, value, effect["id"])
            lines.append(f"  {name} = {best}  [95 %: {low} to {high}]")
        lines += [together_sentence(effect), determined_sentence(effect), equivalents_sentence(effect)]
    lines += [
        moved_marks_sentence(content),
        gap_sentence(content),
        predicted_sentence(content),
        scatter_sentence(content),
        smoothed_sentence(content),
        preferred_sentence(content),
        not_followed_sentence(content),
    ]
    if content.get("left_out_runs"):
        lines.append(left_out_sentence({"left_out_runs": content["left_out_runs"]}))  # the command prints skipped runs
    lines += unlike_sentences(content)
    lines += where_sentences(content, SENTENCES)
    lines += [
        rivals_sentence(content),
        not_tried_sentence(content),
        exact_frictions_sentence(content),
        next_runs_sentence(content),
        separations_sentence(content),
    ]
    return [line for line in lines if line]


def _probability(value: float) -> str:
    """A probability, never as certainty, because it is relative to the compared sets of effects."""
    return "above 0.999" if value > 0.999 else "below 0.001" if value < 0.001 else f"{value:.3f}"
