"""The robot file with the effect in it: the user's text, nominal values that moved, and [[effect]] tables after it."""

from __future__ import annotations

import tomllib

from evaluator.diagnosis.candidates.free_form import FreeTerm
from evaluator.diagnosis.diagnosis import Diagnosis
from evaluator.diagnosis.likelihood.run_data import is_shared
from evaluator.diagnosis.likelihood.simulation import varied_robot
from evaluator.diagnosis.output.robot_file import number, with_value
from simulator.robot import Robot

MOVED = "before turnscope diagnose, which moved it within its tolerance"
DEVIATION_DIGITS = 7  # a smaller change is rounding
# Patterns of one wheel, and of the driven pair, as sums of those that robot.toml knows.
PATTERN_SUMS: dict[str, tuple[tuple[str, float], ...]] = {
    "front-left": (("driving", 0.5), ("driving-left-right", 0.5)),
    "front-right": (("driving", 0.5), ("driving-left-right", -0.5)),
    "rear-left": (("driven", 0.5), ("left-right", 0.5), ("driving-left-right", -0.5)),
    "rear-right": (("driven", 0.5), ("left-right", -0.5), ("driving-left-right", 0.5)),
    "driven-left-right": (("left-right", 1.0), ("driving-left-right", -1.0)),
}


def robot_with_effect(diagnosis: Diagnosis, text: str) -> str:
    """The robot file's text with the diagnosed effects appended, nominal values where the same fit has them."""
    assert diagnosis.terms is not None
    robot = Robot.model_validate(tomllib.loads(text))
    nominal = {key: value for key, value in diagnosis.fit.point.nominal.items() if not is_shared(key)}
    moved = varied_robot(robot, nominal)
    for key, deviation in nominal.items():
        if round(deviation, DEVIATION_DIGITS):
            table, name = key.split(".")
            text = with_value(text, table, name, getattr(getattr(moved, table), name), MOVED)
    parts = [text.rstrip("\n"), ""]
    for effect in sorted(diagnosis.chosen):
        term, values = diagnosis.terms[effect], diagnosis.fit.point.terms[effect]
        if isinstance(term, FreeTerm):
            parts += _free_tables(term, values)
            continue
        parts += ["[[effect]]  # found by turnscope diagnose", f'id = "{effect}"']
        parts += [f"{name} = {number(value)}" for name, value in term.physical(values).items()]
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
                f"coefficient = {number(value * share)}",
                f'pattern = "{pattern}"',
                "",
            ]
    return lines
