"""The robot file with the effects found: the user's text, adjusted nominal values, and [[effect]] tables."""

from __future__ import annotations

import tomllib

from evaluator.diagnosis.likelihood.run_data import is_shared
from evaluator.diagnosis.likelihood.variants import varied_robot
from evaluator.diagnosis.output.effect_tables import effect_tables
from evaluator.diagnosis.output.effects_json import parameters
from evaluator.diagnosis.output.robot_file import with_value, with_values_of_each
from evaluator.diagnosis.result import Diagnosis
from simulator.robot import Robot

MOVED = "before turnscope diagnose, which adjusted it by {:.1f} tolerances"
DEVIATION_DIGITS = 7  # a smaller change is rounding


def robot_with_effect(diagnosis: Diagnosis, text: str) -> str:
    """The text with nominal values where the fit has them, and the effects with their intervals appended."""
    assert diagnosis.terms is not None
    robot = Robot.model_validate(tomllib.loads(text))
    nominal = {key: value for key, value in diagnosis.fit.point.nominal.items() if not is_shared(key)}
    moved = varied_robot(robot, nominal)
    for key, deviation in nominal.items():
        if round(deviation, DEVIATION_DIGITS):
            table, name = key.split(".")
            # as stated: the last search does without what its noise hides, and loosens what the runs contradict
            said = MOVED.format(abs(deviation) / diagnosis.session.tolerance[key])
            part = getattr(moved, table)
            if isinstance(part, tuple):
                text = with_values_of_each(text, table, name, 1 + deviation, said)
            else:
                text = with_value(text, table, name, getattr(part, name), said)
    parts = [text.rstrip("\n"), ""]
    fitted = {effect: diagnosis.fit.point.terms[effect] for effect in diagnosis.chosen}
    bounds = {effect: parameters(diagnosis, diagnosis.terms[effect]) for effect in fitted}
    parts += effect_tables(diagnosis.terms, fitted, bounds)
    return "\n".join(parts)
