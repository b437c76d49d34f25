"""Numbers of a diagnosis as text: parameters with unit and interval, shares, lengths."""

from __future__ import annotations

import math
from typing import Any

from evaluator.diagnosis.candidates.free_form_words import BASIS_WORDS, CHANNEL_WORDS, TWIN_WORDS, unit_of_coefficient
from evaluator.report.numbers import UNKNOWN, significant, true_minus
from evaluator.wording import with_bounds
from simulator.effects.catalogue import EFFECTS
from simulator.effects.parameter import UNITS, Unit

Json = dict[str, Any]

NO_LIMIT = "∞"  # text of a limit that limits nothing

# Of an error of the robot's speed without a simple law.
OF_SPEED = {
    "rms_along_mm_s": ("along the robot (RMS)", "mm/s"),
    "rms_across_mm_s": ("sideways (RMS)", "mm/s"),
    "rms_yaw_deg_s": ("in yaw rate (RMS)", "°/s"),
}


def parameters(effect: Json) -> dict[str, tuple[str, str]]:
    """Words and units of the parameters of an effect, by name; a single coefficient is the size of what has a name.

    Several coefficients of a free-form term are told without the words that all have in common, which its name has.
    """
    found = {name: parameter(name, effect["id"]) for name in effect["parameters"]}
    if effect["id"] != "free-form":
        return found
    if len(found) == 1:
        return {name: ("size", unit) for name, (_, unit) in found.items()}
    said = [words.split() for words, _ in found.values()]
    beside = zip(*said, strict=False)
    shared = next((place for place, words in enumerate(beside) if len(set(words)) > 1), min(map(len, said), default=0))
    shared *= shared > 1  # an article says nothing
    return {
        name: (" ".join(words[shared:]) or "size", unit)
        for (name, (_, unit)), words in zip(found.items(), said, strict=True)
    }


def parameter(name: str, effect_id: str = "") -> tuple[str, str]:
    """A parameter's name in words, and its unit: the declared one, else that in which the name ends."""
    if name in OF_SPEED:
        return OF_SPEED[name]
    first, twin, _ = name.partition("=")
    channel, *basis = first.split(".")
    if twin:  # of a coefficient that acts on both sides
        return TWIN_WORDS.get(name, name), ""
    if basis and (channel not in CHANNEL_WORDS or basis[0] not in BASIS_WORDS):  # of another program
        return " ".join(name.replace("_", " ").split(".")), ""
    if basis:  # of a free-form term: channel.basis or channel.basis.pattern
        wheels = "".join(f" ({pattern} wheels)" for pattern in basis[1:])
        words = f"{CHANNEL_WORDS[channel][0]} {BASIS_WORDS[basis[0]][0]}{wheels}"
        return words, unit_of_coefficient(channel, basis[0])
    declared = EFFECTS[effect_id].parameter(name) if effect_id in EFFECTS else None
    unit = UNITS[declared.unit] if declared else _unit_of(name)
    if unit.ending and name.startswith(f"{unit.ending}_"):
        return f"along {name.removeprefix(f'{unit.ending}_')}", unit.shown
    return name.removesuffix(unit.ending).rstrip("_").replace("_", " ") or "size", unit.shown


def _unit_of(name: str) -> Unit:
    """The unit in which a name ends; of a gradient (per_mm_x), with which it begins."""
    for unit in UNITS.values():
        if unit.ending and f"_{name}".endswith(f"_{unit.ending}"):
            return unit
    return UNITS["1/mm"] if name.startswith("per_mm_") else UNITS[""]


def sizes(name: str, value: Json, effect_id: str = "") -> tuple[str, str, str]:
    """A parameter's value and bounds; a limit at the value at which it limits nothing is infinite."""
    declared = EFFECTS[effect_id].parameter(name) if effect_id in EFFECTS else None
    if declared is None or declared.absent < declared.high:
        return with_interval(value)
    given = [value[key] for key in ("value", "low", "high")]
    bounds = [math.inf if bound is not None and bound >= declared.absent else bound for bound in given]
    if math.inf not in bounds:
        return with_interval(value)
    best, low, high = (NO_LIMIT if bound == math.inf else value_text(bound) for bound in bounds)
    return best, low, high


def with_interval(value: Json) -> tuple[str, str, str]:
    """A value and its bounds, with as many decimals as their distance bears."""
    best, low, high = value["value"], value["low"], value["high"]
    if None in (best, low, high) or not high > low:
        return value_text(best), value_text(low), value_text(high)
    best, low, high = (true_minus(text) for text in with_bounds(best, low, high))
    return best, low, high


def value_text(value: float | None) -> str:
    """A number with three digits and a true minus sign, without exponent for usual sizes; a dash if it is unknown."""
    if value is None:
        return UNKNOWN
    return (f"{value:.0f}" if 1e3 <= abs(value) < 1e6 else f"{value:.3g}").replace("-", "−")


def percent_text(share: float | None) -> str:
    """A share in percent."""
    if share is None:
        return UNKNOWN
    return "< 0.01 %" if 0 <= share < 1e-4 else f"{significant(100 * share, 2)} %"


def scatter_text(scatter: Json, key: str) -> str:
    """A scatter from run to run in percent, with its 95 % interval if that is known."""
    low, high = scatter.get(f"{key}_95") or (None, None)
    reach = "" if None in (low, high) else f" [95 %: {percent_text(low).removesuffix(' %')} to {percent_text(high)}]"
    return f"{percent_text(scatter.get(key))}{reach}"


def signed_percent(share: float | None) -> str:
    """A change in percent, with its sign."""
    return UNKNOWN if share is None else f"{significant(100 * share, 2, sign=True)} %"


def length(length_mm: float | None) -> str:
    """A length with three digits, in µm below a millimetre, in m from a thousand on."""
    if length_mm is None:
        return UNKNOWN
    unit, factor = ("µm", 1e3) if length_mm < 1 else ("mm", 1.0) if length_mm < 1000 else ("m", 1e-3)
    return f"{factor * length_mm:.3g} {unit}"
