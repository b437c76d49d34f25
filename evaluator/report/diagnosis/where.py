"""Sentences on what the disagreement of robot file and runs depends on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from evaluator.diagnosis.assessment.residuals.disagreement import SHOWN_SIGMAS
from evaluator.report.diagnosis.words import as_sentence, closes

Json = dict[str, Any]

TELLING_SIGMAS = 2.0  # significance below which a disagreement, the largest of few runs, is not worth a sentence
WITHOUT_EFFECTS = "Without these effects, the robot file and the runs disagree as follows:"
NONE_SIGNIFICANT = (
    f"no single dependence of the disagreement reaches {SHOWN_SIGMAS:g} sigmas, from which it is significant; "
    "the largest:"
)
PATTERN_ONLY = (  # the likelihood compares whole paths, a dependence only means of pieces of them
    "The effects found show in the paths of all runs together; without them, "
    f"{NONE_SIGNIFICANT.replace('; the largest', ' by itself; the largest')}"
)


def where_sentences(content: Json, most: int) -> list[str]:
    """At most `most` disagreements of robot file and runs, after what they mean beside the verdict."""
    items = [item for item in content.get("where") or [] if isinstance(item, dict) and item.get("sentence")]
    items = [item for item in items if _reaches(item, TELLING_SIGMAS)]
    sentences = [as_sentence(str(item["sentence"])) for item in items[:most]]
    return [part for part in (_opening(content, items), *sentences) if part]


def _opening(content: Json, items: Sequence[Json]) -> str:
    """What the disagreements mean: that something explains them, or that none of them is significant."""
    if not items:
        return ""
    if content.get("verdict") == "none":
        left = "relevant" if content.get("negligible") else "significant"
        tail = f"with values adjusted within their tolerances, no {left} disagreement remains."
        return f"With the nominal values of the robot file, the runs disagree as follows; {tail}"
    explained = bool(content.get("effects")) and closes(content)
    if not any(_reaches(item, SHOWN_SIGMAS) for item in items):
        return PATTERN_ONLY if explained else NONE_SIGNIFICANT.capitalize()
    return WITHOUT_EFFECTS if explained else ""


def _reaches(item: Json, sigmas: float) -> bool:
    """Whether a disagreement is at least so significant, or its significance is not known."""
    return item.get("sigmas") is None or bool(item["sigmas"] >= sigmas)
