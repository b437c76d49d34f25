"""The section on what the runs exclude: limits of effects that the model lacks."""

from __future__ import annotations

from typing import Any

from evaluator.report.diagnosis.values import parameter, with_interval
from evaluator.report.numbers import UNKNOWN, significant
from evaluator.report.pages.html import Section, Table
from simulator.effects.catalogue import EFFECTS

Json = dict[str, Any]

LIMIT_KEYS = {"id", "parameter", "low", "high"}
CAPTION = (
    "If one of these effects acted as well, its size would lie within these limits (95 %), with every value free in "
    "its tolerance. Larger sizes contradict the runs; smaller ones cannot be excluded."
)


def limits_section(content: Json) -> Section | None:
    """Table of the limits; None without any. Entries without all `LIMIT_KEYS` (of other programs) are left out."""
    given = [item for item in content.get("limits") or [] if isinstance(item, dict) and item.keys() >= LIMIT_KEYS]
    rows = tuple(_row(item) for item in given if item["id"] in EFFECTS)
    if not rows:
        return None
    head = ("effect", "parameter", "unit", "without it", "95 %")
    table = Table(CAPTION, head, rows, words=True)
    return Section("diagnosis-limits", "What these runs exclude", _unlimited(content), (), (table,))


def _row(item: Json) -> tuple[str, ...]:
    declared = EFFECTS[item["id"]].parameter(item["parameter"])
    low, high = item["low"], item["high"]
    if low is None:
        bounds = f"up to {significant(high, 2)}"
    elif high is None:
        bounds = f"from {significant(low, 2)} on"
    else:
        _, least, most = with_interval({"value": (low + high) / 2, "low": low, "high": high})
        bounds = f"{least} to {most}"
    absent = "∞" if high is None else f"{declared.absent:g}" if declared else UNKNOWN
    return (EFFECTS[item["id"]].name, *parameter(item["parameter"], item["id"]), absent, bounds)


def _unlimited(content: Json) -> tuple[str, ...]:
    """A sentence on the effects without limits; empty if all others have one."""
    named = {item.get("id") for key in ("limits", "effects", "negligible") for item in content.get(key) or []}
    rest = [effect for effect in EFFECTS if effect not in {*named, *(content.get("not_tried") or [])}]
    if not rest:
        return ()
    why = "because these runs hardly show them, or because their consequence is not proportional to their size"
    return (f"Not limited, {why}: {', '.join(rest)}.",)
