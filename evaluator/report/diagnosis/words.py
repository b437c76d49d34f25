"""Sentences of a diagnosis: verdict, sizes, gap and next runs, for report, terminal and studio."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any

from evaluator.diagnosis.candidates.free_form import PREFIX, free_terms
from evaluator.report.diagnosis.values import NO_LIMIT, parameters, sizes, with_interval
from evaluator.report.numbers import significant
from evaluator.wording import NOTHING_MISSING
from simulator.effects.catalogue import EFFECTS
from simulator.effects.magnet_strength import LOAD_RATIO

Json = dict[str, Any]

FAR = 2.0  # stated standard deviations from which the deviation of a known value is told apart


def verdict_sentence(content: Json) -> str:
    """The verdict with the size of what was found, in one sentence."""
    effects = content.get("effects") or []
    if content.get("verdict") == "effect":
        found = "; and ".join(
            f"{effect['name']} ({effect['id']}){_sizes(effect)}{_equally(effect)}" for effect in effects
        )
        return f"Missing in the model: {found}."
    if content.get("verdict") == "unknown":
        return f"The model lacks something that no known effect explains{_description(content)}."
    off = _values_off(content)
    if content.get("verdict") == "none" and off:
        return _with_minus(f"No effect is missing, but not all values are as stated: {off}.")
    apart = content.get("left_out_runs") or {}
    but = f", apart from {_some(sorted(apart))}, left out of the diagnosis" if apart else ""
    missing = "proven missing" if _possible(content) else "missing"
    if lacking := content.get("not_driven"):
        missing += f" in runs without {' and without '.join(lacking)}"
    return {
        "none": f"Nothing is {missing}: the model explains these runs within noise, scatter and tolerances"
        f"{_strained_values(content)}{but}.",
        "insufficient": "The search ended before a decision."
        if content.get("stopped")
        else "These runs cannot decide whether an effect is missing, or which.",
    }.get(str(content.get("verdict")), "")


def reason_sentence(content: Json) -> str:
    """Why the verdict is what it is; empty if the verdict says so itself."""
    reason = str(content.get("reason") or "")
    if content.get("verdict") == "none":
        reason = reason.removeprefix(NOTHING_MISSING).removeprefix("; ")
    return as_sentence(in_words(reason))


def _values_off(content: Json) -> str:
    """Values that contradict their tolerances, without the tolerances, or that all values do so together."""
    findings = [str(item).partition(",")[0].replace(": off by", " off by") for item in content.get("findings") or []]
    if findings:
        return f"{'; '.join(findings)} ({'each ' * (len(findings) > 1)}more than three tolerances)"
    return str((content.get("known_together") or {}).get("sentence") or "").partition(" (")[0]


def _strained_values(content: Json) -> str:
    """Values that the explanation needs certainly beyond FAR tolerances, yet not so far that they contradict these."""
    strained = []
    for item in content.get("known_to") or []:
        value, taken, low, high = (item.get(key) for key in ("found", "taken", "low", "high"))
        if item.get("from_run") or not taken or None in (value, low, high) or max(low, -high) <= FAR * taken:
            continue
        unit = "" if item.get("unit") == "1" else f" {item.get('unit')}"
        size = with_interval({"value": value, "low": low, "high": high})[0]
        strained.append(f"{item.get('name')} is off by {size}{unit} ({abs(value) / taken:.1f} tolerances)")
    return f", if {' and '.join(strained)}" if strained else ""


def _description(content: Json) -> str:
    """Description of an unknown effect: the free-form term, or the largest disagreement."""
    effects = content.get("effects") or []
    forms = [effect for effect in effects if effect["id"] == "free-form"]
    named = [effect for effect in effects if effect["id"] != "free-form"]
    forms.sort(key=_may_be_zero)  # what may be zero is told last
    # of 13 effects beside a free-form term, in four blind banks, two were there, and three a part of what was
    firm = bool(forms) and not _may_be_zero(forms[0])

    def said(effects: Sequence[Json]) -> str:
        return _with_minus("; and ".join(f"{effect['name']}{_sizes(effect)}" for effect in effects))

    if effects and closes(content):
        beside = f", beside effects that may be there or imitate the same: {said(named)}" if firm and named else ""
        best = said(forms if firm else [*named, *forms])
        return f"; the {'best free-form' if forms else 'nearest known'} explanation is {best}{beside}"
    if effects:
        return f", and no free-form term does either; the nearest is {said([*forms, *named])}"
    seen = [item["sentence"] for item in content.get("where") or [] if isinstance(item, dict) and item.get("sentence")]
    return f", and no free-form term does either; the largest disagreement: {_with_minus(seen[0])}" if seen else ""


def _may_be_zero(effect: Json) -> bool:
    """Whether the intervals of all sizes of a free-form term contain zero."""
    sizes = [size for size in (effect.get("parameters") or {}).values() if isinstance(size, dict)]
    return effect["id"] == "free-form" and bool(sizes) and all(size["low"] <= 0 <= size["high"] for size in sizes)


def closes(content: Json) -> bool:
    """Whether a model was found that explains the runs, so that the gap has an "after"."""
    effects = content.get("effects") or []
    return content.get("verdict") != "unknown" or any(effect.get("fitted", True) for effect in effects)


def _sizes(effect: Json) -> str:
    """Sizes with their 95 % intervals, for a sentence; of limits beside one that certainly acts the low bounds only."""
    parts: list[str] = []
    higher: list[str] = []
    values = {name: sizes(name, effect["parameters"][name], effect["id"]) for name in effect["parameters"]}
    acts = any(high != NO_LIMIT for _, _, high in values.values())
    for name, (words, unit) in parameters(effect).items():
        best, low, high = values[name]
        if acts and high == NO_LIMIT:
            higher.append(f"{low} {unit} ({words})")
            continue
        size = f"{best} {unit}".replace(" °", "°").rstrip()
        parts.append(f"{words} {size} [{'' if parts else '95 %: '}{low} to {high}]")
    others = f"; if there are other limits, they are above {' and '.join(higher)}" if higher else ""
    return ", " + ", ".join(parts) + others if parts else ""


# Measurements beside recorded runs that distinguish an effect from its equivalents.
MEASUREMENTS = {
    "camera-tilt": "calibrate the camera again",
    "drive-speed-mismatch": "measure the left and the right wheel",
    "drive-speed-scale": "count the turns of a wheel in a minute",
    "mark-offset": "measure the places of the marks on the robot",
    "mass-offset": "balance the robot on an edge",
    "plane-scale": "film a known length on the plate",
    "plate-tilt": "put a level on the plate",
    "rolling-shutter": "film with a camera that exposes all rows at once, or state readout_ms in tracking.toml",
    "tether-pull": "drive with the wires held loose",
    "tether-spring": "drive with the wires held loose",
    "time-base": "film a clock",
}
LEADS = 2 / 3  # probability of an effect below which its equivalents stand beside it in the verdict


def _equivalents(effect: Json) -> list[str]:
    others = effect.get("equivalent") or []
    return [f"{EFFECTS[other].name} ({other})" if other in EFFECTS else other for other in others]


def _equally(effect: Json) -> str:
    """The equivalents of an effect that is no more probable than they are, for the verdict; empty of any other."""
    same = _equivalents(effect)
    return f", or equally: {', or '.join(same)}" if same and (effect.get("probability") or 1.0) < LEADS else ""


def equivalents_sentence(effect: Json) -> str:
    """Effects that these runs cannot distinguish from this one, and what would; empty without any."""
    same = _equivalents(effect)
    if not same:
        return ""
    asked = [MEASUREMENTS[one] for one in (effect["id"], *effect["equivalent"]) if one in MEASUREMENTS]
    would = f" To distinguish them: {', or '.join(dict.fromkeys(asked))}." if asked else ""
    return f"These runs cannot distinguish {effect['id']} from: {', or '.join(same)}.{would}"


def moved_marks_sentence(content: Json) -> str:
    """What displaced marks mean for everything measured, and how robot.toml is corrected; empty without them."""
    found = [effect for effect in content.get("effects") or [] if effect["id"] == "mark-offset"]
    if content.get("verdict") != "effect" or not found:
        return ""
    given = found[0]["parameters"]
    x, y, angle = (sizes(name, given[name], "mark-offset")[0] for name in ("x_mm", "y_mm", "angle_deg"))
    return (
        "Measured radii, speeds and paths are therefore of another point than the robot's centre. To correct this, "
        f"turn the positions in [marks] of robot.toml by {angle}° about the centre, move them by ({x}, {y}) mm, and "
        "analyse again."
    )


def together_sentence(effect: Json) -> str:
    """That an effect of several parameters acts though each interval contains the value at which it does not."""
    parameters, id_ = effect["parameters"], effect["id"]
    if len(parameters) < 2 or id_ not in EFFECTS:
        return ""
    absent = EFFECTS[id_].absent()
    within = (None not in (item["low"], item["high"]) for item in parameters.values())
    if not all(within) or not all(item["low"] <= absent[name] <= item["high"] for name, item in parameters.items()):
        return ""
    none = " and ".join(f"{name} = {absent[name]:g}" for name in parameters)
    return f"Each of these values may be the one of no effect, but not all at once ({none})."


DETERMINED = {LOAD_RATIO: "the load of a driven over that of a driving wheel"}


def determined_sentence(effect: Json) -> str:
    """What the runs determine of an effect besides its parameters; empty without anything."""
    said = []
    for name, value in (effect.get("determined") or {}).items():
        best, low, high = with_interval(value)
        words = DETERMINED.get(name, name.replace("_", " "))
        said.append(f"{words}, {best} [95 %: {low} to {high}] (as stated: {significant(value['stated'], 3)})")
    return f"The runs determine {'; and '.join(said)}." if said else ""


MOST_NAMED = 6  # runs left out for one reason
# Odds of 5 to 1: of 90 untidy sessions in which nothing was missing two had as probable a rival, both the lag that
# their motors had, and of 104 called so though an effect was there, or is equivalent to a tolerance, eight.
REPORTED_LOG_ODDS = math.log(5.0)
NAMED_LOG_ODDS = 8.0  # odds of 3000 to 1 that an effect needs: verdict.KEEP


def left_out_sentence(content: Json) -> str:
    """Runs that the diagnosis does not use, with reasons; empty if it uses all."""
    why = (content.get("skipped_runs") or {}) | (content.get("left_out_runs") or {})
    of_reason: dict[str, list[str]] = {}
    for run, reason in why.items():
        of_reason.setdefault(reason, []).append(run)
    runs = "; ".join(f"{_some(named)} ({in_words(reason)})" for reason, named in of_reason.items())
    return f"Left out of the diagnosis: {runs}." if runs else ""


def _some(runs: Sequence[str]) -> str:
    """Runs by name; of many the first, and how many others."""
    if len(runs) <= MOST_NAMED:
        return ", ".join(runs)
    return f"{', '.join(runs[: MOST_NAMED - 1])} and {len(runs) - MOST_NAMED + 1} others"


def unlike_sentences(content: Json) -> list[str]:
    """Sentences on runs that the model explains with unusual friction or wheel speeds; empty without any."""
    found = [as_sentence(str(item["sentence"])) for item in content.get("unlike_runs") or []]
    return (
        ["Runs unlike the others, for example because of dirt, the battery or a wiped plate:", *found] if found else []
    )


def not_tried_sentence(content: Json) -> str:
    """Effects and motions that these runs cannot show; empty if all were tested."""
    effects = content.get("not_tried") or []
    by_run = [effect for effect in effects if effect in EFFECTS and EFFECTS[effect].varies_by_run]
    of_plate = [effect for effect in effects if effect not in by_run]
    reasons = (
        ("Poses are relative to the start of each run, so effects that are fixed to the plate", of_plate),
        ("Commands are not repeated later in the session, so effects that change from run to run", by_run),
    )
    said = [f"{reason} were not tested: {', '.join(those)}." for reason, those in reasons if those]
    if lacking := content.get("not_driven"):
        said.append(f"These runs have no {' and no '.join(lacking)}: what acts there alone was not tested.")
    return " ".join(said)


def exact_frictions_sentence(content: Json) -> str:
    """What follows from frictions that count as exact; empty where no size depends on them."""
    keys = content.get("exact_frictions") or []
    if not keys:
        return ""
    return (
        "The ratio of the frictions along and across the wheels determines the yaw rate at a given difference of the "
        "wheel speeds. It counts as exact; if it is not, the speeds found for the turning drive are wrong by as much: "
        f"state what is known in [tolerance] of robot.toml ({', '.join(keys)}; of open ground about 0.3)."
    )


def rivals_sentence(content: Json) -> str:
    """The best rival that is more probable than the verdict, but is not the answer, and why; empty without one.

    Rivals that strain tolerances, and free-form terms, are left out: these have verdicts of their own.
    """
    if content.get("verdict") not in ("none", "effect"):
        return ""
    if (rival := _possible(content)) is None:
        return ""
    words = " with ".join(map(words_of, rival["effects"]))
    if rival.get("carries_over") is False:
        few = "it predicts commands left out no better than chance, and more commands would decide"
        return f"More probable in these runs, but not named: {words} ({few})."
    ratio = significant(math.exp(min(rival["log_odds"], 20.0)), 2)
    if rival["log_odds"] > NAMED_LOG_ODDS:
        return f"More probable in these runs, but not named: {words} (odds of {ratio} to 1; {rival.get('reason')})."
    return f"Not decided by these runs: {words} (odds of {ratio} to 1; an effect is named from 3000 to 1 on)."


def _possible(content: Json) -> Json | None:
    """The best rival that is more probable than the verdict, if it has a name and strains no tolerances.

    An effect that is told as a value beyond its tolerance is no rival of that, alone or beside those found.
    """
    told = _told_as_values(content)
    answer = {str(effect.get("id")) for effect in content.get("effects") or []}
    for rival in content.get("rivals") or []:
        if not isinstance(rival, dict):
            continue
        effects, odds = rival.get("effects") or [], rival.get("log_odds")
        named = effects and not any(str(effect).startswith(PREFIX) for effect in effects)
        strained = rival.get("strains") or (set(effects) & told and set(effects) <= told | answer)
        if named and odds is not None and odds > REPORTED_LOG_ODDS and not strained:
            return rival
    return None


def _told_as_values(content: Json) -> set[str]:
    """Effects equivalent to a value that contradicts its tolerance, which is told as that."""
    findings = [str(item) for item in content.get("findings") or []]
    return {
        effect
        for known in content.get("known_to") or []
        if any(finding.startswith(f"{known.get('name')}:") for finding in findings)
        for effect in known.get("equivalent") or []
    }


def words_of(effects: str) -> str:
    """A set of effects as diagnosis.json joins them ("a + b"), free-form terms in words."""
    return " with ".join(effect_words(name) for name in effects.split(" + "))


def effect_words(name: str) -> str:
    """An effect id, or a free-form term in words."""
    term = free_terms().get(name)
    return term.describe() if term is not None else name


def smoothed_sentence(content: Json) -> str:
    """That frames of smoothed tracks were not used; empty if the tracks are not smoothed."""
    noise = content.get("noise") or {}
    if not noise.get("smoothed"):
        return ""
    over = noise.get("smoothed_over_frames") or "several"
    return (
        f"The tracks are smoothed over {over} frames, so that those near a start, a stop or a change of the command, "
        "which average over it, and those at the ends of recordings are not used. Tracks without smoothing show more."
    )


def in_words(text: str) -> str:
    """A sentence with the ids of free-form terms replaced by words."""
    return re.sub(re.escape(PREFIX) + r"[\w.+=-]+", lambda match: effect_words(match[0]), text)


def as_sentence(text: str) -> str:
    """A text with a capital, its end and true minus signs; the id of a run or an effect stays as it is written."""
    text = _with_minus(text)
    first = text.split(maxsplit=1)[0].rstrip(",:;") if text.strip() else ""
    capital = text[:1].upper() if first.isalpha() else text[:1]
    end = "" if text.endswith("?") else "."
    return capital + text[1:].rstrip(".") + end if text else ""


def _with_minus(text: str) -> str:
    return re.sub(r"(?<=\s)-(?=\d)", "−", text)
