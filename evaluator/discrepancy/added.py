"""The robot file with the effect in it: the original text, untouched, and [[effect]] tables after it."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from evaluator.discrepancy.diagnosis import Diagnosis
from evaluator.discrepancy.free import FreeTerm
from simulator.robot import shipped_robots

# Patterns of one wheel or a diagonal, as sums of those that robot.toml knows.
PATTERN_SUMS: dict[str, tuple[tuple[str, float], ...]] = {
    "front-left": (("driving", 0.5), ("driving-left-right", 0.5)),
    "front-right": (("driving", 0.5), ("driving-left-right", -0.5)),
    "rear-left": (("driven", 0.5), ("left-right", 0.5), ("driving-left-right", -0.5)),
    "rear-right": (("driven", 0.5), ("left-right", -0.5), ("driving-left-right", 0.5)),
    "driven-left-right": (("left-right", 1.0), ("driving-left-right", -1.0)),
    "diagonal": (("driving-left-right", 2.0), ("left-right", -1.0)),
}


def robot_text(name_or_path: str) -> str:
    """Text of a robot file, shipped or the user's own."""
    if name_or_path in shipped_robots():
        return (Path(str(files("simulator") / "robots")) / f"{name_or_path}.toml").read_text(encoding="utf-8")
    return Path(name_or_path).read_text(encoding="utf-8")


def robot_with_effect(diagnosis: Diagnosis, text: str) -> str:
    """The robot file's text with the diagnosed effects appended."""
    assert diagnosis.terms is not None
    parts = [text.rstrip("\n"), ""]
    for effect in sorted(diagnosis.chosen):
        term, values = diagnosis.terms[effect], diagnosis.fit.point.terms[effect]
        if isinstance(term, FreeTerm):
            parts += _free_tables(term, values)
            continue
        parts += ["[[effect]]  # found by turnscope diagnose", f'id = "{effect}"']
        parts += [f"{name} = {_number(value)}" for name, value in term.physical(values).items()]
        parts.append("")
    return "\n".join(parts)


def _free_tables(term: FreeTerm, values: tuple[float, ...]) -> list[str]:
    lines = []
    for item, value in zip(term.items, values, strict=True):
        for pattern, share in PATTERN_SUMS.get(item.pattern, ((item.pattern, 1.0),)):
            lines += [
                f"[[effect]]  # found by turnscope diagnose: {term.describe()}",
                'id = "free-form"',
                f'channel = "{item.channel}"',
                f'basis = "{item.basis}"',
                f"coefficient = {_number(value * share)}",
                f'pattern = "{pattern}"',
                "",
            ]
    return lines


def _number(value: float) -> str:
    text = f"{value:.8g}"
    return text if any(mark in text for mark in ".en") else f"{text}.0"
