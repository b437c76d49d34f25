"""Sentences and tables of a diagnosis beside its verdict: mistakes, quantities known to a tolerance, predicted gap."""

from __future__ import annotations

from typing import Any

from evaluator.report.diagnosis.gap import predicts_worse
from evaluator.report.diagnosis.values import value_text, with_interval
from evaluator.report.diagnosis.words import FAR, as_sentence, effect_words
from evaluator.report.numbers import UNKNOWN, number
from evaluator.report.pages.html import Section, Table
from evaluator.turning.motion.curvature import Z_975
from evaluator.wording import name_of_value

Json = dict[str, Any]

CONTRADICTS = 3.0  # tolerances from which the value of a robot file is a finding (diagnosis.assessment.knowledge)
# Of an axle compliance of 1.1 with a scrub of 0.1 mm, one alone was found, 0.87 [0.79, 0.95], with a stiffness 4.7
# tolerances off.
FURTHER = (
    "If a measurement confirms the robot file there, a further effect is missing, and the sizes found may be off "
    "by more than their intervals."
)


def mistake_sentences(content: Json) -> list[str]:
    """One sentence for each mistake of the experiment."""
    return [as_sentence(str(item["sentence"])) for item in content.get("mistakes") or []]


def finding_sentences(content: Json) -> list[str]:
    """Sentences on quantities whose fitted value contradicts their tolerance."""
    at_once = (content.get("known_together") or {}).get("sentence")
    said = [as_sentence(str(item)) for item in (*(content.get("findings") or []), *([at_once] if at_once else []))]
    nominal = (content.get("nominal") or {}).values()
    strained = any(abs(item["relative_change"]) > CONTRADICTS * item["tolerance"] for item in nominal)
    return [*said, FURTHER] if strained and content.get("verdict") == "effect" else said


def changed_sentence(content: Json) -> str:
    """Values that changed between two runs of the session, and were fitted apart; empty without any."""
    changed = [item for item in content.get("known_to") or [] if item.get("from_run") and _is_off(item)]
    if not changed:
        return ""
    names = [str(item["name"]).removeprefix("change of ").partition(", from")[0] for item in changed]
    parts = [f"{name} by {_with_bounds(item)}" for name, item in zip(names, changed, strict=True)]
    return as_sentence(
        f"These values changed within the session, from {changed[0]['from_run']} on, and were fitted apart before and "
        f"after: {'; '.join(parts)}. What was set up, glued on or calibrated anew there? Diagnose the runs before and "
        "after apart if more was changed"
    )


def preferred_sentence(content: Json) -> str:
    """Values with a tolerance whose fitted deviations exclude 0 (95 %), the farthest first; empty without any.

    All nominal values of the robot are left out if they are no finding (see predicted_sentence). Beside values that are
    far from the stated ones stand the effects that would move the marks alike.
    """
    known = [item for item in content.get("known_to") or [] if not item.get("from_run")]  # these are told as changes
    if predicts_worse(content):
        known = [item for item in known if "." not in item["quantity"]]
    else:
        told = {item["quantity"] for item in known}
        nominal = [_in_percent(key, item) for key, item in (content.get("nominal") or {}).items() if key not in told]
        known = [*known, *nominal]
    parts = []
    for item in sorted(known, key=_certainty, reverse=True):
        if _is_off(item):
            alike = "".join(f", or {effect}" for effect in item.get("equivalent") or [])
            far = f" ({_tolerances(item):.1f} tolerances{alike})" if _tolerances(item) > FAR else ""
            parts.append(f"{item.get('name') or item['quantity']} {_with_bounds(item)}{far}")
    return as_sentence(f"Of the values with a tolerance, the data prefer: {'; '.join(parts)}") if parts else ""


def _in_percent(key: str, item: Json) -> Json:
    """A nominal value with a relative tolerance in the form of one in known_to, in percent."""
    found, reach = 100 * item["relative_change"], 100 * Z_975 * item["sigma"]
    bounds = {"low": found - reach, "high": found + reach}
    return {
        "quantity": key,
        "name": name_of_value(key),
        "unit": "%",
        "taken": 100 * item["tolerance"],
        "found": found,
        **bounds,
    }


def negligible_sentence(content: Json) -> str:
    """Effects that were detected and are not relevant; empty without any."""
    parts = []
    for item in content.get("negligible") or []:
        done = item.get("changes") or {}
        radius, speed, path = (
            number(done.get(name, 0.0), 3) for name in ("radius_percent", "speed_percent", "path_noise_floors")
        )
        parts.append(f"{effect_words(item['id'])} (radius {radius} %, speed {speed} %, path {path} of the noise floor)")
    return f"Detected, but below the limits of relevance: {'; '.join(parts)}." if parts else ""


def knowledge_section(content: Json) -> Section | None:
    """Table of quantities that are known to a tolerance, with their fitted values."""
    rows = tuple(_row(item) for item in content.get("known_to") or [])
    if not rows:
        return None
    caption = (
        "Quantities that are known to a tolerance: the assumed standard deviation ([known_to] of experiment.toml and "
        "robot.toml), and the deviation that these runs prefer. ‘far’: more than two standard deviations."
    )
    head = ("quantity", "unit", "known to", "found", "95 %", "")
    sentences = (changed_sentence(content), *finding_sentences(content), negligible_sentence(content))
    shown = tuple(part for part in sentences if part)
    title = "Quantities known to a tolerance"
    return Section("diagnosis-known", title, shown, (), (Table(caption, head, rows, words=True),))


def mistakes_section(content: Json) -> Section | None:
    """Mistakes of the experiment, and the runs that are left out because of them."""
    sentences = mistake_sentences(content)
    if not sentences:
        return None
    runs = ", ".join(dict.fromkeys(run for item in content["mistakes"] for run in item["runs"]))
    tail = f"Left out of every number of the diagnosis: {runs}."
    return Section("mistakes", "Mistakes to correct first", (*sentences, tail))


def _row(item: Json) -> tuple[str, ...]:
    found, low, high = _found(item)
    interval = UNKNOWN if item.get("low") is None else f"{low} to {high}"
    name = str(item.get("name") or item["quantity"])
    return (
        name,
        str(item.get("unit") or ""),
        value_text(item.get("taken")),
        found,
        interval,
        "far" if _tolerances(item) > FAR else "",
    )


def _tolerances(item: Json) -> float:
    """Deviation of a value in tolerances; 0 if it is unknown."""
    taken, value = item.get("taken"), item.get("found")
    return abs(value) / taken if taken and value is not None else 0.0


def _certainty(item: Json) -> float:
    """Deviation of a value in tolerances, or in its own standard errors where these are larger, as on open ground."""
    low, high, value = item.get("low"), item.get("high"), item.get("found")
    if low is None or high is None or value is None or high <= low:
        return _tolerances(item)
    return float(min(_tolerances(item), 2 * Z_975 * abs(value) / (high - low)))


def _is_off(item: Json) -> bool:
    """Whether the 95 % interval of a deviation excludes 0."""
    return item.get("low") is not None and item["low"] * item["high"] > 0


def _with_bounds(item: Json) -> str:
    found, low, high = _found(item)
    return f"{found}{_unit(item)} [{low}, {high}]"


def _found(item: Json) -> tuple[str, str, str]:
    """Fitted value and its 95 % bounds."""
    return with_interval({"value": item.get("found"), "low": item.get("low"), "high": item.get("high")})


def _unit(item: Json) -> str:
    """The unit as text after a number."""
    return "" if item.get("unit") in (None, "1") else f" {item['unit']}"
