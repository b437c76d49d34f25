"""Fitted effects as [[effect]] tables of a robot file, and the robot that has them."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping

from evaluator.diagnosis.candidates.free_form import FreeTerm
from evaluator.diagnosis.likelihood.point import Point
from evaluator.diagnosis.likelihood.run_data import is_shared
from evaluator.diagnosis.likelihood.variants import varied_robot
from evaluator.diagnosis.output.content import Bounded
from evaluator.diagnosis.output.robot_file import number
from simulator.effects.coordinates import Candidate
from simulator.effects.entry import EffectEntry
from simulator.robot import Robot

# Patterns of one wheel, and of the driven pair, as sums of those that robot.toml knows.
PATTERN_SUMS: dict[str, tuple[tuple[str, float], ...]] = {
    "front-left": (("driving", 0.5), ("driving-left-right", 0.5)),
    "front-right": (("driving", 0.5), ("driving-left-right", -0.5)),
    "rear-left": (("driven", 0.5), ("left-right", 0.5), ("driving-left-right", -0.5)),
    "rear-right": (("driven", 0.5), ("left-right", -0.5), ("driving-left-right", 0.5)),
    "driven-left-right": (("left-right", 1.0), ("driving-left-right", -1.0)),
}


def corrected_robot(robot: Robot, terms: Mapping[str, Candidate], point: Point) -> Robot:
    """The robot of a fitted point, as in its file except for the rounding of numbers."""
    nominal = {key: value for key, value in point.nominal.items() if not is_shared(key)}
    text = "\n".join(effect_tables(terms, point.terms))
    added = tuple(EffectEntry.model_validate(item) for item in tomllib.loads(text).get("effect", []))
    return varied_robot(robot, nominal).model_copy(update={"effect": (*robot.effect, *added)})


def effect_tables(
    terms: Mapping[str, Candidate],
    fitted: Mapping[str, tuple[float, ...]],
    bounds: Mapping[str, Mapping[str, Bounded]] | None = None,
) -> list[str]:
    """Lines of the [[effect]] tables of fitted effects.

    bounds: 95 % intervals of their parameters by effect and name, which are written in comments.
    """
    parts: list[str] = []
    for effect, values in sorted(fitted.items()):
        term, known = terms[effect], (bounds or {}).get(effect, {})
        if isinstance(term, FreeTerm):
            parts += _free_tables(term, values, known)
            continue
        parts += ["[[effect]]  # found by turnscope diagnose", f'id = "{effect}"']
        parts += [
            f"{name} = {number(value)}{_interval(known.get(name))}" for name, value in term.physical(values).items()
        ]
        parts.append("")
    return parts


def _free_tables(term: FreeTerm, values: tuple[float, ...], bounds: Mapping[str, Bounded]) -> list[str]:
    lines, names = [], list(term.physical(values))
    for name, item, value in zip(names, term.items, values, strict=True):
        for part in item.parts:
            for pattern, share in PATTERN_SUMS.get(part.pattern, ((part.pattern, 1.0),)):
                lines += [
                    f"[[effect]]  # found by turnscope diagnose: {term.describe()}",
                    'id = "free-form"',
                    f'channel = "{part.channel}"',
                    f'basis = "{part.basis}"',
                    f"coefficient = {number(value * share)}{_interval(bounds.get(name), share)}",
                    f'pattern = "{pattern}"',
                    "",
                ]
    return lines


def _interval(bounded: Bounded | None, share: float = 1.0) -> str:
    """Comment with the 95 % interval of a share of a value; empty if there is none."""
    if bounded is None:
        return ""
    ends = [bounded[end] for end in (("low", "high") if share > 0 else ("high", "low"))]
    low, high = (f"{share * end:.6g}" if end is not None else "unknown" for end in ends)
    return f"  # 95 %: {low} to {high}"
