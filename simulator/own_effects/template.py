"""Commented template for an effect of the user, empty or with the terms that a diagnosis found."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from simulator.dynamics.terms import BASES, CHANNELS, PATTERNS


@dataclass(frozen=True)
class TermRow:
    """One [[term]] of the file, see simulator.own_effects.files; value: initial value of a fit, or None."""

    channel: str
    depends_on: str
    coefficient: str
    pattern: str = "common"
    unit: str = ""
    low: float = -1.0
    high: float = 1.0
    step: float = 0.01
    value: float | None = None


EXAMPLE = (
    TermRow("left_drive", "right_command", "right_to_left"),
    TermRow("right_drive", "left_command", "left_to_right"),
)


PYTHON = '''"""An effect of your own in Python. It may change everything that the effects in simulator/effects change.

The file is executed only if you name it: turnscope diagnose experiment.toml --effect {file}, or, for every command, in
the environment variable TURNSCOPE_EFFECTS.
"""

from simulator.effects.definition import Effect, Values
from simulator.effects.draft import Draft
from simulator.effects.parameter import Parameter


def _act(draft: Draft, values: Values) -> None:
    draft.speed_factor *= (1 + values["left"], 1.0)  # see simulator.effects.draft.Draft for what may change


EFFECT = Effect(
    id="{id}",
    name="what is wrong, in a few words",
    sentence="What the effect does, with its parameters.",
    law="v_left = (1 + left) · r·ω_left",
    source="reference of the law",
    limits="Limits of its validity.",
    kind="dynamics",
    # name, unit, value at which it vanishes, smallest visible change, bounds of a fit
    parameters=(Parameter("left", "", 0.0, 0.005, -0.5, 0.5),),
    act=_act,
)
'''


def python_template(effect_id: str, file: str) -> str:
    """The text of a Python file with an effect."""
    return PYTHON.replace("{file}", file).replace("{id}", effect_id)


def template(
    effect_id: str,
    rows: Sequence[TermRow] = EXAMPLE,
    name: str = "what is wrong, in a few words",
    sentence: str = "What the effect does, with its parameters.",
) -> str:
    """The text of effects/ID.toml."""
    terms = "\n".join(map(_row, rows))
    return f"""# An effect of your own. Put this file into the folder effects/ beside experiment.toml or robot.toml:
# the diagnosis then tests it like those of the catalogue, and an [[effect]] of robot.toml can name it by its id.
format = 1
id = {json.dumps(effect_id)}
name = {json.dumps(name, ensure_ascii=False)}
sentence = {json.dumps(sentence, ensure_ascii=False)}
# law = "…"      # the formula; by default composed from the terms
# source = "…"   # reference of the law
# limits = "…"   # limits of its validity

# A term adds coefficient × depends_on to a channel. Terms add up; several may share a coefficient (give unit, low,
# high and step once). Without its coefficients (at 0) the effect vanishes.
# channel: {_listed(CHANNELS)}.
#   Units: forces mN; moment µN·mm; steer degrees; camera mm; left_drive and right_drive rpm, added to the command;
#   speed, load, stiffness and friction: relative changes of each wheel, times its weight in the pattern.
# depends_on: {_listed(BASES)}.
#   u, v in mm/s, yaw rate in rad/s, time in s, x and y in mm; the drives take the commands (rpm) only.
# pattern, of wheel channels: {_listed(PATTERNS)}.
# unit: of the coefficient, for display. low, high: bounds of a fit, with 0 between them. step: smallest visible change.
# begin: optional further initial value of a fit, such as the result of an earlier fit.

{terms}"""


ID_LINE = "id = "


def id_of_file(path: Path) -> str:
    """An id from the name of a file."""
    return "-".join(re.findall(r"[a-z0-9]+", path.stem.lower())) or "own-effect"


def _listed(names: Iterable[str]) -> str:
    lines, line = [], ""
    for word in names:
        if len(line) + len(word) > 96:
            lines.append(line.rstrip())
            line = ""
        line += f"{word}, "
    return "\n#   ".join([*lines, line.rstrip(", ")])


def _row(row: TermRow) -> str:
    begin = "" if row.value is None else f"begin = {row.value:.4g}    # as fitted\n"
    return f"""[[term]]
channel = {json.dumps(row.channel)}
depends_on = {json.dumps(row.depends_on)}
pattern = {json.dumps(row.pattern)}
coefficient = {json.dumps(row.coefficient)}
unit = {json.dumps(row.unit, ensure_ascii=False)}
low = {row.low!r}
high = {row.high!r}
step = {row.step!r}
{begin}"""
