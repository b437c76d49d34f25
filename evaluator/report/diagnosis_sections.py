"""The sections on a diagnosis: what is missing, where it shows, whether the gap closes, what else was tried."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from evaluator.discrepancy.free import PREFIX, free_terms
from evaluator.report.diagnosis_view import DiagnosisView
from evaluator.report.figures.disagreement import disagreement_map, disagreement_panels
from evaluator.report.figures.gap import gap_before_after
from evaluator.report.pages import Section, Table
from evaluator.report.tables import UNKNOWN, number
from simulator.effects.catalogue import EFFECTS

Json = dict[str, Any]

SENTENCES = 8  # of where; the map has all
ENOUGH_SIGMAS = 4.0  # of a run that is to decide
CHANCE = 1e-3  # below this, a difference between halves is not believed to be chance
UNIT_WORDS = {"deg": "°", "mm": "mm", "mN": "mN", "rpm": "rpm", "s": "s"}


def diagnosis_sections(view: DiagnosisView | None) -> tuple[Section, ...]:
    """Sections of a diagnosis, in the order in which a reader asks; none where none was made."""
    if view is None:
        return ()
    there = (_verdict(view), _where(view), _gap(view.content), _rivals(view.content), _small_print(view.content))
    return tuple(section for section in there if section is not None)


def _verdict(view: DiagnosisView) -> Section:
    content = view.content
    text = [verdict_sentence(content), _sentence(str(content.get("reason") or ""))]
    if view.outdated:
        text.insert(0, "Recordings, robot or program have changed since this diagnosis: run turnscope diagnose again.")
    text += [_equivalents(effect) for effect in content.get("effects") or []]
    text.append(_next(content.get("next_experiment")))
    rows = [
        (effect["name"], *parameter(name), _value(value["value"]), f"{_value(value['low'])} to {_value(value['high'])}")
        for effect in content.get("effects") or []
        for name, value in effect["parameters"].items()
    ]
    table = Table("What was found, with 95 % intervals.", ("effect", "parameter", "unit", "value", "95 %"), tuple(rows))
    return Section("diagnosis", "What is missing in the model", _full(text), (), (table,) if rows else ())


def verdict_sentence(content: Json) -> str:
    """The verdict with the size of what was found, in one sentence."""
    effects = content.get("effects") or []
    found = "; and ".join(f"{effect['name']} ({effect['id']}){_sizes(effect)}" for effect in effects)
    free = "; and ".join(f"{effect['name']}{_sizes(effect)}" for effect in effects)
    return {
        "none": "Nothing is missing: the model explains these runs within noise, scatter and tolerances.",
        "effect": f"Missing in the model: {found}.",
        "unknown": "Something is missing that no known effect explains"
        + (f"; what would explain it best: {free}." if free else "."),
        "insufficient": "These runs cannot decide what is missing.",
    }.get(str(content.get("verdict")), "")


def _sizes(effect: Json) -> str:
    """Sizes with their 95 % intervals, for a sentence."""
    parts: list[str] = []
    for name, value in effect["parameters"].items():
        words, unit = parameter(name)
        size = f"{_value(value['value'])} {unit}".replace(" °", "°").rstrip()
        bounds = "" if parts else "95 %: "
        parts.append(f"{words} {size} [{bounds}{_value(value['low'])} to {_value(value['high'])}]")
    return ", " + ", ".join(parts) if parts else ""


def parameter(name: str) -> tuple[str, str]:
    """A parameter's name in words, and its unit."""
    for unit in ("rpm_per_uN_mm", "deg_per_mN", "mN_s_mm", "uN_mm_s", "mN_mm"):
        if name.endswith(unit):
            head = name.removesuffix(unit).rstrip("_")
            shown = {
                "rpm_per_uN_mm": "rpm/(µN·mm)",
                "deg_per_mN": "°/mN",
                "mN_s_mm": "mN·s/mm",
                "uN_mm_s": "µN·mm·s",
                "mN_mm": "mN/mm",
            }[unit]
            return (head.replace("_", " ") or "size", shown)
    if name.startswith("per_mm_"):
        return f"along {name[-1]}", "per mm"
    head, _, unit = name.rpartition("_")
    if unit in UNIT_WORDS and head:
        return head.replace("_", " "), UNIT_WORDS[unit]
    return {"rpm": ("size", "rpm"), "per_run": ("size", "per run")}.get(name, (name.replace("_", " "), ""))


def _equivalents(effect: Json) -> str:
    others = effect.get("equivalent") or []
    if not others:
        return ""
    named = [f"{EFFECTS[other].name} ({other})" if other in EFFECTS else other for other in others]
    return f"These runs cannot tell it from: {', or '.join(named)}."


def _next(following: Json | None) -> str:
    """What to run next, and whether one such run could be enough."""
    apart = (following or {}).get("separation_sigmas") or {}
    known = {name: sigmas for name, sigmas in apart.items() if sigmas is not None}
    if not following or not known:
        return ""
    command = f"{following['left_rpm']:g} / {following['right_rpm']:g} rpm".replace("-", "−")
    told = "; ".join(f"{sigmas:.1f} sigmas from {words_of(name)}" for name, sigmas in known.items())
    text = (
        f"What would tell more: {command} for {following['duration_s']:g} s from the middle of the plate, starting at "
        f"heading {following['heading_deg']:g}°. Expected separation: {told}."
    )
    if min(known.values()) < ENOUGH_SIGMAS:
        text += (
            f" Below {ENOUGH_SIGMAS:g} one such run is not enough: look at the robot, the plate and the wires instead, "
            "or drive at other speeds and places."
        )
    return text


def words_of(effects: str) -> str:
    """A set of effects as diagnosis.json joins them ("a + b"), free-form terms in words."""
    return " with ".join(_free_words(name) for name in effects.split(" + "))


def _free_words(name: str) -> str:
    term = free_terms().get(name)
    return term.describe() if term is not None else name


def _where(view: DiagnosisView) -> Section | None:
    items = [item for item in view.content.get("where") or [] if isinstance(item, dict) and item.get("sentence")]
    text = [_sentence(str(item["sentence"])) for item in items[:SENTENCES]]
    text += [_sentence(item) for item in view.content.get("where") or [] if isinstance(item, str)]
    if len(items) > SENTENCES:
        text.append(f"{len(items) - SENTENCES} more are in diagnosis.json.")
    pieces = view.pieces
    if pieces is None or pieces.empty:
        return Section("diagnosis-where", WHERE, tuple(text)) if text else None
    if not text:
        text = ["Nothing stands out: what the model misses depends on nothing that was asked."]
    figures = (disagreement_map(pieces), disagreement_panels(pieces))
    return Section("diagnosis-where", WHERE, tuple(text), tuple(figure for figure in figures if figure is not None))


WHERE = "Where model and robot disagree"


def _gap(content: Json) -> Section | None:
    gap = content.get("gap") or {}
    if not gap.get("before"):
        return None
    lost = content.get("runs_not_followed") or []
    held = gap.get("held_out_runs") or []
    text = [_gap_sentence(gap, found=bool(content.get("effects")))]
    if held:
        gain = gap.get("held_out_gain_sigmas")
        tail = f": the effect foretells them better by {gain:.0f} sigmas" if gain else ""
        text.append(f"Kept aside from the beginning, whole runs: {', '.join(held)}{tail}.")
    if lost:
        text.append(f"Not followed by the model that was chosen: {', '.join(lost)}. Look at these recordings first.")
    constancy = content.get("constancy") or {}
    rows = tuple(
        (halves, f"{100 * p:.2g} %", "no: not the same" if p < CHANCE else "yes")
        for halves, p in constancy.items()
        if p is not None
    )
    caption = (
        "Is the effect of one size in both halves of the runs? Probability of a difference as large as this by chance."
    )
    tables = (Table(caption, ("halves", "probability", "one size"), rows),) if rows else ()
    figure = gap_before_after(gap, lost)
    return Section("diagnosis-gap", "Does the gap close?", _full(text), (figure,) if figure else (), tables)


def _gap_sentence(gap: Json, *, found: bool) -> str:
    before, after, floor = gap["before"], gap["after"], gap["noise_floor"]

    def both(part: str) -> str:
        if before.get(part) is None or after.get(part) is None:
            return ""
        return f"from {_um(before[part])} to {_um(after[part])}"

    fitted, aside = both("fit"), both("held_out")
    how = "With what was found" if found else "With nominal values moved within their tolerances"
    parts = [f"{fitted} on the runs that were fitted" if fitted else "", f"{aside} on runs kept aside" if aside else ""]
    closed = " and ".join(filter(None, parts))
    return f"{how}, the distance between model and marks goes {closed}; tracking noise alone makes {_um(floor)}."


def _rivals(content: Json) -> Section | None:
    rows = tuple(
        (
            _names(rival["effects"]),
            _percent(rival.get("probability")),
            number(-float(rival["log_odds"]), 1) if rival.get("log_odds") is not None else UNKNOWN,
            _in_words(str(rival.get("reason", ""))),
        )
        for rival in content.get("rivals") or []
        if isinstance(rival, dict) and "effects" in rival
    )
    if not rows:
        return None
    caption = (
        "Every other set of effects that came near, the best first. Behind: by how much less probable it makes these "
        "runs, in natural logarithms, priors counted; 3 is odds of 20 to 1."
    )
    table = Table(caption, ("instead", "probability", "behind", "why not"), rows, words=True)
    return Section("diagnosis-rivals", "What else was tried", tables=(table,))


def _small_print(content: Json) -> Section | None:
    noise, nominal = content.get("noise") or {}, content.get("nominal") or {}
    text = []
    if noise:
        scatter = noise.get("run_to_run") or {}
        text.append(
            f"Estimated from these runs: marks scatter by {_um(noise['mark_sigma_mm'])}, "
            f"correlated over {_value(noise['correlation_s'])} s; from run to run friction varies by "
            f"{_percent(scatter.get('friction'))} and wheel speed by {_percent(scatter.get('wheel_speed'))}."
        )
    text.append(_left_out(content.get("skipped_runs") or {}))
    rows = tuple(
        (key, _signed(item["relative_change"]), _percent(item["sigma"]), _percent(item["tolerance"]))
        for key, item in nominal.items()
    )
    caption = (
        "Nominal values: in every fit, without and with effects, they may move within the tolerance of robot.toml."
    )
    tables = (Table(caption, ("value", "moved", "standard uncertainty", "tolerance"), rows),) if rows else ()
    if not _full(text) and not tables:
        return None
    return Section("diagnosis-noise", "Noise, scatter and nominal values", _full(text), (), tables)


def _left_out(skipped: dict[str, str]) -> str:
    if not skipped:
        return ""
    return f"Left out of the diagnosis: {'; '.join(f'{run} ({reason})' for run, reason in skipped.items())}."


def _names(effects: Sequence[str]) -> str:
    return " with ".join(map(_free_words, effects)) or "nothing missing"


def _in_words(text: str) -> str:
    """A sentence with free-form terms in words."""
    return re.sub(re.escape(PREFIX) + r"[\w.+-]+", lambda match: _free_words(match[0]), text)


def _value(value: float | None) -> str:
    return UNKNOWN if value is None else f"{value:.3g}".replace("-", "−")


def _percent(share: float | None) -> str:
    if share is None:
        return UNKNOWN
    return "< 0.01 %" if 0 <= share < 1e-4 else f"{100 * share:.2g} %"


def _signed(share: float | None) -> str:
    return UNKNOWN if share is None else f"{100 * share:+.2g} %".replace("-", "−")


def _um(length_mm: float | None) -> str:
    return UNKNOWN if length_mm is None else f"{1000 * length_mm:.3g} µm"


def _full(text: Sequence[str]) -> tuple[str, ...]:
    return tuple(part for part in text if part)


def _sentence(text: str) -> str:
    text = re.sub(r"(?<=\s)-(?=\d)", "−", text)
    return text[:1].upper() + text[1:].rstrip(".") + "." if text else ""
