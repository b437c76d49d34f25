"""The sections on a diagnosis: verdict, disagreements, gap, alternatives, tolerances and noise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from evaluator.report.diagnosis.gap import (
    after_words,
    gap_sentence,
    held_out_words,
    not_followed_sentence,
    predicted_sentence,
    scatter_sentence,
)
from evaluator.report.diagnosis.knowledge import knowledge_section, mistakes_section
from evaluator.report.diagnosis.limits import limits_section
from evaluator.report.diagnosis.next_runs import RUN_KEYS, next_runs, separations_sentence
from evaluator.report.diagnosis.values import (
    length,
    parameters,
    percent_text,
    scatter_text,
    signed_percent,
    sizes,
    value_text,
)
from evaluator.report.diagnosis.view import OUTDATED, DiagnosisView
from evaluator.report.diagnosis.where import where_sentences
from evaluator.report.diagnosis.words import (
    as_sentence,
    determined_sentence,
    effect_words,
    equivalents_sentence,
    exact_frictions_sentence,
    in_words,
    left_out_sentence,
    not_tried_sentence,
    reason_sentence,
    rivals_sentence,
    smoothed_sentence,
    together_sentence,
    unlike_sentences,
    verdict_sentence,
)
from evaluator.report.figures.disagreement import disagreement_map, disagreement_panels
from evaluator.report.figures.gap import gap_before_after
from evaluator.report.numbers import UNKNOWN, number
from evaluator.report.pages.html import Section, Table
from evaluator.wording import name_of_value

Json = dict[str, Any]

SENTENCES = 8  # on disagreements; the map has all
CHANCE = 1e-3  # probability below which a difference between halves is significant


def diagnosis_sections(view: DiagnosisView | None) -> tuple[Section, ...]:
    """Sections of a diagnosis, most important first; none without a diagnosis."""
    if view is None:
        return ()
    content = view.content
    there = (
        *(mistakes_section(content), _verdict(view), _where(view), _gap(content), _rivals(content)),
        *(limits_section(content), knowledge_section(content), _small_print(content)),
    )
    return tuple(section for section in there if section is not None)


def _verdict(view: DiagnosisView) -> Section:
    content = view.content
    text = [verdict_sentence(content), reason_sentence(content)]
    if view.outdated:
        text.insert(0, as_sentence(OUTDATED))
    for effect in content.get("effects") or []:
        text += [together_sentence(effect), determined_sentence(effect), equivalents_sentence(effect)]
    text += [rivals_sentence(content), separations_sentence(content)]
    rows = [
        (effect["name"], *words, best, f"{low} to {high}")
        for effect in content.get("effects") or []
        for name, words in parameters(effect).items()
        for best, low, high in [sizes(name, effect["parameters"][name], effect["id"])]
    ]
    head = ("effect", "parameter", "unit", "value", "95 %")
    table = Table("Effects found, with 95 % intervals.", head, tuple(rows), words=True)
    tables = (table,) if rows else ()
    return Section("diagnosis", "What the model lacks", _full(text), (), (*tables, *_next_runs(content)))


def _next_runs(content: Json) -> tuple[Table, ...]:
    head = ("left, rpm", "right, rpm", "drive, s", "start x, mm", "start y, mm", "heading, °", "times")
    rows = tuple(tuple(value_text(run[key]) for key in RUN_KEYS) for run in next_runs(content))
    caption = "Most informative further runs; start positions are those of the robot's centre."
    return (Table(caption, head, rows),) if rows else ()


def _where(view: DiagnosisView) -> Section | None:
    items = [item for item in view.content.get("where") or [] if isinstance(item, dict) and item.get("sentence")]
    text = where_sentences(view.content, SENTENCES)
    text += [as_sentence(item) for item in view.content.get("where") or [] if isinstance(item, str)]
    if len(items) > SENTENCES:
        text.append(f"{len(items) - SENTENCES} more in diagnosis.json.")
    pieces = view.pieces
    if pieces is None or pieces.empty:
        return Section("diagnosis-where", WHERE, tuple(text)) if text else None
    if not text:
        text = ["The residuals do not depend significantly on any quantity that was examined."]
    after = after_words(view.content)
    figures = (disagreement_map(pieces, after=bool(after)), disagreement_panels(pieces, after=after))
    return Section("diagnosis-where", WHERE, tuple(text), tuple(figure for figure in figures if figure is not None))


WHERE = "Where model and robot disagree"


def _gap(content: Json) -> Section | None:
    gap = content.get("gap") or {}
    if not gap.get("before"):
        return None
    lost = content.get("runs_not_followed") or []
    held = gap.get("held_out_runs") or []
    text = [gap_sentence(content), predicted_sentence(content), scatter_sentence(content)]
    if held:
        gain = gap.get("held_out_gain_sigmas")
        tail = f", which the effect predicts better by {gain:.0f} sigmas" if gain else ""
        text.append(f"Held-out runs: {', '.join(held)}{tail}; {held_out_words(content)}.")
    text.append(not_followed_sentence(content))
    constancy = content.get("constancy") or {}
    rows = tuple(
        (halves, percent_text(p), "no" if p < CHANCE else "yes") for halves, p in constancy.items() if p is not None
    )
    caption = (
        "Is the size of the effect equal in both halves of the runs? Probability of a difference this large by chance."
    )
    tables = (Table(caption, ("halves", "probability", "equal size"), rows),) if rows else ()
    figure = gap_before_after(gap, lost, after=after_words(content), held_out=held_out_words(content))
    title = "Gap between simulation and measurement"
    return Section("diagnosis-gap", title, _full(text), (figure,) if figure else (), tables)


def _rivals(content: Json) -> Section | None:
    rivals = [rival for rival in content.get("rivals") or [] if isinstance(rival, dict) and "effects" in rival]
    if not rivals:
        return None
    title, why = "Alternatives", "reason against it"
    words = [(_names(rival["effects"]), in_words(str(rival.get("reason", "")))) for rival in rivals]
    if any(rival.get("carries_over") is not None for rival in rivals):  # odds alone name nothing there
        caption = (
            "The best other sets of effects. On open ground the noise is estimated from what the models leave of these "
            "same runs, so that odds alone name nothing: an answer also predicts commands that its fit did not see."
        )
        return Section("diagnosis-rivals", title, tables=(Table(caption, ("effects", why), tuple(words), words=True),))
    rows = tuple(
        (
            effects,
            percent_text(rival.get("probability")),
            number(-float(rival["log_odds"]), 1) if rival.get("log_odds") is not None else UNKNOWN,
            reason,
        )
        for rival, (effects, reason) in zip(rivals, words, strict=True)
    )
    caption = (
        "The best other sets of effects. Behind: natural logarithm of the odds against it, with priors; 3 is odds of "
        "20 to 1. An effect is named from odds of 3000 to 1 (8) on: a set that leads the answer by less, with a minus "
        "sign here, decides nothing."
    )
    table = Table(caption, ("effects", "probability", "behind", why), rows, words=True)
    return Section("diagnosis-rivals", title, tables=(table,))


def _small_print(content: Json) -> Section | None:
    noise, nominal = content.get("noise") or {}, content.get("nominal") or {}
    text = []
    if noise:
        scatter = noise.get("run_to_run")
        varies = "this includes the scatter from run to run"
        if scatter:
            friction, speed = (scatter_text(scatter, key) for key in ("friction", "wheel_speed"))
            varies = f"from run to run, friction scatters by {friction} and wheel speed by {speed}"
        text.append(
            f"Noise estimated from these runs: marks, {length(noise['mark_sigma_mm'])} (1 sigma), "
            f"correlated over {value_text(noise['correlation_s'])} s; {varies}."
        )
        if noise.get("common_drift_mm"):
            text.append(
                f"Both marks drift together by {length(noise['common_drift_mm'])} RMS within a run, for example "
                "because the camera moves against the plate or because of warm air. This is treated as noise."
            )
        if noise.get("friction_in_10_mm"):
            text.append(
                f"Friction varies by {percent_text(noise['friction_in_10_mm'])} over 10 mm of path, for example on a "
                "plate that is unevenly clean. This is treated as noise."
            )
    text.append(smoothed_sentence(content))
    text += unlike_sentences(content)
    text.append(left_out_sentence(content))
    text.append(not_tried_sentence(content))
    text.append(exact_frictions_sentence(content))
    rows = tuple(
        (
            name_of_value(key),
            signed_percent(item["relative_change"]),
            percent_text(item["sigma"]),
            percent_text(item["tolerance"]),
        )
        for key, item in nominal.items()
    )
    caption = "Nominal values: every fit, with or without effects, adjusts them within the tolerances of robot.toml."
    tables = (Table(caption, ("value", "adjusted by", "standard uncertainty", "tolerance"), rows),) if rows else ()
    if not _full(text) and not tables:
        return None
    return Section("diagnosis-noise", "Noise, scatter and nominal values", _full(text), (), tables)


def _names(effects: Sequence[str]) -> str:
    return " with ".join(map(effect_words, effects)) or "nothing missing"


def _full(text: Sequence[str]) -> tuple[str, ...]:
    return tuple(part for part in text if part)
