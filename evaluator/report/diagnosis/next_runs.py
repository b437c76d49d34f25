"""Sentences on the runs that a diagnosis proposes next, and on what they would distinguish."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from evaluator.report.diagnosis.words import words_of

Json = dict[str, Any]

RUN_KEYS = ("left_rpm", "right_rpm", "duration_s", "x_mm", "y_mm", "heading_deg", "times")


def next_runs(content: Json) -> list[Json]:
    """Further runs that a diagnosis proposes; entries without all `RUN_KEYS` (of other programs) are left out."""
    following = content.get("next_experiment")
    runs = following.get("runs") if isinstance(following, dict) else None
    return [run for run in runs or [] if isinstance(run, dict) and run.keys() >= set(RUN_KEYS)]


def next_runs_sentence(content: Json) -> str:
    """Further runs that would be informative; empty without any."""
    runs = next_runs(content)
    return f"Most informative further runs: {'; '.join(map(_run_words, runs))}." if runs else ""


def separations_sentence(content: Json) -> str:
    """Effects that the proposed runs would distinguish, and those that no runs of this rig would; empty if neither."""
    following = content.get("next_experiment")
    if not isinstance(following, dict):
        return ""
    apart, beyond = _known(following.get("separation_sigmas")), _known(following.get("inseparable_sigmas"))
    parts = []
    if apart:
        listed = _listed([f"{sigmas:.1f} sigmas from {words_of(name)}" for name, sigmas in apart.items()])
        parts.append(f"Expected separation with these further runs: {listed}.")
    if beyond:
        listed = _listed([f"{words_of(name)} ({sigmas:.1f} sigmas)" for name, sigmas in beyond.items()])
        found = words_of(" + ".join(str(effect.get("id")) for effect in content.get("effects") or [])) or "the answer"
        parts.append(
            f"Even {following.get('most_runs', 'many')} further runs at these speeds on this plate would not "
            f"distinguish {found} from {listed}: inspect the robot, the plate and the wires, or drive faster."
        )
    return " ".join(parts)


def _known(sigmas: Json | None) -> dict[str, float]:
    return {name: value for name, value in (sigmas or {}).items() if value is not None}


def _listed(words: Sequence[str]) -> str:
    """A list in words; its parts end with semicolons if they are lists themselves."""
    between = "; " if any(mark in word for word in words for mark in (" and ", ", ")) else ", "
    last = "; and " if between == "; " else " and "
    return between.join(words[:-1]) + last + words[-1] if len(words) > 1 else words[0]


def _run_words(run: Json) -> str:
    times = {1: "", 2: " (twice)"}.get(run["times"], f" ({run['times']} times)")
    text = (
        f"{run['left_rpm']:g} / {run['right_rpm']:g} rpm for {run['duration_s']:g} s from x {run['x_mm']:g} mm, "
        f"y {run['y_mm']:g} mm at heading {run['heading_deg']:g}°{times}"
    )
    return text.replace("-", "−")
